"""What is drawn: the ticks of one walk as arrays, in one numpy file. In-process runs and the recorder write the same.

save_records(WalkRecords.from_ticks(records, landings, about), "records.npz")
records = load_records("records.npz")
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from io import BytesIO
from pathlib import Path
from typing import Annotated, Any, get_type_hints
from zipfile import ZipFile

import numpy as np
from rabbit_description.atomic_file import replacing
from rabbit_description.bounded_file import parse_json, read_bytes
from rabbit_description.state import DOF, JOINTS, TICK_SECONDS, Array, RobotState
from rabbit_description.validation import one_line
from rabbit_description.yaml_file import shortened
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Landing
from rl_cbf_clf_controller.message_fields import STONE_BARRIERS
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_trainer.rollout import Record

RECORDS, RECORDING = "records.npz", "recording"  # in a run's folder
LANDING = ("index", "tick", "l", "l_min", "l_max", "on_stone")
DRAWN = (
    *("controller", "adaptation", "friction_coeff", "friction_margin", "torque_limit"),
    *("R1", "R2", "stone_margin", "eps", "kp", "kd"),
)
DRAWN_OF_PLANT = ("mass_scale", "payload", "link_bend", "leg_stretch", "stones", "slope", "terrain", "tick_seconds")
MOST_BYTES = 200_000_000  # of records; a tick has about a thousand, half as many in the file
GAINS = ("eps", "kp", "kd", "tick_seconds")  # positive
NUMBERS = {*DRAWN[2:], "link_bend", "leg_stretch", "stones", "slope", "tick_seconds"}
MOST_NUMBER = 1e9
WHOLE = ("tick", "touchdowns", "stance", "step_index")
LEARNED = "learned controller"
CONTROLLERS = {  # in a title
    **dict.fromkeys(("clf-qp", "cbf-clf-qp"), "nominal controller"),
    **dict.fromkeys(("rl-clf-qp", "io-rl-clf-qp", "rl-cbf-clf-qp"), LEARNED),
    "l1-clf-qp": "L1 adaptive controller",
    "robust-cbf-clf-qp": "robust controller",
}
ESTIMATES = {"zero": "nominal controller", "oracle": "controller with exact estimates"}  # of a learned one
OUTCOMES = {
    **{"miss": "missed a stone", "gap_fall": "fell into a gap", "fall": "fell", "slip": "slipped"},
    **{"flight": "left the ground", "stall": "stood still", "contact disagreement": "touched down out of step"},
    **{"fault": "stopped by a fault", "silent": "its controller fell silent"},
}
RESCUE_NEEDED = 0.01  # rad/s^2 of slack of last resort: a quadratic one gives way a little whenever its row is active


class RecordsError(ValueError):
    """A file that holds no records."""


Number = Annotated[Array, "n"]  # a tick; shapes are of n ticks, k quantities, m inputs; None: any


@dataclass(frozen=True)
class WalkRecords:
    """n ticks; names, shapes after n, and units as in `RobotState` and `ControllerOutput`.

    `preview` (n, 2): l_min, l_max of the stone in sight, m, NaN where there is none; `stone_height` (n,): of its top
    above the one before, as previewed, m. `landings` has a row each, columns `LANDING`. `about`: what else a picture
    needs or says, see `about_walk`.
    """

    tick: Number
    q: Annotated[Array, "n", DOF]
    dq: Annotated[Array, "n", DOF]
    foot_force: Annotated[Array, "n", 2, 2]
    contact: Annotated[Array, "n", 2]
    touchdowns: Number
    preview: Annotated[Array, "n", 2]
    stone_height: Number
    torque: Annotated[Array, "n", JOINTS]
    stance: Number
    step_index: Number
    phase: Number
    eta: Annotated[Array, "n", None]
    V: Number
    barriers: Annotated[Array, "n", None]
    barrier_rates: Annotated[Array, "n", None]
    mu: Annotated[Array, "n", "m"]
    mu_qp: Annotated[Array, "n", "m"]
    omega: Annotated[Array, "n", "m"]
    mu_held: Annotated[Array, "n", "m"]
    nominal_a: Annotated[Array, "n", "k", "m"]
    nominal_b: Annotated[Array, "n", "k"]
    measured: Annotated[Array, "n", "k"]
    alpha: Annotated[Array, "n", "k", "m"]
    beta: Annotated[Array, "n", "k"]
    LgV: Annotated[Array, "n", "m"]
    clf_slack: Number
    rescue_slack: Number
    landings: Annotated[Array, None, len(LANDING)]
    about: dict[str, Any]

    @classmethod
    def from_ticks(cls, records: Sequence[Record], landings: Sequence[Landing], about: dict[str, Any]) -> "WalkRecords":
        """Keeps the ticks of a rollout."""
        if not records:
            raise RecordsError("no ticks: nothing to draw")
        measured, chosen = [record.state for record in records], [record.output for record in records]
        names = ARRAYS.keys() - SEEN - {"landings"}
        arrays = {n: np.array([getattr(tick, n) for tick in (measured if n in STATE else chosen)]) for n in names}
        seen = [state.preview for state in measured]
        preview = np.array([(stone.l_min, stone.l_max) if stone else (np.nan, np.nan) for stone in seen])
        heights = np.array([stone.height if stone else 0.0 for stone in seen])
        rows = np.array([[float(getattr(landing, name)) for name in LANDING] for landing in landings])
        first = records[0].output
        about = {"quantities": list(first.quantities), "barriers": list(first.barrier_names), **about}
        landed = rows.reshape(-1, len(LANDING))
        return cls(**arrays, preview=preview, stone_height=heights, landings=landed, about=about)

    @property
    def barrier_names(self) -> list[str]:
        """The names of `barriers`; those of the stones, where the file does not say."""
        return self.about.get("barriers", [*STONE_BARRIERS])

    @property
    def tick_seconds(self) -> float:
        """Length of a tick, s; the usual one, where the file does not say."""
        return float(self.about.get("tick_seconds", TICK_SECONDS))

    @property
    def time(self) -> Array:
        """Seconds since the reset, (n,)."""
        return self.tick * self.tick_seconds

    @property
    def stance_force(self) -> Array:
        """The force on the foot that stands, mean over the tick before: tangential, normal, (n, 2), N."""
        return self.foot_force[np.arange(len(self.tick)), self.stance]

    @property
    def step_starts(self) -> Array:
        """Rows at which a step begins, (steps,)."""
        return np.flatnonzero(np.diff(self.step_index, prepend=-1))


def about_walk(
    controller: ControllerParameters, simulation: SimulationParameters, policy: str, seed: int, outcome: str
) -> dict[str, Any]:
    """The parameters that pictures draw or name; `policy` is its version or name."""
    plant = {name: getattr(simulation, name) for name in DRAWN_OF_PLANT}
    about = {"outcome": outcome, "seed": seed, "policy": policy, **drawn_parameters(controller), **plant}
    return {"title": walk_title(about), **about}


def walk_title(about: Mapping[str, Any]) -> str:
    """A picture's title in words, as `Learned controller, twice the mass: walked`, of what is known in `about`."""
    title = ", ".join(filter(None, (controller_in_words(about), plant_in_words(about))))
    outcome = str(about.get("outcome") or "not recorded to its end")
    return f"{title}: {OUTCOMES.get(outcome, outcome)}"


def what_walks(controller: ControllerParameters, simulation: SimulationParameters, policy: str) -> str:
    """A command's first line: which controller walks on which plant."""
    about = about_walk(controller, simulation, policy, 0, "")
    with_policy = f", policy {Path(policy).stem}" if controller.learns and policy not in ESTIMATES else ""
    ground = "flat ground" if simulation.terrain == "flat" else "stones"
    plant = f"{simulation.plant}, {ground}, {plant_in_words(about) or 'the mass of its model'}"
    return f"{controller_in_words(about)} ({controller.controller}{with_policy}) on {plant}"


def controller_in_words(about: Mapping[str, Any]) -> str:
    """The controller in words, as `Learned controller`."""
    controller, policy = str(about.get("controller", "")), about.get("policy")
    who = CONTROLLERS.get(controller, controller)
    if about.get("adaptation") == "identification":
        who = "controller that identifies the robot"
    elif who == LEARNED and policy in ESTIMATES:
        who = ESTIMATES[policy]
    return who[:1].upper() + who[1:]


def plant_in_words(about: Mapping[str, Any]) -> str:
    """How the true robot and its ground differ from the model, as `half the mass, 5° uphill`; empty: not at all."""
    mass, payload, slope = (about.get(name, usual) for name, usual in (("mass_scale", 1), ("payload", 0), ("slope", 0)))
    said = [{1: "", 2: "twice the mass", 0.5: "half the mass"}.get(mass, f"{mass:g} times the mass")]
    said += [f"{payload:g} kg on the torso"] * bool(payload)
    said += [f"{abs(slope):g}° {'up' if slope > 0 else 'down'}hill"] * bool(slope)
    return ", ".join(filter(None, said))


def drawn_parameters(controller: ControllerParameters) -> dict[str, Any]:
    """The controller's parameters that pictures draw."""
    return {name: getattr(controller, name) for name in DRAWN}


HINTS = get_type_hints(WalkRecords, include_extras=True)
ARRAYS: dict[str, tuple[Any, ...]] = {name: kind.__metadata__ for name, kind in HINTS.items() if name != "about"}
SEEN = {"preview", "stone_height"}
STATE = {field.name for field in fields(RobotState)}  # the others are of `ControllerOutput`


def save_records(records: WalkRecords, path: Path) -> None:
    """Write the file at once or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    arrays = {name: getattr(records, name) for name in ARRAYS}
    with replacing(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, about=np.array(json.dumps(records.about)), **arrays)


def load_records(path: Path) -> WalkRecords:
    """Read records; raises `RecordsError` where there are none, or they do not fit together."""
    try:
        data = BytesIO(read_bytes(path, MOST_BYTES))
        if sum(array.file_size for array in ZipFile(data).infolist()) > MOST_BYTES:  # more memory than bytes
            raise ValueError(f"expected at most {MOST_BYTES} bytes of arrays")
        data.seek(0)
        with np.load(data, allow_pickle=False) as arrays_file:
            content = dict(arrays_file)
        about = parse_json(str(content["about"]))
        if not isinstance(about, dict):
            raise ValueError("about: expected names, each with a value")
        arrays = {name: content[name] for name in ARRAYS}
        _check(arrays, about)
        return WalkRecords(**arrays, about=about)
    except Exception as error:  # a damaged file may raise anything
        raise RecordsError(f"{path}: no records of a walk: {one_line(error)}") from error


def _check(arrays: Mapping[str, Array], about: Any) -> None:
    """Raise `ValueError` for arrays that are not of the same ticks, and for words that nothing can be drawn with."""
    n, quantities = arrays["nominal_b"].shape
    sizes = {"n": n, "k": quantities, "m": arrays["mu"].shape[-1]}
    for name, array in arrays.items():
        shape = tuple(sizes.get(size, size) for size in ARRAYS[name])
        fits = array.ndim == len(shape) and all(b in (None, a) for a, b in zip(array.shape, shape, strict=True))
        if not (fits and array.size < 2**31 and array.dtype.kind in ("i" if name in WHOLE else "fib") and n):
            raise ValueError(f"{name} is {array.dtype} {array.shape}: expected numbers {shape}")
    if not np.isin(arrays["stance"], (0, 1)).all():
        raise ValueError("stance: expected 0 or 1")
    names = about.get("quantities", [""] * quantities)
    if not isinstance(names, list) or len(names) != quantities or not all(isinstance(name, str) for name in names):
        raise ValueError(f"quantities = {shortened(names)}: expected {quantities} names")
    barriers = about.get("barriers", [*STONE_BARRIERS])
    if not isinstance(barriers, list) or len(barriers) != arrays["barriers"].shape[1]:
        raise ValueError(f"barriers = {shortened(barriers)}: expected {arrays['barriers'].shape[1]} names")
    for name, value in about.items():
        is_number = isinstance(value, int | float) and math.isfinite(value) and abs(value) < MOST_NUMBER
        if name in NUMBERS and not (is_number and (value > 0 or name not in GAINS)):
            raise ValueError(f"{name} = {shortened(value)}: expected a number")

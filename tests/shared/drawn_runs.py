"""Short runs that hypothesis draws, and their digits: two roads to a run must give the same ones."""

import zlib
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import astuple, dataclass, fields, is_dataclass
from typing import Any

import numpy as np
from hypothesis import strategies as st
from pydantic import BaseModel, ConfigDict
from rabbit_experiments.assembly import Assembly, resolve_policy
from rabbit_sim.parameters import SimulationParameters, marked
from rabbit_sim.perturbation import ENGINES_ALONE
from rabbit_sim.simulation import Simulation
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.controller_output import ControllerOutput
from rl_cbf_clf_controller.kinds import NAMES, find_kind
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.scene import ControllerError
from rl_trainer.rollout import Record

Parts = tuple[Simulation, Controller]
STATE = ("q", "dq", "foot_force", "contact", "touchdowns", "preview")
OUTPUT = [field.name for field in fields(ControllerOutput) if field.name != "solve_seconds"]


class Run(BaseModel):
    """All that decides a run of at most `ticks` ticks."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    controller: ControllerParameters
    simulation: SimulationParameters
    policy: str
    seed: int
    ticks: int

    def __repr__(self) -> str:
        """What `Run.model_validate_json` takes."""
        return self.model_dump_json(exclude_defaults=True)

    @contextmanager
    def parts(self) -> Iterator[Parts]:
        """A plant and a controller that have seen nothing yet."""
        policy = resolve_policy(self.policy, self.controller)
        simulation, controller = Assembly(self.simulation, self.controller, policy).build()
        with closing(simulation):
            yield simulation, controller


@dataclass(frozen=True)
class Tick:
    """The torque (4,), N m, and a checksum of each field of the state and the output.

    The last tick of a run that the controller refused has no torque; its checksum is that of the reason.
    """

    torque: tuple[float, ...]
    sums: dict[str, int]

    @classmethod
    def of(cls, record: Record) -> "Tick":
        """Reads all that the controller says of a tick."""
        values = {name: getattr(record.state, name) for name in STATE}
        values |= {name: getattr(record.output, name) for name in OUTPUT}
        sums = {name: checksum(value) for name, value in values.items()}
        return cls(tuple(map(float, record.output.torque)), sums)


Digits = list[Tick]


def checksum(value: Any) -> int:
    """Of all bits of an array or a number, whatever its type."""
    if is_dataclass(value):
        value = astuple(value)
    if isinstance(value, np.ndarray | np.generic | float | int):
        value = np.asarray(value, dtype=float)
        return zlib.crc32(repr(value.shape).encode() + value.tobytes())
    return zlib.crc32(repr(value).encode())


def walk(run: Run, parts: Parts) -> Iterator[Record | str]:
    """The run's ticks; where the controller refuses one, its reason ends the run."""
    simulation, controller = parts
    state = simulation.reset(run.seed)
    controller.reset(run.seed)
    for _ in range(run.ticks):
        if not state.running:
            return
        try:
            record = Record(state, controller.step(state))
        except (ControllerError, np.linalg.LinAlgError) as error:
            yield str(error)
            return
        yield record
        if record.output.fault:
            return
        state = simulation.step(record.output.torque)


def tick_of(found: Record | str) -> Tick:
    """In digits."""
    return Tick((), {"refused": checksum(found)}) if isinstance(found, str) else Tick.of(found)


def digits(run: Run, parts: Parts | None = None) -> Digits:
    """The run's digits, by `parts` or by new ones."""
    if parts is not None:
        return [tick_of(found) for found in walk(run, parts)]
    with run.parts() as new:
        return digits(run, new)


def assert_same(found: Digits, expected: Digits, run: Run, road: str) -> None:
    """Bit for bit; names the first tick that differs, in what, and by how much."""
    assert expected, f"no tick: {run!r}"
    for number, (ours, theirs) in enumerate(zip(found, expected, strict=False)):
        names = [name for name in {**theirs.sums, **ours.sums} if ours.sums.get(name) != theirs.sums.get(name)]
        assert not names, f"{road}: tick {number}: {', '.join(names)}; {ours.torque}, not {theirs.torque}: {run!r}"
    assert len(found) == len(expected), f"{road}: {len(found)} ticks, not {len(expected)}: {run!r}"


POLICIES = {  # of the shipped ones, which fit which controller
    "rl-cbf-clf-qp": ("rl-cbf-clf-qp", "rl-cbf-clf-qp-scale-0.7", "zero"),
    "rl-clf-qp": ("rl-clf-qp", "rl-cbf-clf-qp", "zero"),
    "io-rl-clf-qp": ("io-rl-clf-qp",),
}
GAITS = ("authors_035", "stones_0350_070", "stones_0350_084", "paper_stones", "slopes", "wide")


@st.composite
def controllers(draw: st.DrawFn) -> ControllerParameters:
    """Any kind, with its adaptation, objective, gait, solver, gains and noise."""
    kind = draw(st.sampled_from(NAMES))
    values: dict[str, Any] = {"controller": kind, "gait": draw(st.sampled_from(GAITS))}
    if not find_kind(kind).problem.corrects_input:
        values["adaptation"] = draw(st.sampled_from(("none", "none", "identification")))
        values["prediction"] = values["adaptation"] != "none" and draw(st.booleans())
        values["objective"] = draw(st.sampled_from(("paper", "pd_centred")))
    values["qp_solver"] = draw(st.sampled_from(("osqp", "daqp")))
    values["eps"] = draw(st.sampled_from((0.04, 0.02, 0.1)))
    values["sigma"] = draw(st.sampled_from((0.0, 0.0, 2.0)))
    values["force_rows"] = draw(st.booleans())
    values["cone"] = draw(st.sampled_from(("two_rows", "literal")))
    values["clf_row"] = draw(st.sampled_from(("normalised", "literal")))
    values["speed_regulation"] = draw(st.sampled_from(("learned", "integral")))
    values["l1_law"] = draw(st.sampled_from(("piecewise", "exact", "euler")))
    return ControllerParameters.model_validate(values)


PERTURBATIONS: dict[str, tuple[Any, ...]] = {  # round numbers: what is drawn is the mixture
    **{"mass_scale": (0.7, 1.5, 2.0, 2.5), "payload": (10.0, 40.0), "left_leg_scale": (0.8, 1.3)},
    **{"motor_lag": (0.002, 0.004, 0.01), "motor_loss": (0.1, 0.3), "left_knee_gain": (0.8, 1.1)},
    **{"joint_damping": (0.5, 2.0), "link_bend": (-0.02, 0.02), "leg_stretch": (0.97, 1.03), "sole_radius": (0.05,)},
    **{"slope": (-3.0, 2.0), "encoder_resolution": (1e-4, 1e-3), "velocity_noise": (0.01, 0.1)},
    **{"force_noise": (5.0, 20.0), "torque_delay": (0.001, 0.005), "torque_rate": (1e4, 1e5), "sensors": ("lab",)},
    **{"push": (5.0, 20.0), "coulomb": (1.0, 4.0), "backlash": (0.1,), "gear_stiffness": (5000.0,)},
    **{"ground_stiffness": (1e5,), "ground_friction": (0.5,), "stone_height": (0.02,), "stone_width": (0.04, 0.1)},
}


@st.composite
def simulations(draw: st.DrawFn, terrain: str) -> SimulationParameters:
    """A plant with up to four perturbations."""
    plant = draw(st.sampled_from(("pybullet", "mujoco", "rigid")))
    names = draw(st.lists(st.sampled_from(sorted(PERTURBATIONS)), max_size=4, unique=True))
    drawn = {
        name: draw(st.sampled_from(PERTURBATIONS[name]))
        for name in names
        if plant != "rigid" or name not in marked(ENGINES_ALONE)
    }
    return SimulationParameters.model_validate({**drawn, "plant": plant, "terrain": terrain, "stones": 3})


@st.composite
def runs(draw: st.DrawFn) -> Run:
    """Plant, controller, policy and seed; a few ticks, or steps."""
    controller = draw(controllers())
    alone = controller.adaptation == "none"  # no policy is trained for these beside an adaptation
    policy = draw(st.sampled_from(POLICIES.get(controller.controller, ("zero", "oracle")) if alone else ("zero",)))
    return Run(
        controller=controller,
        simulation=draw(simulations(controller.terrain)),
        policy=policy,
        seed=draw(st.integers(0, 2**32)),
        ticks=draw(st.sampled_from((10, 60, 3, 1))),
    )

"""Between a `ControllerOutput` and the fields of `ControllerState` and `LearnerTerms`, without ROS.

A recording's reader uses it too: any object with a message's fields will do. A controller of another kind may publish
neither; then an output has what state and torque tell, and NaN elsewhere.
"""

from typing import Any

import numpy as np
from cbf_clf_qp.quantity import LONGEST_NAME
from rabbit_common.message_checks import Refused, array_of, check_finite, doubles
from rabbit_description.state import JOINTS, Array, Leg

from rl_cbf_clf_controller.controller_output import NOTHING, ControllerOutput

LEGS = tuple(Leg)
STONE_BARRIERS = ("B1", "B2")  # others are your own
SCALARS = ("step_index", "step_time", "phase", "clf_slack", "rescue_slack", "saturated", "answered", "solve_seconds")
WORDS = {  # with the most characters that a message holds
    **{"policy_version": 64, "objective": 32, "adaptation": 32},
    **{"solver": 16, "status": 64, "fault": 128},
}
MOST_ACTIVE = 64
ROWS = ("margins", "slacks", "multipliers")  # of each of the QP's rows
TERMS = ("mu_qp", "omega", "mu_held", "observation", "identified", "adapted")
MATRICES, VECTORS = ("nominal_a", "alpha"), ("nominal_b", "measured", "beta")  # over the learned quantities
UNTOLD = {  # sizes of what a state and a torque do not tell
    **dict.fromkeys(("step_time", "phase", "V", "clf_slack", "rescue_slack", "solve_seconds"), ()),
    **dict.fromkeys(("barriers", "barrier_rates"), (0,)),
    **{"eta": (2 * JOINTS,), **dict.fromkeys(("mu", "mu_qp", "omega", "mu_held", "LgV"), (JOINTS,))},
    **{**dict.fromkeys(MATRICES, (0, JOINTS)), **dict.fromkeys(VECTORS, (0,))},
}
FINITE = ("lgv", "nominal_a", "nominal_b", "alpha", "beta", "observation", "identified", "adapted")


def state_fields(output: ControllerOutput) -> dict[str, Any]:
    """The fields of `ControllerState`, but for its head; texts that are too long for the message are cut."""
    fields: dict[str, Any] = {name: getattr(output, name) for name in SCALARS}
    fields |= {name: getattr(output, name)[:most] for name, most in WORDS.items()}
    bounded = slice(int(np.isnan(output.V)), None)  # by the QP: V, if there is one, and barriers
    values, rates = np.array([output.V, *output.barriers]), np.array([np.nan, *output.barrier_rates])
    fields |= {"names": ["V", *output.barrier_names][bounded]}
    fields |= {"values": doubles(values[bounded]), "rates": doubles(rates[bounded])}
    fields |= {name: doubles(getattr(output, name)) for name in ("eta", "mu", *ROWS)}
    active = [name[:LONGEST_NAME] for name in output.active[:MOST_ACTIVE]]
    return {**fields, "stance": int(output.stance), "active": active, "rows": list(output.rows)}


def terms_fields(output: ControllerOutput) -> dict[str, Any]:
    """The fields of `LearnerTerms`, but for its head."""
    fields: dict[str, Any] = {name: doubles(getattr(output, name)) for name in (*TERMS, *MATRICES, *VECTORS)}
    return {**fields, "lgv": doubles(output.LgV), "quantities": list(output.quantities)}


def state_values(message: Any, inputs: int = JOINTS, eta: int = 2 * JOINTS) -> dict[str, Any]:
    """The fields of `ControllerOutput` that a `ControllerState` tells; `eta`: its length. Raises `Refused`."""
    values: dict[str, Any] = {name: getattr(message, name) for name in ("tick", *SCALARS, *WORDS)}
    values |= {name: array_of(message, name, size) for name, size in (("eta", eta), ("mu", inputs))}
    for name in ("eta", "mu"):
        check_finite(name, getattr(message, name))
    if message.stance not in LEGS:
        raise Refused("no leg", f"stance = {message.stance}; expected 0 or 1")
    values |= {name: array_of(message, name, len(message.rows)) for name in ROWS}
    values |= {"stance": Leg(message.stance), "active": tuple(message.active), "rows": tuple(message.rows)}
    bounded = (array_of(message, name, len(message.names)) for name in ("values", "rates"))
    of_values, of_rates = (dict(zip(message.names, array, strict=True)) for array in bounded)
    V = float(of_values.pop("V", np.nan))
    barriers, rates = np.array([*of_values.values()]), np.array([of_rates[name] for name in of_values])
    return {**values, "V": V, "barriers": barriers, "barrier_rates": rates, "barrier_names": tuple(of_values)}


def terms_values(message: Any, inputs: int = JOINTS) -> dict[str, Any]:
    """The fields of `ControllerOutput` that a `LearnerTerms` tells; raises `Refused`."""
    n = len(message.quantities)
    values: dict[str, Any] = {name: array_of(message, name, inputs) for name in ("mu_qp", "omega", "mu_held")}
    values |= {name: np.array(getattr(message, name)) for name in ("observation", "identified", "adapted")}
    values |= {name: array_of(message, name, n) for name in VECTORS}
    values |= {name: array_of(message, name, n * inputs).reshape(n, inputs) for name in MATRICES}
    for name in FINITE:
        check_finite(name, getattr(message, name))
    return {**values, "LgV": array_of(message, "lgv", inputs), "quantities": tuple(message.quantities)}


def untold_values(measured: Any, policy_version: str) -> dict[str, Any]:
    """The fields of `ControllerOutput` that a state tells: steps as the simulator counts them; the rest is NaN."""
    values: dict[str, Any] = {name: np.full(size, np.nan)[()] for name, size in UNTOLD.items()}
    values |= {"tick": measured.tick, "policy_version": policy_version, "step_index": measured.touchdowns}
    values |= {"stance": Leg.standing(measured.touchdowns), "observation": NOTHING, "quantities": (), "active": ()}
    values["barrier_names"] = ()
    return {**values, "saturated": False, "answered": True, "solver": "", "status": "", "objective": ""}


def output_of(
    state: Any, terms: Any, torque: Array, measured: Any = None, policy_version: str = ""
) -> ControllerOutput:
    """A tick's output from its messages `ControllerState` and `LearnerTerms` and the torque (4,) of its command.

    Either message may be None if `measured` is given, the tick's `RobotState`; then what only it tells is NaN.

    Raises:
        Refused: a value that is not finite, or an array of another length than the robot's or the quantities'.
    """
    values = untold_values(measured, policy_version) if state is None or terms is None else {}
    values |= {} if state is None else state_values(state)
    return ControllerOutput(torque=torque, **values | ({} if terms is None else terms_values(terms)))

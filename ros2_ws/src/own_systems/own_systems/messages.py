"""A tick of a task as the fields of messages, for nodes and recordings, and back; no ROS here.

`state`, `parameters` -> controller -> `torque`, `controller_state`, `learner_terms`: the graph's own messages, whose
arrays have the system's lengths. A state x is (q, q'), or q alone; then q' is not known.
"""

from typing import Any

import numpy as np
from cbf_clf_qp.functions import Array
from rabbit_common.message_checks import Refused, array_of, check_finite, doubles

from own_systems.episode import Moment
from own_systems.task import ControlTask

NOTHING = np.zeros(0)


def layout_fields(task: ControlTask) -> dict[str, Any]:
    """Of `Episode`: what the arrays hold."""
    return {"coordinates": list(task.names_of_q), "joints": list(task.names_of_u), "feet": []}


def state_fields(task: ControlTask, x: Array, applied: Array, impacts: int = 0) -> dict[str, Any]:
    """Of `RobotState`, but its head; `applied` (m,): the input over the tick that ends here; `impacts` so far."""
    n = len(task.names_of_q)
    dq = x[n:] if len(x) > n else np.full(n, np.nan)
    arrays = {"q": doubles(x[:n]), "dq": doubles(dq), "applied": doubles(applied)}
    return {**arrays, "touchdowns": impacts, "running": True}


def state_of(task: ControlTask, message: Any) -> Array:
    """x (n,) of a `RobotState`; raises `Refused`."""
    n = len(task.names_of_q)
    parts = [array_of(message, "q", n), array_of(message, "dq", n)][: task.system.x.numel() // n]
    for name, part in zip(("q", "dq"), parts, strict=False):
        check_finite(name, part.tolist())
    return np.concatenate(parts)


def parameter_fields(task: ControlTask, p: Array) -> dict[str, Any]:
    """Of `TaskParameters`, but its head: what is commanded at a tick."""
    values = dict(zip(task.system.named, p, strict=True))
    return {"names": list(task.commanded), "values": doubles(np.array([values[name] for name in task.commanded]))}


def parameters_of(task: ControlTask, message: Any) -> Array:
    """p (k,) of a `TaskParameters`, with what the model has; raises `Refused`."""
    if sorted(message.names) != sorted(task.commanded):
        raise Refused("other names", f"names = {', '.join(message.names)}; expected {', '.join(task.commanded)}")
    values = array_of(message, "values", len(message.names))
    check_finite("values", values.tolist())
    return task.parameters_at({}, dict(zip(message.names, values.tolist(), strict=True)))


def controller_fields(task: ControlTask, moment: Moment, version: str) -> dict[str, Any]:
    """Of `ControllerState`, but its head."""
    seen, decided = moment.seen, moment.decided
    fields: dict[str, Any] = {"policy_version": version[:64], "adaptation": "none", "step_time": moment.time}
    names, values = [each.name for each in task.barriers], moment.barriers
    if seen is None or decided is None:
        untold = {"phase": np.nan, "clf_slack": np.nan, "rescue_slack": np.nan, "answered": True}
        return fields | untold | {"names": names, "values": doubles(values), "rates": doubles(values * np.nan)}
    has_clf, rows = "V" in task.tick.names, decided.values
    eta = seen.eta if has_clf else NOTHING
    values = np.concatenate([seen.V, values]) if has_clf else values
    clf_slack, rescue_slack = rows.slack_sums.tolist()
    return fields | {
        "objective": "paper" if task.objective is None else "own",
        "phase": np.nan,
        "eta": doubles(eta),
        "mu": doubles(np.asarray(moment.mu)),
        "names": ["V", *names] if has_clf else names,
        "values": doubles(values),
        "rates": doubles(np.full(len(values), np.nan)),
        "active": list(decided.active),
        "rows": list(decided.layout.names),
        "margins": doubles(rows.row_margin),
        "slacks": doubles(rows.slack),
        "multipliers": doubles(rows.multiplier),
        "clf_slack": clf_slack,
        "rescue_slack": rescue_slack,
        "saturated": task.limit is not None and bool(np.abs(moment.u).max() >= task.limit),
        "solver": decided.solver,
        "status": decided.status[:64],
        "answered": decided.is_by(task.tick.answer.solver),
        "solve_seconds": decided.seconds,
        "fault": "" if decided.solved else f"no solver answered: {decided.status}"[:128],
    }


def terms_fields(task: ControlTask, moment: Moment) -> dict[str, Any]:
    """Of `LearnerTerms`, but its head; only of a tick with a QP."""
    seen, estimates, decided = moment.seen, moment.estimates, moment.decided
    assert estimates is not None
    assert decided is not None
    return {
        "mu_qp": doubles(decided.mu),
        "omega": doubles(moment.mu - decided.mu),
        "observation": doubles(seen.observation),
        "quantities": list(task.tick.names),
        "nominal_a": doubles(seen.nominal_a),
        "nominal_b": doubles(seen.nominal_b),
        "alpha": doubles(estimates.alpha),
        "beta": doubles(estimates.beta),
    }

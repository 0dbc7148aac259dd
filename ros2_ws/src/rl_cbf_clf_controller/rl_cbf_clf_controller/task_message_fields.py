"""What a task's controller tells of a tick, as the fields of `ControllerState` and `LearnerTerms`; no ROS here."""

from typing import Any

import numpy as np
from rabbit_common.message_checks import doubles
from rabbit_description.task import ControlTask

from rl_cbf_clf_controller.task_controller import Moment

NOTHING = np.zeros(0)


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

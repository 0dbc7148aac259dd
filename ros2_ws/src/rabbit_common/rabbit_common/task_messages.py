"""What a control task is commanded at a tick, as the fields of `TaskParameters`, and back; no ROS here."""

from typing import Any

import numpy as np
from cbf_clf_qp.functions import Array
from rabbit_description.state import RobotState
from rabbit_description.task import ControlTask
from rabbit_description.task_state import layout_of

from rabbit_common.message_checks import Refused, array_of, check_finite, check_state, doubles


def measured_fields(state: RobotState) -> dict[str, Any]:
    """The fields of `RobotState`, but for its head and its feet, which a task lacks."""
    arrays = {name: doubles(getattr(state, name)) for name in ("q", "dq", "applied")}
    return {**arrays, "touchdowns": state.touchdowns, "running": state.running}


def state_of(task: ControlTask, message: Any, parameters: Any) -> RobotState:
    """A state from its `RobotState` and `TaskParameters`; raises `Refused`."""
    check_state(message, layout=layout_of(task))
    state = RobotState.of_message(message, None)
    state.parameters = parameters_of(task, parameters)
    return state


def parameter_fields(task: ControlTask, p: Array) -> dict[str, Any]:
    """The fields of `TaskParameters`, but for its head: what is commanded at a tick."""
    values = dict(zip(task.system.named, p, strict=True))
    return {"names": list(task.commanded), "values": doubles(np.array([values[name] for name in task.commanded]))}


def parameters_of(task: ControlTask, message: Any) -> Array:
    """p (k,) of a `TaskParameters`, with what the model has; raises `Refused`."""
    if sorted(message.names) != sorted(task.commanded):
        raise Refused("other names", f"names = {', '.join(message.names)}; expected {', '.join(task.commanded)}")
    values = array_of(message, "values", len(message.names))
    check_finite("values", values.tolist())
    return task.parameters_at({}, dict(zip(message.names, values.tolist(), strict=True)))

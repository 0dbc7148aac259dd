"""A control task's state as a robot's: x = (q, q'), or q alone, which has no rates; and what its model believes."""

import numpy as np

from rabbit_description.state import Array, RobotLayout, RobotState
from rabbit_description.task import ControlTask


def layout_of(task: ControlTask) -> RobotLayout:
    """What the arrays of a task's states and inputs hold; it has no feet."""
    has_rates = task.system.x.numel() > len(task.names_of_q)
    return RobotLayout(task.names_of_q, task.names_of_u, has_rates=has_rates)


def task_state(
    task: ControlTask, x: Array, p: Array, applied: Array, tick: int = 0, impacts: int = 0, running: bool = True
) -> RobotState:
    """A state x (n,) under the model's parameters p (k,); `applied` (m,): the input over the tick that ends here."""
    n = len(task.names_of_q)
    dq = x[n:] if len(x) > n else np.full(n, np.nan)
    no_feet = np.zeros((0, 2)), np.zeros(0, dtype=bool)
    return RobotState(tick, x[:n], dq, *no_feet, impacts, None, running, applied, parameters=p)


def p_of(state: RobotState) -> Array:
    """The model's parameters (k,) at a task's state."""
    assert state.parameters is not None
    return state.parameters


def x_of(task: ControlTask, state: RobotState) -> Array:
    """x (n,) of a task's state."""
    return np.concatenate([state.q, state.dq])[: task.system.x.numel()]

"""One episode: plant and controller, tick by tick. Both are arguments, so the trainer knows neither's inside."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from cbf_clf_qp.answer import Decided
from cbf_clf_qp.estimates import Estimates
from rabbit_description.state import Array, RobotState
from rl_cbf_clf_controller.controller_output import ControllerOutput


class Simulation(Protocol):
    """What a rollout needs of a plant."""

    def reset(self, seed: int) -> RobotState: ...

    def step(self, torque: Array) -> RobotState: ...


class Controller(Protocol):
    """What a rollout needs of a controller."""

    def reset(self, seed: int) -> None: ...

    def step(self, state: RobotState) -> ControllerOutput: ...


@dataclass(frozen=True)
class Record:
    """A tick: what was measured, and what the controller made of it."""

    state: RobotState
    output: ControllerOutput


@dataclass(frozen=True)
class Moment(Record):
    """A tick with what it was decided from: the state x (n,), and the parameters p (k,) that the model has there.

    Under a controller without a QP there are neither `estimates` nor `decided`.
    """

    x: Array
    p: Array
    estimates: Estimates | None
    decided: Decided | None

    @property
    def u(self) -> Array:
        """The input (m,)."""
        return self.output.torque


Observer = Callable[[Record], object]


def rollout(simulation: Simulation, controller: Controller, seed: int, *observers: Observer) -> RobotState:
    """Walk until the simulation or a controller's fault ends the episode; observers are called once a tick, in order.

    Returns:
        The last state: the one that is not running and got no torque, or the one with the fault.
    """
    state = simulation.reset(seed)
    controller.reset(seed)
    while state.running:
        record = Record(state, controller.step(state))
        for observe in observers:
            observe(record)
        if record.output.fault:
            break
        state = simulation.step(record.output.torque)
    return state

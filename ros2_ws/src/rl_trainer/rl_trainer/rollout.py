"""One episode: plant and controller, tick by tick. Both are arguments, so the trainer knows neither's inside."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

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

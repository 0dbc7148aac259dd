"""Episodes, one or several at once: plant and controller, tick by tick.

Both are arguments, so the trainer knows neither's inside.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from cbf_clf_qp.answer import Decided
from cbf_clf_qp.estimates import Estimates
from rabbit_description.state import Array, RobotState
from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.batch_output import BatchOutput
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

    @classmethod
    def of(cls, controller: Any, record: Record) -> "Moment":
        """The tick that this controller of RABBIT has just decided."""
        scene = controller.scene
        return cls(record.state, record.output, scene.x, scene.p, controller.estimates, controller.decided)

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


class Simulations(Protocol):
    """What `rollout_together` needs of N plants; `simulations`, `states` and `running` have one entry for each."""

    simulations: list[Any]
    states: Any

    @property
    def running(self) -> Array: ...

    def reset(self, seeds: Sequence[int]) -> Any: ...

    def step(self, torques: Array, /) -> Any: ...

    def keep(self, rows: Array) -> None: ...


@dataclass(frozen=True)
class Ended:
    """Episode `place` of several is over: its plant, its last state, and a controller's fault where that ended it."""

    place: int
    simulation: Any
    state: RobotState
    fault: str


@dataclass
class Shares:
    """Seconds of each tick over the number of episodes in it: of the controller, of the plant, and of all."""

    controller: list[float] = field(default_factory=list)
    plant: list[float] = field(default_factory=list)
    whole: list[float] = field(default_factory=list)


def rollout_together(
    simulations: Simulations,
    controllers: BatchController,
    seeds: Sequence[int],
    observe: Callable[[Array, BatchOutput], object],
    shares: Shares,
) -> Iterator[Ended]:
    """An episode of each seed, all begun at once; yields each as it ends.

    `observe` is called once a tick with the places (n,) of those that go on, and what was decided of them.
    """
    simulations.reset(seeds)
    for place, seed in enumerate(seeds):
        controllers.reset(place, seed)
    places = np.arange(len(seeds))

    def drop(ended: dict[int, str]) -> Iterator[Ended]:
        """Go on without these rows; of each a fault, or ""."""
        nonlocal places
        for row, fault in ended.items():
            yield Ended(int(places[row]), simulations.simulations[row], simulations.states[row], fault)
        if ended:
            rows = np.delete(np.arange(len(places)), [*ended])
            places = places[rows]
            if rows.size:
                simulations.keep(rows)
                controllers.keep(rows)

    while places.size:
        n, begun = len(places), time.perf_counter()
        output = controllers.step(simulations.states)
        shares.controller.append((time.perf_counter() - begun) / n)
        observe(places, output)
        faults = output.faults | output.errors
        torques = np.delete(output.torque, [*faults], axis=0) if faults else output.torque
        yield from drop(faults)
        if places.size:
            moved = time.perf_counter()
            simulations.step(torques)
            now = time.perf_counter()
            shares.plant.append((now - moved) / len(places))
            shares.whole.append((now - begun) / n)
            yield from drop(dict.fromkeys((~simulations.running).nonzero()[0].tolist(), ""))

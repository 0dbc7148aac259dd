"""Learns in a thread of its own, from ticks in a queue: whoever brings them never waits, and nothing is lost.

In the thread everything goes in order: ticks, an episode's end with its updates, the plan for the next. While the queue
is empty it may go on learning (`beside`), which makes the weights depend on timing. What is learned beside passes the
gate before it is published; a plan's policy does not, since it is the training's own next step.
"""

import os
import queue
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from rabbit_description.state import RobotState
from rl_cbf_clf_controller.controller import ControllerOutput
from rl_cbf_clf_controller.policy import ActorPolicy, LearnedPolicy
from rl_cbf_clf_controller.weights import PolicyFile

from rl_trainer.actor import Actor
from rl_trainer.learner import Learner
from rl_trainer.node_checkpoint import NodeCheckpoint
from rl_trainer.publication_gate import PublicationGate, Verdict
from rl_trainer.replay import Batch
from rl_trainer.training import EpisodePlan, EpisodeReport, Trainer
from rl_trainer.transitions import Transition

UPDATES_AT_ONCE = 4  # between two looks into the queue
NICENESS = 10


class Stopped(Exception):
    """The thread was told to end."""


class StoppableLearner:
    """A learner whose next update raises `Stopped` once `stop` is set."""

    def __init__(self, learner: Learner) -> None:
        self._learner = learner
        self.stop = threading.Event()

    @property
    def acting(self) -> Actor:
        """The actor to walk with."""
        return self._learner.acting

    def update(self, batch: Batch, rate: float) -> dict[str, float]:
        """One update, unless stopped."""
        if self.stop.is_set():
            raise Stopped
        return self._learner.update(batch, rate)

    def state_dict(self) -> dict[str, Any]:
        """The learner's."""
        return self._learner.state_dict()

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """The learner's."""
        self._learner.load_state_dict(state)


class Listener(Protocol):
    """Who hears of what was learned. All are called in the thread."""

    def on_plan(self, plan: EpisodePlan, after: int) -> None: ...

    def on_transition(self, transition: Transition, tag: Any) -> None: ...

    def on_policy(self, policy: PolicyFile) -> None: ...

    def on_verdict(self, verdict: Verdict) -> None: ...

    def on_report(self, report: EpisodeReport) -> None: ...


@dataclass(frozen=True)
class _Tick:
    state: RobotState
    output: ControllerOutput
    tag: Any


@dataclass(frozen=True)
class _End:
    state: RobotState | None
    number: int
    tag: Any


@dataclass(frozen=True)
class _InForce:
    policy: LearnedPolicy


_Item = _Tick | _End | _InForce


@dataclass
class LearningThread:
    """The thread. `beside`: updates between two publications while the queue is empty; 0: none, and nothing held out.

    `folder`: what is kept there, and gone on from, see `NodeCheckpoint`. A transition is told after it is kept.
    """

    trainer: Trainer
    listener: Listener
    beside: int = 0
    folder: Path | None = None
    error: str = ""
    _queue: "queue.SimpleQueue[_Item | None]" = field(default_factory=queue.SimpleQueue)

    def __post_init__(self) -> None:
        """Raises `CheckpointError` where the folder holds a training of other parameters, or a damaged one."""
        self._gate = PublicationGate(self.trainer.parameters)
        self.kept = NodeCheckpoint(self.folder, self.trainer, self._gate)
        self._learner = StoppableLearner(self.trainer.learner)
        self.trainer.learner = self._learner
        if self.beside:
            self.trainer.holds_out = self._gate.holds_out
        self._beside_updates = 0
        self._last: RobotState | None = None
        self._thread = threading.Thread(target=self._run, name="learning", daemon=True)

    def start(self, after: int = 0) -> None:
        """Plan the episode after number `after` and begin to listen; raises `CheckpointError` at a wrong journal."""
        self._plan = self.trainer.begin_episode()
        for transition in self.kept.begin():
            self.trainer.take(transition)
        self.listener.on_plan(self._plan, after)
        self._thread.start()

    def tick(self, state: RobotState, output: ControllerOutput, tag: Any = None) -> None:
        """A tick of the walk; `tag` comes back with its transition."""
        self._queue.put(_Tick(state, output, tag))

    def end(self, state: RobotState | None, number: int, tag: Any = None) -> None:
        """Episode `number` is over in `state` (None: lost); `tag` comes back with the transition into it."""
        self._queue.put(_End(state, number, tag))

    def in_force(self, policy: LearnedPolicy) -> None:
        """The controller walks with this policy now."""
        self._queue.put(_InForce(policy))

    @property
    def waiting(self) -> int:
        """Ticks in the queue."""
        return self._queue.qsize()

    def close(self) -> None:
        """End the thread at its next update."""
        self._learner.stop.set()
        self._queue.put(None)
        if self._thread.is_alive():
            self._thread.join(timeout=5.0)
        self.kept.close()

    def _run(self) -> None:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))  # learning can wait, whatever the node's priority
        if self.beside:  # whoever walks goes first
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICENESS)
        try:
            while (item := self._next()) is not None:
                self._take(item)
        except Stopped:
            pass
        except Exception as error:
            self.error = f"{type(error).__name__}: {error}"
            raise

    def _next(self) -> _Item | None:
        """The next item; learning beside while there is none."""
        while self.beside and self._queue.empty() and self.trainer.learn(UPDATES_AT_ONCE):
            self._beside_updates += UPDATES_AT_ONCE
            if self._beside_updates >= self.beside:
                self._beside_updates = 0
                self._publish()
        return self._queue.get()

    def _publish(self) -> None:
        """Publish the present weights, if the gate lets them pass."""
        file = self.trainer.policy_file()
        verdict = self._gate.judge(ActorPolicy(file))
        if verdict is not None:
            self.listener.on_verdict(verdict)
            if verdict.passes:
                self.listener.on_policy(file)

    def _take(self, item: _Item) -> None:
        if isinstance(item, _InForce):
            self._gate.in_force = item.policy
            return
        if isinstance(item, _Tick):
            self._last = item.state
            self._tell(self.trainer.observe(item.state, item.output), item.tag)
            return
        if self._last is not None:  # else nothing of it was heard, and the plan still holds
            last = item.state or self._last
            self._tell(self.trainer.observe_end(last), item.tag)
            self._digest(last)
        self.listener.on_plan(self._plan, item.number)

    def _digest(self, last: RobotState) -> None:
        """Learn from the episode that ended in this state, and plan the next."""
        self.listener.on_report(self.trainer.end_episode(self._plan, last))
        self.kept.save()
        self._plan, self._last = self.trainer.begin_episode(), None
        if self.beside:
            self._publish()

    def _tell(self, transition: Transition | None, tag: Any) -> None:
        if transition is not None and self.kept.add(transition):
            self.listener.on_transition(transition, tag)

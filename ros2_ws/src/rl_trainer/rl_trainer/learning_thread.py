"""Learns in another thread, from ticks in a queue: whoever brings them never waits, and nothing is lost.

In the thread everything goes in order: ticks, an episode's end with its updates, the plan for the next. So what is
learned does not depend on timing.
"""

import os
import queue
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from rabbit_description.state import RobotState
from rl_cbf_clf_controller.controller_output import ControllerOutput

from rl_trainer.checkpoint import Checkpoint
from rl_trainer.training import DivergenceError, EpisodePlan, EpisodeReport, Stopped, Trainer
from rl_trainer.transitions import Transition


class Listener(Protocol):
    """Who gets what was learned. All are called in the thread."""

    def on_plan(self, plan: EpisodePlan, after: int, report: EpisodeReport | None) -> None:
        """How to walk the episode after number `after`, and what was learned from that one."""

    def on_transition(self, transition: Transition, tag: Any) -> None:
        """A transition was taken in, and is on disk."""


class LearningThread:
    """The thread. `error`: why it ended by itself; `disk_error`: why nothing is kept any more (it learns on)."""

    def __init__(self, trainer: Trainer, listener: Listener, folder: Path | None = None) -> None:
        """Go on from what is in `folder`; None: nothing is kept. A transition is handed to the listener once kept.

        Raises:
            CheckpointError: the folder holds a training of other parameters, or a damaged one.
        """
        self.trainer, self.error, self.disk_error = trainer, "", ""
        self._listener = listener
        self._checkpoint = Checkpoint(folder, trainer) if folder else None
        self._last: RobotState | None = None  # of the episode; None: nothing of it has come
        self._queue: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()  # None ends the thread
        self._thread = threading.Thread(target=self._run, name="learning", daemon=True)

    def start(self, after: int = 0) -> None:
        """Begin, and plan the episode after number `after`; raises `CheckpointError` at a wrong journal."""
        self.take_up(after)
        self._thread.start()

    def take_up(self, after: int) -> None:
        """Plan that episode; what the journal holds of it from before a kill is taken in."""
        self._plan = self.trainer.begin_episode()
        self._on_disk(Checkpoint.begin)
        self._listener.on_plan(self._plan, after, None)

    def tick(self, state: RobotState, output: ControllerOutput, tag: Any = None) -> None:
        """A tick of the walk; `tag` comes back with its transition."""
        self._queue.put(partial(self._observe, state, output, tag))

    def end(self, state: RobotState | None, number: int, tag: Any = None) -> None:
        """Episode `number` is over in `state` (None: lost); `tag` comes back with the transition into it."""
        self._queue.put(partial(self._end_episode, state, number, tag))

    @property
    def waiting(self) -> int:
        """Ticks in the queue."""
        return self._queue.qsize()

    def close(self) -> None:
        """End the thread at its next update."""
        self.trainer.stop.set()
        self._queue.put(None)
        if self._thread.is_alive():
            self._thread.join(timeout=5.0)

    def _run(self) -> None:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))  # learning can wait, whatever the node's priority
        try:
            while (job := self._queue.get()) is not None:
                job()
        except Stopped:
            pass
        except DivergenceError as error:
            self.error = str(error)
        except BaseException as error:  # a learner may be another package's
            self.error = f"{type(error).__name__}: {error}"
            raise

    def _observe(self, state: RobotState, output: ControllerOutput, tag: Any) -> None:
        self._last = state
        self._keep(self.trainer.observe(state, output), tag)

    def _end_episode(self, state: RobotState | None, number: int, tag: Any) -> None:
        """Learn from the episode, and plan the next; if nothing of it has come, the plan still holds."""
        report = None
        if self._last is not None:
            last = state or self._last
            self._keep(self.trainer.observe(last), tag)
            report = self.trainer.end_episode(self._plan, last)
            self._on_disk(Checkpoint.save)
            self._plan, self._last = self.trainer.begin_episode(), None
        self._listener.on_plan(self._plan, number, report)

    def _keep(self, transition: Transition | None, tag: Any) -> None:
        if transition is not None:
            self._on_disk(lambda checkpoint: checkpoint.append(transition))
            if not self.disk_error:
                self._listener.on_transition(transition, tag)

    def _on_disk(self, action: Callable[[Checkpoint], object]) -> None:
        if self._checkpoint and not self.disk_error:
            try:
                action(self._checkpoint)
            except OSError as error:
                self.disk_error = f"{error}; transitions, checkpoints and policies are not kept any more"

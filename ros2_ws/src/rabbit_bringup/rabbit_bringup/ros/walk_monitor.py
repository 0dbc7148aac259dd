"""The launcher: starts the nodes, sees who is ready, lets the walk begin, says how it goes, ends the nodes."""

import contextlib
import math
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rabbit_common.executables import LaunchError
from rabbit_common.exit_codes import CUT_SHORT, ExitCode
from rabbit_common.priority import leave_priority, take_listeners_priority
from rabbit_common.ros.client import TOPIC, GraphClient
from rabbit_common.ros.diagnostics import BARRIER, figure, reader_counts
from rabbit_common.ros.namespace_check import NamespaceCheck
from rabbit_common.ros.topics import missing_readers
from rabbit_msgs.msg import Episode, EpisodePlan, Landing

from rabbit_bringup.launching.processes import Processes, write_parameters
from rabbit_bringup.launching.walk import WalkOptions, WalkSettings

GLANCE_SECONDS, READY_SECONDS = 0.2, 0.05  # between two looks at the walk, and at nodes that begin
ANSWER_SECONDS = 10.0
Tell = Callable[[Any], object]  # gets the `Episode` message of an episode that has ended
UNHEARD = DiagnosticStatus(level=DiagnosticStatus.WARN, message="not heard of yet")


class Stuck(LaunchError):
    """The graph runs, and cannot go on."""

    code = ExitCode.FAULT


class Progress(NamedTuple):
    """How the walk stands; what only a tick knows is what simulator and controller said in their last diagnostics."""

    episode: int
    stone: int
    stones: int
    margin: float  # m, of the last landing; NaN where there are no stones
    barriers: dict[str, float]  # B, by name
    slack: float
    ratio: float  # |F_T| / F_N of the stance foot
    ticks: int  # of all episodes so far


class WalkMonitor(GraphClient):
    """Sees `processes` through a walk; `tell` gets the message of each episode that has ended."""

    def __init__(self, options: WalkOptions, processes: Processes, tell: Tell = lambda _: None) -> None:
        super().__init__("launcher", options.namespace, "/rabbit/launcher", processes.check)
        self.processes = processes
        self._options, self._tell = options, tell
        self._said: dict[str, DiagnosticStatus] = {}
        self.episode = Episode()
        self.ended: dict[int, Episode] = {}
        self._complaint = ""  # of a simulator that cannot go on
        self._digested = 0  # episodes that the trainer has learned from
        self.seconds, self._began = 0.0, time.monotonic()  # of the ended episodes; when this one did
        self._landing = Landing()  # the last
        for name in ("diagnostics", "episode", "episode_plan", "landing"):
            self.hear(name, getattr(self, f"_on_{name}"))
        self.client("pause")  # so that the simulator knows it in time

    def begin(self) -> None:
        """Let the simulator go on, once all nodes are ready; raises `LaunchError`."""
        timeout, began = self._options.ready_timeout, time.monotonic()
        while missing := self.not_ready(self.processes.names):
            self.check()
            if time.monotonic() - began > timeout:
                lines = "; ".join(f"{name}: {line}" for name, line in missing.items())
                raise LaunchError(f"not ready after {timeout:g} s: {lines}")
            self.spin(READY_SECONDS)
        answer = self.ask("pause", ANSWER_SECONDS, data=False)
        if not (answer and answer.success):
            raise LaunchError("the simulator does not answer its pause service")

    def glance(self) -> Progress:
        """Hear for a moment how it goes.

        Raises `LaunchError` if a node ended by itself or the simulator cannot go on, `Interrupted` by a signal.
        """
        self.spin(GLANCE_SECONDS)
        self.check()
        if self._complaint:
            raise Stuck(self._complaint)
        e, landing = self.episode, self._landing
        stone = landing.index if e.phase != Episode.ENDED and landing.episode == e.episode else e.touchdowns
        margin = min(landing.l - landing.l_min, landing.l_max - landing.l) if landing.episode else math.nan
        simulator, controller = (self._said.get(name, UNHEARD) for name in ("simulator", "controller"))
        slack, ratio = figure(controller, "CLF slack"), figure(simulator, "force ratio")
        ticks = int(np.nan_to_num(figure(simulator, "ticks")))
        names = [value.key.removeprefix(BARRIER) for value in controller.values if value.key.startswith(BARRIER)]
        barriers = {name: figure(controller, BARRIER + name) for name in names}
        return Progress(e.episode, stone, e.stones, margin, barriers, slack, ratio, ticks)

    def not_ready(self, nodes: list[str]) -> dict[str, str]:
        """Which of the nodes are not ready, and what they say; and topics that do not reach all who need them."""
        is_foreign, is_task = self._options.is_foreign, bool(self._options.task)
        silent = ("recorder",) if is_foreign or is_task else ()  # it waits for what neither publishes
        if is_foreign:  # it says nothing of itself
            nodes = [name for name in nodes if name != "controller"]
        said = {name: self._said.get(name, UNHEARD) for name in nodes if name not in silent}
        told: dict[str, int] = {}
        for status in said.values():
            told |= reader_counts(status)
        missing = missing_readers([*nodes, "launcher"], told, self._others(nodes))
        if is_task:  # which has no stones to tell of
            missing = [topic for topic in missing if topic in told]
        alone = dict.fromkeys(missing, "too few readers")
        return {name: s.message for name, s in said.items() if s.level != DiagnosticStatus.OK} or alone

    def _others(self, nodes: list[str]) -> dict[str, int]:
        """Readers by topic that belong to nobody we started, as a viewer that was there before."""
        known, node = (*nodes, "launcher"), self.node
        ends = {name: node.get_subscriptions_info_by_topic(node.resolve_topic_name(name)) for name in TOPIC}
        names = {topic: [end.node_name.removeprefix("_") for end in readers] for topic, readers in ends.items()}
        return {topic: sum(not name.startswith(known) for name in readers) for topic, readers in names.items()}

    @property
    def is_over(self) -> bool:
        """Whether all episodes have ended, the last of them not cut short: another one takes its place."""
        e, options = self.episode, self._options
        ended = e.phase == Episode.ENDED and e.episode >= options.episodes and e.outcome != CUT_SHORT
        return ended and not (options.learns_between and self._digested < e.episode)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self._said[status.name.split("/")[-1]] = status

    def _on_episode(self, message: Episode) -> None:
        if message.phase == Episode.RUNNING and message.tick == 0:
            self._began = time.monotonic()
        if message.phase == Episode.ENDED and message.episode in self.ended:
            if message.reason != self.ended[message.episode].reason:  # else the simulator repeats an end
                self._complaint = message.reason
        elif message.phase == Episode.ENDED:
            self.seconds += time.monotonic() - self._began
            self.ended[message.episode] = message
            self._tell(message)
        self.episode = message

    def _on_episode_plan(self, message: EpisodePlan) -> None:
        self._digested = message.after_episode

    def _on_landing(self, message: Landing) -> None:
        self._landing = message


def walk_through(
    walk: WalkSettings, tell: Tell = lambda _: None, show: Callable[[Progress], object] = lambda _: None
) -> WalkMonitor:
    """Walk all episodes, as `walking` says; `show` gets the walk's progress now and then."""
    with walking(walk, tell) as monitor:
        while not monitor.is_over:
            show(monitor.glance())
    return monitor


@contextlib.contextmanager
def walking(walk: WalkSettings, tell: Tell = lambda _: None) -> Iterator[WalkMonitor]:
    """A graph that walks, seen by the monitor, as long as that is called now and then; all nodes have ended at the end.

    Raises `LaunchError` if another graph is there, or a node cannot be started, ended by itself, or is not ready in
    time; `Interrupted` by a signal.
    """
    processes = Processes(walk.folder / "log")
    with contextlib.ExitStack() as stack:
        check = stack.enter_context(contextlib.closing(NamespaceCheck(walk.options.namespace)))
        take_listeners_priority(walk.options.priority, warn=lambda line: print(line, file=sys.stderr))
        stack.callback(leave_priority, walk.options.priority)  # what is started meanwhile has it too
        stack.enter_context(processes.ended_at_last())
        check.look(walk.names)
        write_parameters(walk.parameter_file, walk.parameters())
        for name in sorted(walk.names, key=lambda name: name != "trainer"):  # which imports the longest
            processes.check()
            package, executable = walk.executable(name)
            processes.start(name, walk.arguments(name), executable, package)
        with contextlib.closing(WalkMonitor(walk.options, processes, tell)) as monitor:
            monitor.begin()
            yield monitor

"""A sequence of rules on a held graph: what should be in force, and the look that all of it is.

A look comes after every few rules and at the end: all nodes are brought back, and an episode of two stones must walk
to its end with the torques of the same walk in process, under the policy and the parameters that should be in force.
"""

import resource
import shutil
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import wraps
from pathlib import Path
from typing import Any

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize
from rabbit_common.ros.diagnostics import OK

from .graph import HANG_AFTER, NODES, HeldGraph
from .policies import SEEDS, ZERO, digest, torques_of

EVERY = 5  # rules between two looks
GRAPHS = 40  # sequences that a graph serves, unless something was wrong
RECORDING_END = 1.0  # s of which a killed recorder may lose all
DELIVERY = 0.2  # s in which what a node said before it ended is heard here
DYNAMIC = {"sigma": "controller", "pace": "simulator"}
SECOND = "recorder2"


@dataclass
class Model:
    """What should be in force."""

    swap_at: str
    in_force: str = ZERO
    pending: list[tuple[str, bool]] = field(default_factory=list)  # versions; whether one waits for an episode's start
    values: dict[str, float] = field(default_factory=lambda: dict.fromkeys(DYNAMIC, 0.0))
    accepted: int = 0  # policies since the controller's start
    refused: int = 0
    away: set[str] = field(default_factory=lambda: {SECOND})
    stopped: set[str] = field(default_factory=set)
    full: dict[str, float] = field(default_factory=dict)  # since when its disk is or was full
    is_spoiled: bool = False  # the episode under way: it ends by some rule, but nobody says how

    def tick(self, is_first: bool) -> None:
        """The newest policy that is due at a tick is in force from it on; those before it are forgotten."""
        due = [i for i, (_, waits) in enumerate(self.pending) if is_first or not waits]
        if due:
            self.in_force, self.pending = self.pending[due[-1]][0], self.pending[due[-1] + 1 :]

    def restarted(self, node: str) -> None:
        """A node begins as it was first started."""
        for name in [name for name, owner in DYNAMIC.items() if owner == node]:
            self.values[name] = 0.0
        if node == "controller":
            self.in_force, self.pending, self.accepted, self.refused = ZERO, [], 0, 0

    def can(self, *names: str) -> bool:
        """Whether these nodes are there and not stopped."""
        return not (self.away | self.stopped) & set(names)

    @property
    def can_begin(self) -> bool:
        """Whether an episode may begin: the simulator counts its readers."""
        return not self.away & set(NODES) and self.can("simulator", "controller")


class Shared:
    """One graph for many sequences, built from nothing where the one before was left with something wrong."""

    folder = Path()
    graph: HeldGraph | None = None
    served = 0

    @classmethod
    def take(cls) -> HeldGraph:
        """The graph for a sequence."""
        if cls.graph is not None and cls.served >= GRAPHS:
            cls.drop(keep=False)
        if cls.graph is None:
            cls.graph, cls.served = HeldGraph(cls.folder / f"graph-{time.time_ns()}"), 0
        cls.served += 1
        return cls.graph

    @classmethod
    def drop(cls, keep: bool) -> None:
        """The next sequence has another one; `keep` what this one has left."""
        if cls.graph is not None:
            graph, cls.graph = cls.graph, None
            graph.close()
            if not keep:
                shutil.rmtree(graph.folder)


def acts(rule_function: Callable[..., None]) -> Callable[..., None]:
    """A rule that is counted, and after which the graph is only used again if the rule came to its end."""

    @wraps(rule_function)
    def act(self: "Sequence", **arguments: Any) -> None:
        self.is_well = False
        self.graph.note(rule_function.__name__, arguments)
        rule_function(self, **arguments)
        self.is_well = True
        self.since_look += 1
        Sequence.rules_done += 1
        if self.since_look >= EVERY:
            self.look(SEEDS[0])

    return act


class Sequence(RuleBasedStateMachine):
    """Begins, goes on tick by tick, looks."""

    rules_done = sequences_done = 0  # in all

    def __init__(self) -> None:
        super().__init__()
        self.since_look = 0
        self.is_well = True
        self.graph = Shared.take()
        Sequence.sequences_done += 1

    @initialize(swap_at=st.sampled_from(("tick", "episode", "never")))
    @acts
    def begin(self, swap_at: str) -> None:
        """The controller is another one than before; the other nodes are well, and nobody else is there."""
        graph, self.model = self.graph, Model(swap_at)
        graph.silence()
        self._wait_until_well()
        if SECOND in graph.processes.names:
            graph.terminate(SECOND)
        graph.terminate("controller")
        self.start("controller")
        self._wait_until_well()
        for name, node in DYNAMIC.items():
            assert not graph.refusals(node, {name: self.model.values[name]}, HANG_AFTER)
        self.reset_to(SEEDS[0])

    def start(self, node: str) -> None:
        """Start a node and wait until it speaks."""
        self.graph.start(node, **({"swap_at": self.model.swap_at} if node == "controller" else {}))
        self.model.restarted(node)
        self.model.away.discard(node)
        self.graph.wait(f"the {node} to speak", lambda: node in self.graph.said)

    def reset_to(self, seed: int) -> int:
        """Begin an episode, held at tick 0."""
        number = self.graph.reset(seed)
        self.model.is_spoiled = False
        self.model.tick(is_first=True)
        return number

    def at(self, ticks: int) -> None:
        """Go on for so many ticks, if that is possible; a spoiled episode gives way to another one."""
        model, graph = self.model, self.graph
        if not model.can("simulator", "controller"):
            return
        if model.is_spoiled or not graph.is_running:
            if not model.can_begin:
                return
            self.reset_to(SEEDS[0])
        for _ in range(ticks):
            if graph.is_running:
                graph.step()
                model.tick(is_first=False)

    # What a node leaves behind that is no more

    def check_left(self, node: str, until: float) -> None:
        """All that was acknowledged is on disk; a recording holds what was heard before a moment."""
        graph = self.graph
        graph.spin(DELIVERY)
        if node == "trainer":
            lost = graph.lost_transitions()
            assert lost == 0, f"{lost} acknowledged transitions are not on disk"
        elif node in graph.recordings:
            path, since = graph.recordings.pop(node)
            missing, why = graph.missing_ticks(path, since, min(until, self.model.full.get(node, until)))
            assert not missing, f"{path}: {missing} ticks are missing, {why}"

    # The look

    def teardown(self) -> None:
        """At the end, unless it has failed before."""
        try:
            if self.since_look and self.is_well:
                self.look(SEEDS[1])
        finally:
            if not self.is_well:
                Shared.drop(keep=True)

    def look(self, seed: int) -> None:
        """All nodes up: what was refused has changed nothing, and a good episode walks."""
        self.is_well = False
        model, graph = self.model, self.graph
        graph.note("look", {"seed": seed})
        self._bring_back()
        self._wait_until_well()
        for name, node in DYNAMIC.items():
            assert graph.parameter(node, name, HANG_AFTER) == model.values[name], name
        number = self.reset_to(seed)
        graph.pause(False)
        graph.wait(f"the end of episode {number}", lambda: number in graph.ended)
        graph.wait("the next episode by itself", lambda: graph.turn[0] > number)
        graph.pause(True)
        ended, _ = graph.ended[number]
        assert ended.outcome == "walked", f"{ended.outcome}: {ended.reason}"
        answers = [graph.torques[number, tick] for tick in range(ended.tick)]
        assert {answer.policy_version for answer in answers} == {model.in_force}
        ours = [answer.torque.tobytes() for answer in answers]
        reference = torques_of(model.in_force, seed, model.values["sigma"])
        assert ours == reference, f"{digest(ours)}; in process {digest(reference)}"
        graph.wait(f"{model.refused} refused policies counted", lambda: graph.count("refused policy") >= model.refused)
        graph.forget(number)
        self.reset_to(SEEDS[0])
        self.since_look = 0
        self.is_well = True

    def _bring_back(self) -> None:
        model, graph = self.model, self.graph
        for node in sorted(model.stopped):
            self.let_go(node)
        for node in sorted(model.full):
            if node not in model.away:
                graph.limit_files(node, resource.RLIM_INFINITY)
                graph.terminate(node)
                model.away.add(node)
                self.check_left(node, time.monotonic())
            del model.full[node]
        for node in sorted(model.away & set(NODES)):
            self.start(node)

    def let_go(self, node: str) -> None:
        """SIGCONT; a simulator that was stopped as it moved is held."""
        self.graph.processes.send(node, signal.SIGCONT)
        self.model.stopped.discard(node)
        if node == "simulator":
            self.graph.pause(True)

    def _wait_until_well(self) -> None:
        self.graph.wait("all nodes well", lambda: all(self._is_well(node) for node in NODES))

    def _is_well(self, node: str) -> bool:
        said = self.graph.said.get(node)
        return said is not None and said.level == OK

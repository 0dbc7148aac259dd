"""The rules: what an operator, a stranger and bad luck may do to the graph, in any order, each at a tick it names."""

import random
import resource
import signal
import subprocess
import time
from collections.abc import Callable
from typing import Any

from hypothesis import strategies as st
from hypothesis.stateful import precondition, rule
from rabbit_campaigns.ros import wrong_messages as wrong
from rabbit_common.exit_codes import ExitCode
from rabbit_common.ros.client import TOPIC
from rabbit_common.ros.topics import TOPICS
from rabbit_msgs.msg import PolicyWeights

from .graph import HANG_AFTER, NODES
from .policies import SEEDS, SIGMAS, ZERO, bad, good, torques_of, version_of
from .sequence import DYNAMIC, RECORDING_END, SECOND, Sequence, acts

TICKS = st.integers(0, 12)
WRITERS = ("recorder", "trainer")
GOOD = [*(("sigma", sigma) for sigma in SIGMAS), *(("pace", pace) for pace in (0.0, 1.0, 30.0))]
BAD: list[tuple[str, str, Any]] = [
    ("controller", "sigma", -1.0),
    ("controller", "sigma", float("nan")),
    ("controller", "sigma", "much"),
    ("controller", "sigma", 1),
    ("controller", "swap_at", "episode"),
    ("controller", "kp", 0.2),
    ("simulator", "pace", -1.0),
    ("simulator", "pace", 1000.0),
    ("simulator", "pace", True),
    ("simulator", "stones", 3),
    ("simulator", "nobody_knows_it", 1.0),
    ("trainer", "batch", 32),
    ("recorder", "path", "elsewhere"),
]
IGNORED_SECONDS = 0.3  # in which something that is to be ignored may come in
LIES: dict[str, Callable[[random.Random, bytes, Any], bytes]] = {
    "repeated": wrong.repeated,
    "cut": wrong.cut,
    "garbled": wrong.garbled,
    "misplaced": wrong.misplaced,
    "not finite": wrong.not_finite,
}


def there(*names: str) -> Callable[[Any], Any]:
    """The rule needs these nodes."""
    return precondition(lambda self: self.model.can(*names))


class GraphMachine(Sequence):
    """The rules."""

    # Ticks

    @rule(ticks=st.integers(1, 40))
    @there("simulator", "controller")
    @acts
    def step(self, ticks: int) -> None:
        """Tick by tick."""
        self.at(ticks)

    @rule(ticks=TICKS, seed=st.sampled_from(SEEDS))
    @precondition(lambda self: self.model.can_begin)
    @acts
    def reset(self, ticks: int, seed: int) -> None:
        """Another episode in the middle of one."""
        self.at(ticks)
        before = self.graph.episode.episode
        assert self.reset_to(seed) == before + 1

    @rule()
    @there("simulator", "controller")
    @acts
    def resume(self) -> None:
        """To the episode's end; another one may begin by itself."""
        self.at(0)
        graph, number = self.graph, self.graph.episode.episode
        if graph.is_running:
            graph.pause(False)
            graph.wait(f"the end of episode {number}", lambda: number in graph.ended)
            graph.pause(True)
            self.model.is_spoiled = True

    # Policies

    @rule(name=st.sampled_from([*good(), *bad(), "no such file", ".."]), ticks=TICKS)
    @there("controller")
    @acts
    def load_by_service(self, name: str, ticks: int) -> None:
        """A good, an unfit or a forged policy, by an operator."""
        self.at(ticks)
        answer = self.graph.answer("load_policy", policy=str(self.graph.folder / "policies" / name))
        assert answer.success == (name in good()), answer
        if answer.success:
            assert answer.version == version_of(name)
            self.model.pending.append((answer.version, False))
            self.model.accepted += 1
        else:
            assert answer.message
            self.model.refused += 1

    @rule(name=st.sampled_from([*good(), *bad(), "another version"]), ticks=TICKS)
    @there("controller")
    @acts
    def load_by_topic(self, name: str, ticks: int) -> None:
        """The same from a stranger; `another version`: a sound one under a name that is not its own."""
        self.at(ticks)
        model, graph = self.model, self.graph
        data = {**good(), **bad()}.get(name) or good()["one"]
        version = version_of(name) if name in good() else "x"
        with graph.publishing("policy") as publisher:
            publisher.publish(PolicyWeights(version=version, source="a stranger", data=data))
            if model.swap_at == "never":
                graph.spin(IGNORED_SECONDS)
            elif name in good():
                model.pending.append((version, model.swap_at == "episode"))
                model.accepted += 1
                graph.wait("the policy accepted", lambda: graph.count("accepted policy") >= model.accepted)
            else:
                model.refused += 1
                graph.wait("the policy refused", lambda: len(graph.refused_policies) >= model.refused)

    # Parameters

    @rule(what=st.sampled_from(GOOD), ticks=TICKS, moving=st.booleans())
    @there("controller", "simulator")
    @acts
    def set_good(self, what: tuple[str, float], ticks: int, moving: bool) -> None:
        """A dynamic parameter within its bounds; `moving`: the robot goes on before and after."""
        self.at(ticks)
        (name, value), graph, now = what, self.graph, self.graph.turn
        moving = moving and graph.is_running and not self.model.is_spoiled
        if moving:
            graph.pause(False)
        assert not graph.refusals(DYNAMIC[name], {name: value}, HANG_AFTER)
        self.model.values[name] = value
        if moving:
            self.model.is_spoiled = True
            after = max(graph.turn, (now[0], now[1] + 3))
            graph.wait("ticks after the change", lambda: graph.turn > after or not graph.is_running)
            graph.pause(True)

    @rule(what=st.sampled_from(BAD), ticks=TICKS, beside=st.booleans())
    @there(*NODES)
    @acts
    def set_bad(self, what: tuple[str, str, Any], ticks: int, beside: bool) -> None:
        """Out of range, of the wrong type, read-only or unknown; `beside`: at once with a good one, all or nothing."""
        self.at(ticks)
        node, name, value = what
        own = [each for each, owner in DYNAMIC.items() if owner == node and each != name]
        together = {own[0]: 2.0} if beside and own else {}
        assert self.graph.refusals(node, {**together, name: value}, HANG_AFTER, atomically=bool(together))

    # Nodes

    @rule(node=st.sampled_from((*NODES, SECOND)), ticks=TICKS, moving=st.booleans())
    @acts
    def kill(self, node: str, ticks: int, moving: bool) -> None:
        """SIGKILL; `moving`: as the robot goes on."""
        if node in self.model.away:
            return
        self.at(ticks)
        self._away(node, lambda: self.graph.processes.kill((node,)), moving, RECORDING_END)

    @rule(node=st.sampled_from((*NODES, SECOND)), ticks=TICKS, moving=st.booleans())
    @acts
    def terminate(self, node: str, ticks: int, moving: bool) -> None:
        """SIGTERM."""
        if not self.model.can(node):
            return
        self.at(ticks)
        self._away(node, lambda: self.graph.terminate(node), moving, 0.0)

    def _away(self, node: str, end: Callable[[], None], moving: bool, may_lose: float) -> None:
        until = time.monotonic() - may_lose
        self.model.away.add(node)
        self._as_it_moves(end, moving)
        self.model.stopped.discard(node)
        self.model.is_spoiled |= node in ("simulator", "controller")
        self.check_left(node, until)

    def _as_it_moves(self, fault: Callable[[], None], moving: bool) -> None:
        """The fault comes between two ticks, or just after the robot was let go."""
        graph, model = self.graph, self.model
        if moving and model.can("simulator"):
            graph.let_go()
            model.is_spoiled = True
        fault()
        if moving and model.can("simulator"):
            graph.pause(True)

    @rule(node=st.sampled_from((*NODES, SECOND)))
    @acts
    def start_again(self, node: str) -> None:
        """A node that is away, or a second recorder that comes late."""
        if node in self.model.away:
            self.start(node)

    @rule()
    @precondition(lambda self: {"recorder", SECOND} <= self.model.away)
    @acts
    def start_two_recorders(self) -> None:
        """At once, with one path."""
        self.graph.start("recorder")
        self.start(SECOND)
        self.model.away.discard("recorder")
        self.graph.wait("the recorder to speak", lambda: "recorder" in self.graph.said)

    @rule(node=st.sampled_from(NODES), ticks=TICKS, moving=st.booleans())
    @acts
    def stop(self, node: str, ticks: int, moving: bool) -> None:
        """SIGSTOP."""
        if not self.model.can(node):
            return
        self.at(ticks)
        self.model.stopped.add(node)
        self._as_it_moves(lambda: self.graph.processes.send(node, signal.SIGSTOP), moving)

    @rule(node=st.sampled_from(NODES))
    @acts
    def go_on(self, node: str) -> None:
        """SIGCONT."""
        if node in self.model.stopped:
            self.let_go(node)

    # Disk

    @rule(node=st.sampled_from(WRITERS), ticks=TICKS)
    @acts
    def fill_disk(self, node: str, ticks: int) -> None:
        """Of a node that writes; it goes on without."""
        if not self.model.can(node) or node in self.model.full:
            return
        self.at(ticks)
        self.model.full[node] = time.monotonic() - RECORDING_END
        self.graph.limit_files(node, 0)

    @rule(node=st.sampled_from(WRITERS), ticks=TICKS)
    @acts
    def free_disk(self, node: str, ticks: int) -> None:
        """What has ended on a full disk does not begin again by itself."""
        if node in self.model.full and self.model.can(node):
            self.at(ticks)
            self.graph.limit_files(node, resource.RLIM_INFINITY)

    # Strangers

    @rule(
        topic=st.sampled_from([topic.name for topic in TOPICS]),
        how=st.sampled_from(sorted(LIES)),
        seed=st.integers(0, 1000),
        ticks=TICKS,
        stays=st.booleans(),
    )
    @acts
    def lie(self, topic: str, how: str, seed: int, ticks: int, stays: bool) -> None:
        """A wrong message; `stays`: so does its publisher, and whoever comes later hears what is latched."""
        self.at(ticks)
        newest = self.graph.newest.get(topic)
        if newest is None or (topic == "policy" and how != "cut"):  # a sound policy is none of these
            return
        self.graph.lie(topic, LIES[how](random.Random(seed), newest, TOPIC[topic].type), stays)
        self.model.is_spoiled = True

    @rule()
    @precondition(lambda self: self.model.can(*NODES))
    @acts
    def walk_beside(self) -> None:
        """Another walk in this namespace is refused."""
        command = ["rabbit", "walk", "--namespace", self.graph.namespace, "--out", str(self.graph.folder / "beside")]
        done = subprocess.run(command, capture_output=True, text=True, timeout=HANG_AFTER, check=False)
        assert done.returncode == ExitCode.REFUSED, done.stdout + done.stderr
        assert self.graph.namespace in done.stderr

    @rule()
    @acts
    def walk_elsewhere(self) -> None:
        """Another graph, in another namespace."""
        outcome, torques = self.graph.walk_elsewhere()
        assert outcome == "walked"
        assert torques
        expected = torques_of(ZERO, SEEDS[0], 0.0)
        assert torques == {tick: expected[tick] for tick in torques}

"""Hostile messages on every topic that a running node hears, hostile requests to every service that it has.

Both are found by the graph's own introspection. Afterwards all nodes answer every service, and a walk is completed.
"""

import random
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from hostile_messages import hostile, hostile_request, type_named
from hypothesis import settings
from rabbit_common.ros.services import call_service
from rabbit_msgs.msg import Episode
from rcl_interfaces.msg import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data

from .conftest import SHORT

SEGWAY = Path(__file__).parents[2] / "examples" / "segway.py"
SENT = 20_000 if settings().max_examples > 1000 else 400  # of the profile that `make fuzz` chooses
STRANGER = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)  # every reader takes what it sends
HANGS = 600.0  # s, in which nodes start and answer on a busy machine, also while they learn: a guard, no bar
AT_ONCE = 4  # requests that wait for their answer
REQUESTS = 0.2  # of all that is sent


class Stranger:
    """Sends what it likes to the nodes of these names, and knows what a sound message is from what it hears."""

    def __init__(self, world: Any, nodes: list[str]) -> None:
        self._world, self._node, where = world, world.node, f"/{world.namespace}"
        ends = dict[str, list[Any]]()

        def are_known() -> bool:
            before = dict(ends)
            for name in nodes:
                ends[name] = self._node.get_subscriber_names_and_types_by_node(name, where)
                ends[f"{name} serves"] = self._node.get_service_names_and_types_by_node(name, where)
            world.spin(1.0)
            return ends == before and all(ends.values())

        known = set(nodes)
        there = self._node.get_node_names_and_namespaces
        world.wait(lambda: known <= {name for name, _ in there()} and are_known(), HANGS)
        heard = [end for name in nodes for end in ends[name]]
        served = [service for name in nodes for service in ends[f"{name} serves"]]
        self.topics = {name: type_named(kinds[0]) for name, kinds in heard}
        self.services = {name: type_named(kinds[0]) for name, kinds in served}
        self._newest, self._sent = dict.fromkeys(self.topics, b""), set[bytes]()
        self._readers = [
            self._node.create_subscription(kind, name, partial(self._on_bytes, name), qos_profile_sensor_data, raw=True)
            for name, kind in self.topics.items()
        ]
        self._clients = {name: self._node.create_client(kind, name) for name, kind in self.services.items()}
        self._before = {name: self._parameters(name) for name in nodes}

    def _on_bytes(self, name: str, data: bytes) -> None:
        if data not in self._sent:
            self._newest[name] = data

    def sends(self, number: int, seed: int) -> None:
        """So many messages and requests, each of which must be answered."""
        rng, answers = random.Random(seed), list[tuple[str, Any]]()
        publishers = {name: self._node.create_publisher(kind, name, STRANGER) for name, kind in self.topics.items()}
        self._world.spin(1.0)
        for count in range(number):
            if rng.random() < REQUESTS:
                name = rng.choice(sorted(self._clients))
                answers.append((name, self._clients[name].call_async(hostile_request(rng, self.services[name]))))
                self._await(answers, AT_ONCE)
            else:
                name = rng.choice(sorted(publishers))
                data = hostile(rng, self.topics[name], self._newest[name])
                self._sent.add(data)
                publishers[name].publish(data)
            if count % 20 == 0:
                self._world.spin(0.01)
        self._await(answers, 0)
        for publisher in publishers.values():
            self._node.destroy_publisher(publisher)

    def _await(self, answers: list[tuple[str, Any]], most: int) -> None:
        """Until no more than so many requests are open."""

        def is_answered() -> bool:
            answers[:] = [answer for answer in answers if not answer[1].done()]
            return len(answers) <= most

        try:
            self._world.wait(is_answered, HANGS)
        except AssertionError as error:
            raise AssertionError(f"no answer from {[name for name, _ in answers]}") from error

    def makes_good(self) -> None:
        """Put back the parameters that it set; every node answers every service."""
        for name, before in self._before.items():
            now = self._parameters(name)
            changed = [parameter for parameter in before if parameter not in now]
            assert all(result.successful for result in self.ask(f"{name}/set_parameters", parameters=changed).results)
        for name in self._clients:
            self.ask(name)

    def ask(self, name: str, **fields: Any) -> Any:
        """The answer of a service."""
        path = name if name.startswith("/") else f"/{self._world.namespace}/{name}"
        answer = call_service(self._clients[path], self.services[path].Request(**fields), self._world.spin, HANGS)
        assert answer is not None, f"no answer from {name}"
        return answer

    def _parameters(self, node: str) -> list[Parameter]:
        """Of a node, those that may change."""
        names = self.ask(f"{node}/list_parameters").result.names
        described = self.ask(f"{node}/describe_parameters", names=names).descriptors
        names = [parameter.name for parameter in described if not parameter.read_only]
        values = self.ask(f"{node}/get_parameters", names=names).values if names else []
        return [Parameter(name=name, value=value) for name, value in zip(names, values, strict=True)]


def faults(world: Any) -> list[str]:
    """Refusals of which a node says that it met a fault of its own."""
    said = [value.key for m in world.hear("diagnostics") for status in m.status for value in status.values]
    return sorted({key for key in said if "fault of this node" in key})


@pytest.mark.timeout(3600)
def test_the_graph_of_a_walk(world: Any) -> None:
    world.start("simulator", sensors="lab", episodes=0, **SHORT)
    world.start("estimator")
    world.start("controller", controller="rl-cbf-clf-qp")
    world.start("trainer", plan_episodes=False, hidden1=4, hidden2=4, batch=4, updates_least=1, capacity=500)
    world.start("recorder", path=str(world.folder / "recording"))
    world.start("viewer", port=0, browser=False, control=True)
    nodes = ["simulator", "estimator", "controller", "trainer", "recorder", "viewer"]
    world.go()
    stranger = Stranger(world, nodes)
    stranger.sends(SENT, seed=1)
    stranger.makes_good()
    assert stranger.ask("load_policy", policy="zero").success
    stranger.ask("pause", data=False)
    walked = stranger.ask("reset_episode", seed=1)
    assert walked.success
    end = world.ended(walked.episode)
    assert (end.outcome, end.reason) == ("walked", "")
    assert faults(world) == []


@pytest.mark.timeout(3600)
def test_the_graph_of_a_task(world: Any) -> None:
    episodes, nodes = world.hear("episode"), ["simulator", "controller", "trainer"]
    world.start_task("controller", SEGWAY)
    world.start_task("trainer", SEGWAY, folder=world.folder / "learned")
    world.start_task("simulator", SEGWAY, episodes=100_000, readers=2, trainer="follow")
    stranger = Stranger(world, nodes)
    stranger.sends(SENT, seed=1)
    stranger.makes_good()
    assert stranger.ask("load_policy", policy="zero").success
    episodes.clear()
    world.wait(lambda: any((e.phase, e.outcome) == (Episode.ENDED, "done") for e in episodes))
    assert faults(world) == []

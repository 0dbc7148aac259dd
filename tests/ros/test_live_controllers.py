"""Whom the simulator waits for: a controller that comes in the middle of a wait is not taken for the dead one."""

import time

import pytest
from rabbit_sim.ros.live_controllers import DEAD_SECONDS, LiveControllers


class Publisher:
    """An end point of the graph."""

    def __init__(self, name: bytes) -> None:
        self.endpoint_gid = list(name)


class Graph:
    """The node and the subscription that `LiveControllers` look at."""

    topic_name = "torque"

    def __init__(self) -> None:
        self.names: list[bytes] = []

    def get_publisher_count(self) -> int:
        return len(self.names)

    def get_publishers_info_by_topic(self, topic: str) -> list[Publisher]:
        return [Publisher(name) for name in self.names]


def answerers(graph: Graph) -> LiveControllers:
    """Over a graph that is none."""
    return LiveControllers(graph, graph)  # type: ignore[arg-type]


def test_who_was_asked_and_said_nothing_is_not_waited_for() -> None:
    graph = Graph()
    they = answerers(graph)
    assert not they.any
    graph.names = [b"old"]
    assert they.any
    they.asked_again()
    they.said_nothing()
    assert not they.any
    they.spoke()
    assert they.any


def test_who_comes_during_the_wait_keeps_its_chance_when_the_dead_one_goes() -> None:
    graph = Graph()
    they = answerers(graph)
    graph.names = [b"dead"]
    they.asked_again()
    graph.names = [b"dead", b"new"]
    they.asked_again()
    they.said_nothing()
    assert they.any
    graph.names = [b"new"]  # the graph forgets the dead one
    assert they.any


def test_who_goes_and_comes_back_is_asked_again() -> None:
    graph = Graph()
    they = answerers(graph)
    graph.names = [b"one"]
    they.said_nothing()
    assert not they.any
    graph.names = []
    assert not they.any
    graph.names = [b"one"]
    assert they.any


def test_who_is_there_when_a_dead_one_is_forgotten_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was late once, and nobody asks it: it would be waited for without end."""
    graph = Graph()
    they = answerers(graph)
    graph.names = [b"late"]
    they.said_nothing()
    assert not they.any
    over = time.monotonic() + DEAD_SECONDS
    monkeypatch.setattr(time, "monotonic", lambda: over)
    assert they.any

"""Two simulators in one graph: the first one is followed, the second one gives way, and both are named."""

from typing import Any

import numpy as np
import pytest
from rabbit_msgs.msg import Episode, RobotState
from std_srvs.srv import SetBool

from .conftest import SHORT


def start_second(world: Any, name: str = "second", kind: str = "simulator", package: str = "rabbit_sim") -> None:
    """Another one comes; its service is `second_pause`."""
    space = ("--ros-args", "-r", f"__ns:=/{world.namespace}", "-r", "pause:=second_pause")
    world.processes.start(name, space, kind, package)
    world.wait(lambda: "another simulator plays" in log_of(world, name))


def refusals(world: Any, node: str) -> list[str]:
    """What a node says that it refused."""
    statuses = [s for m in world.hear("diagnostics") for s in m.status if s.name.endswith(f"/{node}")]
    return [value.key for status in statuses for value in status.values if value.key.startswith("refused")]


def log_of(world: Any, name: str) -> str:
    """Its log so far."""
    return (world.folder / "log" / f"{name}.log").read_text()


def test_the_first_one_walks_on_and_the_second_one_plays_nothing(make_world: Any) -> None:
    alone, world = make_world("alone"), make_world("two")
    for each in (alone, world):
        each.hear("state"), each.hear("episode")
        each.start("simulator", seed=5, pace=1.0, **SHORT)
        each.start("controller")
    alone.go()
    world.go()
    world.wait(lambda: len(world.hear("state")) > 20)
    world.ask(SetBool, "pause", data=True)  # holds the robot while the second one starts
    start_second(world)
    assert world.ask(SetBool, "second_pause", data=False).message.startswith("another simulator plays: ")
    world.ask(SetBool, "pause", data=False)
    for each in (alone, world):
        each.wait(lambda each=each: each.hear("episode")[-1].phase == Episode.ENDED)
    expected, got = alone.hear("episode")[-1], world.hear("episode")[-1]
    assert (got.outcome, got.tick) == (expected.outcome, expected.tick)
    states = [[s.applied for s in each.hear("state") if s.tick] for each in (alone, world)]
    np.testing.assert_array_equal(states[0], states[1])
    first, second = sorted({e.sender for e in world.hear("episode")})
    assert got.sender == first
    assert {s.sender for s in world.hear("state")} == {first}
    assert f"{first} began first; this is {second}" in log_of(world, "second")
    assert f"{second} is refused; {first} is followed" in log_of(world, "simulator")
    assert f"another simulator: {second}; {first} is followed" in log_of(world, "controller")
    world.wait(lambda: "refused episode: another simulator" in refusals(world, "controller"))


@pytest.mark.parametrize("stopped", ["kill", "stop"])
def test_one_that_comes_in_the_place_of_another_is_followed(world: Any, stopped: str) -> None:
    """Whether that was killed or ended itself; it says WAITING once."""
    episodes, states = world.hear("episode"), world.hear("state")
    world.start("simulator", pace=1.0, **SHORT)
    world.start("controller")
    world.go()
    world.wait(lambda: len(states) > 20)
    getattr(world.processes, stopped)(("simulator",))
    world.start("simulator", **SHORT)
    world.wait(lambda: episodes[-1].phase == Episode.WAITING)
    world.go()
    world.wait(lambda: episodes[-1].phase == Episode.ENDED and episodes[-1].sender != states[0].sender)
    assert (episodes[-1].outcome, episodes[-1].episode) == ("walked", 1)


def test_a_strangers_simulator_without_a_name_is_refused_and_ends_no_walk(world: Any) -> None:
    episodes, states = world.hear("episode"), world.hear("state")
    world.start("simulator", pace=1.0, **SHORT)
    world.start("controller")
    world.go()
    world.wait(lambda: len(states) > 20)
    world.ask(SetBool, "pause", data=True)
    for phase in (Episode.WAITING, Episode.RUNNING):
        world.say("episode", Episode(episode=phase, phase=phase))
    world.say("state", RobotState(episode=1, tick=0, q=[0.0] * 7, dq=[0.0] * 7, running=True))
    expected = {f"refused {topic}: another simulator" for topic in ("episode", "state")}
    world.wait(lambda: expected <= set(refusals(world, "controller")))
    world.ask(SetBool, "pause", data=False)
    world.wait(lambda: any(e.phase == Episode.ENDED for e in episodes))
    assert next(e for e in episodes if e.phase == Episode.ENDED).outcome == "walked"


def test_a_bridge_beside_a_simulator_is_not_enabled_before_that_has_left(world: Any) -> None:
    world.start("simulator", **SHORT)
    world.wait(lambda: bool(world.hear("episode")))
    start_second(world, "bridge", "ros2_control", "rabbit_bringup")
    assert world.ask(SetBool, "second_pause", data=False).message.startswith("another simulator plays: ")
    world.processes.stop(("simulator",))
    world.wait(lambda: "plays on" in log_of(world, "bridge"))
    assert world.ask(SetBool, "second_pause", data=False).message.startswith("no sensors: ")
    assert "ros2_control" in world.hear("episode")[-1].sender

"""Two controllers or simulators in one graph: one acts, the other is refused, and both are named."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from rabbit_bringup.launching.walk_report import line
from rabbit_msgs.msg import Episode, RobotState, TorqueCommand
from rabbit_recording.checking import check_episodes
from std_srvs.srv import SetBool

from .conftest import SHORT

OTHER = ("-r", "__node:=other", "-p", "eps:=0.5")  # other gains


def applied(world: Any, number: int) -> np.ndarray:
    """The torques that acted in an episode, (ticks, 4)."""
    return np.array([s.applied for s in world.hear("state") if s.episode == number and s.tick > 0])


def start_other(world: Any) -> None:
    """A controller with other gains comes into the same namespace, while the robot is held."""
    world.ask(SetBool, "pause", data=True)
    world.processes.start("other", (*world.space, *OTHER), kind="controller")
    world.wait(lambda: "other" in world.node.get_node_names())
    world.wait(lambda: bool(world.statuses("other")))
    world.spin(0.5)
    world.ask(SetBool, "pause", data=False)


def begin(world: Any, **simulator: Any) -> None:
    """One real controller and a simulator that waits."""
    for name in ("state", "torque", "episode", "controller_state", "learner_terms", "controller_settings"):
        world.hear(name)
    world.start("simulator", **{**SHORT, **simulator})
    world.start("controller")


def test_one_law_walks_and_the_result_names_both(make_world: Callable[[str], Any]) -> None:
    alone, world = make_world("alone"), make_world("two")
    begin(alone, seed=5, episodes=2)
    alone.go()
    begin(world, seed=5, episodes=2, pace=1.0)
    path = world.folder / "recording"
    world.start("recorder", path=str(path))
    world.go()
    world.wait(lambda: len(world.hear("state")) > 20)
    start_other(world)  # in the middle of the first episode
    for number in (1, 2):
        expected, got = alone.ended(number), world.ended(number)
        assert (got.outcome, got.tick) == (expected.outcome, expected.tick)
        world.wait(lambda number=number, got=got: len(applied(world, number)) == got.tick)
        np.testing.assert_array_equal(applied(world, number), applied(alone, number))
        assert got.controller.split()[0] == f"/{world.namespace}/controller"
        assert expected.refused_controller == ""
        assert "two controllers" not in line(expected)
    last = world.ended(2)
    assert last.refused_controller.split()[0] == f"/{world.namespace}/other"
    assert last.controller in line(last)
    assert last.refused_controller in line(last)
    senders = {command.sender for command in world.hear("torque")}
    assert senders == {last.controller, last.refused_controller}
    world.processes.stop(("simulator", "recorder"))
    checked = list(check_episodes(path))
    assert [(c.episode.outcome, c.episode.lost, c.differing) for c in checked] == [("walked", 0, [])] * 2
    assert checked[1].episode.refused_controller == last.refused_controller
    recorded = [record.output.torque for record in checked[1].episode.records]
    np.testing.assert_array_equal(recorded, applied(world, 2))


def test_another_controller_does_not_go_on_for_a_killed_one(world: Any) -> None:
    begin(world, episodes=2, pace=1.0)
    world.go()
    world.wait(lambda: len(world.hear("state")) > 20)
    start_other(world)
    world.wait(lambda: any(e.refused_controller for e in world.hear("episode")))
    world.processes.kill(("controller",))
    first = world.ended(1)
    assert first.outcome == "fault"
    assert first.reason.startswith(first.refused_controller)
    assert first.controller[:80] in first.reason
    second = world.ended(2)
    assert second.controller == first.refused_controller
    own = {c.tick: c.torque for c in world.hear("torque") if c.episode == 2}
    np.testing.assert_array_equal(applied(world, 2), [own[tick] for tick in range(second.tick)])


@pytest.mark.parametrize("name", ["", "/mine 7"])
def test_a_controller_of_a_users_own_is_alone_too(world: Any, name: str) -> None:
    """The test plays one that answers with a PD law; a real one comes in beside it. The empty name is a name too."""
    states, episodes = world.hear("state"), world.hear("episode")
    world.start("simulator", start_paused=False, **{**SHORT, "stones": 1})
    world.say("torque", TorqueCommand(sender=name))
    world.wait(lambda: bool(states))
    world.say("torque", TorqueCommand(episode=1, tick=0, torque=[0.0] * 4, sender=name))
    world.wait(lambda: len(states) > 1)
    world.start("controller")
    world.spin(0.1)
    while not any(e.phase == Episode.ENDED for e in episodes):
        state = states[-1]
        world.say("torque", TorqueCommand(episode=1, tick=state.tick, torque=[1.0, 0.0, 1.0, 0.0], sender=name))
        world.wait(lambda state=state: states[-1].tick > state.tick or episodes[-1].phase == Episode.ENDED)
    said = [list(s.applied) for s in states if s.tick > 1]
    assert said == [[1.0, 0.0, 1.0, 0.0]] * len(said)
    assert episodes[-1].controller == name


def test_two_controllers_without_a_name_end_the_episode(world: Any) -> None:
    """Nobody can tell them apart, and two laws may not be mixed; the same answer twice is one controller's."""
    states, episodes = world.hear("state"), world.hear("episode")
    world.start("simulator", start_paused=False, stones=1)
    world.say("torque", TorqueCommand())
    world.wait(lambda: bool(states))

    def answer(tick: int, torque: float) -> None:
        world.say("torque", TorqueCommand(episode=1, tick=tick, torque=[torque, 0.0, 0.0, 0.0]))

    for tick in range(3):
        answer(tick, 1.0)
        answer(tick, 1.0)
        world.wait(lambda tick=tick: states[-1].tick > tick)
    answer(2, 2.0)
    world.wait(lambda: episodes[-1].phase == Episode.ENDED)
    assert (episodes[-1].outcome, episodes[-1].tick) == ("fault", 3)
    assert "two controllers without a name" in episodes[-1].reason


def start_second(world: Any, name: str = "second", kind: str = "simulator", package: str = "rabbit_sim") -> None:
    """Another one comes; its service is `second_pause`."""
    world.processes.start(name, (*world.space, "-r", "pause:=second_pause"), kind, package)
    world.wait(lambda: "another simulator plays" in world.log(name))


def test_the_first_one_walks_on_and_the_second_one_plays_nothing(make_world: Any) -> None:
    alone, world = make_world("alone"), make_world("two")
    for graph in (alone, world):
        graph.hear("state"), graph.hear("episode")
        graph.start("simulator", seed=5, pace=1.0, **SHORT)
        graph.start("controller")
    alone.go()
    world.go()
    world.wait(lambda: len(world.hear("state")) > 20)
    world.ask(SetBool, "pause", data=True)  # holds the robot while the second one starts
    start_second(world)
    assert world.ask(SetBool, "second_pause", data=False).message.startswith("another simulator plays: ")
    world.ask(SetBool, "pause", data=False)
    expected, got = alone.ended(), world.ended()
    assert (got.outcome, got.tick) == (expected.outcome, expected.tick)
    states = [[s.applied for s in graph.hear("state") if s.tick] for graph in (alone, world)]
    np.testing.assert_array_equal(states[0], states[1])
    first, second = sorted({e.sender for e in world.hear("episode")})
    assert got.sender == first
    assert {s.sender for s in world.hear("state")} == {first}
    assert f"{first} began first; this is {second}" in world.log("second")
    assert f"{second} is refused; {first} is followed" in world.log("simulator")
    assert f"another simulator: {second}; {first} is followed" in world.log("controller")
    world.wait(lambda: "refused episode: another simulator" in world.refused("controller"))


@pytest.mark.parametrize("stopped", ["kill", "stop"])
def test_one_that_comes_in_the_place_of_another_is_followed(world: Any, stopped: str) -> None:
    """Whether that was killed or ended itself; it says WAITING once."""
    episodes, states = world.hear("episode"), world.hear("state")
    world.walk(pace=1.0, **SHORT)
    world.wait(lambda: len(states) > 20)
    getattr(world.processes, stopped)(("simulator",))
    world.start("simulator", **SHORT)
    world.wait(lambda: episodes[-1].phase == Episode.WAITING)
    world.go()
    world.wait(lambda: episodes[-1].phase == Episode.ENDED and episodes[-1].sender != states[0].sender)
    assert (episodes[-1].outcome, episodes[-1].episode) == ("walked", 1)


def test_a_strangers_simulator_without_a_name_is_refused_and_ends_no_walk(world: Any) -> None:
    states = world.hear("state")
    world.walk(pace=1.0, **SHORT)
    world.wait(lambda: len(states) > 20)
    world.ask(SetBool, "pause", data=True)
    for phase in (Episode.WAITING, Episode.RUNNING):
        world.say("episode", Episode(episode=phase, phase=phase))
    world.say("state", RobotState(episode=1, tick=0, q=[0.0] * 7, dq=[0.0] * 7, running=True))
    expected = {f"refused {topic}: another simulator" for topic in ("episode", "state")}
    world.wait(lambda: expected <= world.refused("controller").keys())
    world.ask(SetBool, "pause", data=False)
    assert world.ended().outcome == "walked"


def test_a_bridge_beside_a_simulator_is_not_enabled_before_that_has_left(world: Any) -> None:
    world.start("simulator", **SHORT)
    world.wait(lambda: bool(world.hear("episode")))
    start_second(world, "bridge", "ros2_control", "rabbit_bringup")
    assert world.ask(SetBool, "second_pause", data=False).message.startswith("another simulator plays: ")
    world.processes.stop(("simulator",))
    world.wait(lambda: "plays on" in world.log("bridge"))
    assert world.ask(SetBool, "second_pause", data=False).message.startswith("no sensors: ")
    assert "ros2_control" in world.hear("episode")[-1].sender

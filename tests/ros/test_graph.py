"""Any order of start, two graphs side by side, services, and messages that do not belong."""

import itertools
import math
import resource
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rabbit_common.ros.conversions import preview_of, state_of
from rabbit_description.gait import load_gait
from rabbit_msgs.msg import Episode, PolicyWeights, TorqueCommand
from rabbit_msgs.srv import ResetEpisode
from rcl_interfaces.srv import DescribeParameters, SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from std_srvs.srv import SetBool

from .conftest import SHORT


def torques(world: Any, messages: list[TorqueCommand], ended: Episode) -> Any:
    """All torques of an ended episode as one array, in order of their ticks; its end may be heard before the last."""
    world.wait(lambda: len(messages) == ended.tick)
    assert [message.tick for message in messages] == list(range(len(messages)))
    return np.array([message.torque for message in messages])


@pytest.mark.parametrize("order", list(itertools.permutations(("simulator", "controller", "trainer"))), ids="-".join)
def test_nodes_start_in_any_order(world: Any, order: tuple[str, ...]) -> None:
    episodes, transitions = world.hear("episode"), world.hear("transition")
    for name in order:
        world.start(name, **({**SHORT, "stones": 1, "trainer": "wait"} if name == "simulator" else {}))
        world.spin(0.3)
    world.go()
    world.ended()
    assert episodes[-1].outcome == "walked"
    world.wait(lambda: len(transitions) == episodes[-1].tick)


def test_pause_holds_between_two_ticks_and_changes_nothing(world: Any) -> None:
    states, commands, episodes = world.hear("state"), world.hear("torque"), world.hear("episode")
    world.start("simulator", episodes=0, pace=2.0, **SHORT)
    assert world.ask(ResetEpisode, "reset_episode", seed=3).message == "there is no controller"
    world.start("controller")
    world.go()
    assert world.ask(ResetEpisode, "reset_episode", seed=3).success
    assert world.ask(SetBool, "pause", data=True).success
    world.spin(0.5)
    held = len(states)
    assert episodes[-1].phase == Episode.PAUSED
    world.spin(0.5)
    assert len(states) == held
    world.ask(SetBool, "pause", data=False)
    first = torques(world, commands, world.ended())
    commands.clear()
    world.ask(SetBool, "pause", data=True)
    assert world.ask(ResetEpisode, "reset_episode", seed=3).episode == 2
    world.wait(lambda: episodes[-1].episode == 2 and episodes[-1].phase == Episode.PAUSED)
    world.ask(SetBool, "pause", data=False)
    np.testing.assert_array_equal(torques(world, commands, world.ended(2)), first)


def test_wrong_messages_are_refused_counted_and_told(world: Any) -> None:
    states, episodes = world.hear("state"), world.hear("episode")
    world.start("simulator", answer_timeout=4.0, start_paused=False, **SHORT)
    world.say("torque", TorqueCommand())  # the test plays the controller; this one is for no episode at all
    world.wait(lambda: bool(states))
    for episode, tick, value in ((7, 0, 0.0), (1, 1, 0.0), (1, 0, math.nan), (1, 0, math.inf)):
        world.say("torque", TorqueCommand(episode=episode, tick=tick, torque=[value] * 4))
    world.wait(lambda: sum(world.refused("simulator").values()) == 5)
    counts = world.refused("simulator")
    assert counts["refused torque: wrong episode"] + counts.get("refused torque: not awaited", 0) == 2
    assert (counts["refused torque: wrong tick"], counts["refused torque: not finite"]) == (1, 2)
    assert any("refused" in status.message for status in world.statuses("simulator"))
    world.say("torque", TorqueCommand(episode=1, tick=0, torque=[0.0] * 4))
    world.wait(lambda: states[-1].tick == 1)
    world.ended()
    assert episodes[-1].outcome == "silent"
    assert "tick 1" in episodes[-1].reason


def test_a_message_of_any_size_leaves_no_memory_taken(world: Any) -> None:
    """The largest that a stranger sends is refused unread, and its memory given back."""
    world.start("controller")
    world.say("episode", Episode())
    world.wait(lambda: bool(world.statuses("controller")))
    before = resident_bytes(world.processes.pid("controller"))
    size = 50_000_000
    world.say("episode", Episode(reason="x" * size))
    world.say("policy", PolicyWeights(data=bytes(size)))
    world.wait(lambda: {"refused episode: too large", "refused policy: not fit"} <= world.refused("controller").keys())
    world.wait(lambda: resident_bytes(world.processes.pid("controller")) < before + size / 4)


def resident_bytes(pid: int) -> int:
    """Of a process."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * resource.getpagesize()


def test_a_dead_controller_ends_the_episode_and_a_new_one_walks(world: Any) -> None:
    states, episodes = world.hear("state"), world.hear("episode")
    world.walk(episodes=2, answer_timeout=3.0, pace=1.0, **SHORT)
    world.wait(lambda: len(states) > 20)
    world.processes.kill(("controller",))
    world.ended()
    assert episodes[-1].outcome == "silent"
    world.start("controller")
    world.ended(2)
    assert episodes[-1].outcome == "walked"


def test_parameters_are_described_bounded_and_read_only(world: Any) -> None:
    world.start("simulator", episodes=0)
    names = ["mass_scale", "pace", "plant", "stones"]
    scale, pace, plant, stones = world.ask(DescribeParameters, "simulator/describe_parameters", names=names).descriptors
    assert scale.description
    assert (scale.floating_point_range[0].from_value, scale.floating_point_range[0].to_value) == (0.1, 10.0)
    assert [parameter.read_only for parameter in (scale, pace, plant, stones)] == [True, False, True, True]
    assert "pybullet, rigid" in plant.additional_constraints
    assert stones.integer_range[0].from_value == 1

    def set_one(name: str, value: Any) -> bool:
        parameters = [Parameter(name, value=value).to_parameter_msg()]
        return bool(world.ask(SetParameters, "simulator/set_parameters", parameters=parameters).results[0].successful)

    assert not set_one("mass_scale", 2.0)
    assert not set_one("use_sim_time", True)
    assert not set_one("pace", 1000.0)
    assert set_one("pace", 1.0)


def test_gains_change_in_the_middle_of_a_walk(world: Any) -> None:
    """Torques are those of a controller in process that takes the same gains at the ticks which are announced."""
    heard = {topic: world.hear(topic) for topic in ("state", "torque", "preview", "controller_settings", "episode")}
    world.start("simulator", pace=0.3, **SHORT)
    world.start("controller")

    def set_gains(**gains: float) -> Any:
        parameters = [Parameter(name, value=value).to_parameter_msg() for name, value in gains.items()]
        return world.ask(SetParametersAtomically, "controller/set_parameters_atomically", parameters=parameters).result

    world.go()
    for tick, gains in ((20, {"eps": 0.05}), (45, {"torque_limit": 90.0, "barrier_pole_2": 70.0}), (70, {"eps": 0.04})):
        world.wait(lambda tick=tick: any(message.tick >= tick for message in heard["torque"]))
        assert set_gains(**gains).successful
    refused = set_gains(eps=0.1, kp=2.0)
    assert not refused.successful
    assert "kp" in refused.reason
    world.ended()
    said = heard["controller_settings"]
    tunings = [ControllerParameters.model_validate_json(settings.parameters) for settings in said]
    assert [tuning.eps for tuning in tunings] == [0.04, 0.05, 0.05, 0.04]
    first, told = tunings[0], dict(zip([settings.tick for settings in said], tunings, strict=True))
    inside = Controller(first, load_gait(first.gait), ZeroPolicy(first.problem))
    inside.reset(heard["episode"][-1].seed)
    stones = {message.index: preview_of(message) for message in heard["preview"]}
    states = {message.tick: message for message in heard["state"] if message.running}
    for torque in heard["torque"]:
        inside.parameters = told.get(torque.tick, inside.parameters)
        message = states[torque.tick]
        output = inside.step(state_of(message, stones[message.touchdowns + 1] if message.previewed else None))
        np.testing.assert_array_equal(torque.torque, output.torque)


@pytest.mark.parametrize(
    ("node", "parameters", "said"),
    [
        ("simulator", {"masss_scale": 2.0}, "masss_scale: simulator has no parameter"),
        ("simulator", {"gait": "nowhere"}, "gait nowhere: no such file"),
        ("controller", {"policy": "/nowhere"}, "policy /nowhere"),
        ("trainer", {"failure_penalty": 0.5}, "error: failure_penalty > 0: expected learner = paper_ddpg"),
        ("recorder", {"path": "/proc/nowhere"}, "/proc/nowhere"),
    ],
)
def test_parameters_that_cannot_be_used_end_a_node_with_one_line(
    world: Any, node: str, parameters: dict[str, Any], said: str
) -> None:
    world.start(node, **parameters)
    assert world.processes.wait(node, 60.0) == 2
    (line,) = world.log(node).splitlines()
    assert line.startswith("error: ")
    assert said in line

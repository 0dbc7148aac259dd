"""Nodes that come in the middle, are stopped, killed and started again, or are among many others."""

import os
import signal
from contextlib import ExitStack
from typing import Any

import numpy as np
import pytest
import rclpy
from rabbit_msgs.msg import Episode, EpisodePlan
from rabbit_recording.message_header import turn_of
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import SetBool

from .conftest import SHORT

PLANT = {"motor_lag": 0.004, "stones": 3, "sensors": "lab", "gait": "paper_stones"}
PARAMETERS = {"controller": "rl-cbf-clf-qp", "adaptation": "identification", "objective": "pd_centred"}
PARAMETERS |= {"gait": "paper_stones", "stone_margin": 0.01}


def test_an_estimator_that_comes_in_the_middle_says_so_and_the_next_episode_walks(world: Any) -> None:
    states = world.hear("state")
    world.start("simulator", **PLANT, episodes=2, answer_timeout=120.0, pace=1.0)
    world.start("estimator")
    world.start("controller", **PARAMETERS)
    world.go()
    world.wait(lambda: bool(states) and states[-1].tick > 20)
    world.processes.kill(("estimator",))
    world.start("estimator")
    second, (first,) = world.ended(2), world.ends(1)
    assert (first.outcome, second.outcome) == ("fault", "walked")
    assert first.reason == f"the state of tick {first.tick} is not known: see the estimator's log"
    said = world.log("estimator")
    assert f"the estimator came in at tick {first.tick}, in the middle of the episode" in said
    unknown = {m.tick for m in states if m.episode == 1 and np.isnan(m.q).all()}
    assert unknown <= {first.tick}  # or it was said before we heard the new estimator


OTHERS = 40  # more than Fast DDS asks by default, and than the 32 that were asked


def test_nodes_find_each_other_behind_many_others(make_world: Any) -> None:
    with ExitStack() as stack:
        for number in range(OTHERS):  # each is a participant of its own, with the lowest ports that are free
            context = rclpy.Context()
            rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
            stack.callback(rclpy.try_shutdown, context=context)
            other = rclpy.create_node(f"other_{number}", context=context, enable_rosout=False)
            stack.callback(other.destroy_node)
        world = make_world("crowd")
        world.start("simulator", stones=2, motor_lag=0.004)
        world.start("controller", controller="cbf-clf-qp")
        episodes = world.hear("episode")
        world.go()
        world.wait(lambda: any(episode.phase == Episode.ENDED and episode.tick > 0 for episode in episodes))
    assert episodes[-1].outcome == "walked"


STOPS, SECONDS = 12, 2.0


@pytest.mark.timeout(900)
def test_a_recorder_that_was_stopped_catches_up_each_time(world: Any) -> None:
    states = world.hear("state")
    world.walk(records=True, **SHORT, episodes=10_000, pace=0.5)

    def recorded() -> tuple[int, int]:
        episode, tick = world.figures("recorder")["episode, tick"].split()
        return int(episode), int(tick)

    for _ in range(STOPS):
        os.kill(world.processes.pid("recorder"), signal.SIGSTOP)
        world.spin(SECONDS)
        os.kill(world.processes.pid("recorder"), signal.SIGCONT)
        newest = turn_of(serialize_message(states[-1]))
        world.wait(lambda newest=newest: recorded() >= newest, seconds=60.0)


@pytest.mark.timeout(600)
def test_the_broken_episode_ends_under_the_seed_noise_and_policy_it_began_with(world: Any) -> None:
    announced, states = world.hear("episode"), world.hear("state")
    own = {**SHORT, "memory": str(world.folder / "memory"), "episodes": 2, "trainer": "follow", "pace": 1.0}
    world.start("simulator", **own)
    world.start("controller", controller="rl-cbf-clf-qp", swap_at="episode")
    world.say("episode_plan", EpisodePlan(after_episode=0, seed=77, sigma=0.25, policy_version="zero"))
    world.go()
    world.wait(lambda: bool(states) and states[-1].touchdowns >= 1)
    world.processes.kill(("simulator",))
    world.start("simulator", **own)
    ended = world.ended()
    assert (ended.episode, ended.outcome, ended.touchdowns) == (1, "reset", states[-1].touchdowns)
    assert (ended.seed, ended.sigma, ended.policy_version) == (77, 0.25, "zero")
    assert world.ask(SetBool, "pause", data=False).success
    world.say("episode_plan", EpisodePlan(after_episode=1, seed=78, sigma=0.0, policy_version="zero"))
    world.wait(lambda: announced[-1].episode == 2)

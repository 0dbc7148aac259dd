"""Simulator and controller in one process: services, policies and other processes find what they find in a graph."""

from typing import Any

from rabbit_msgs.msg import Episode
from rabbit_msgs.srv import LoadPolicy, Pause, ResetEpisode
from rabbit_recording.checking import check_episodes
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.weights import policy_path, read

LAW = ControllerParameters(controller="rl-cbf-clf-qp")
PLANT = {"motor_lag": 0.004, "mass_scale": 2.0, "stones": 3}
SHIPPED = read(policy_path("rl-cbf-clf-qp"))


def begin(world: Any, **simulator: Any) -> tuple[list[Any], list[Any], list[Any]]:
    """Both in one process, and the recorder; returns states, torques and episodes."""
    heard = world.hear("state"), world.hear("torque"), world.hear("episode")
    world.start("one_process", simulator={**PLANT, **simulator}, controller=LAW.model_dump())
    world.start("recorder", path=str(world.folder / "recording"))
    world.go()
    return heard


def test_pause_reset_and_a_policy_loaded_while_it_walks(world: Any) -> None:
    states, torques, episodes = begin(world, episodes=0, pace=1.0)
    assert world.ask(ResetEpisode, "reset_episode", seed=3).accepted
    world.wait(lambda: bool(states) and states[-1].tick > 20)
    assert world.ask(Pause, "pause", paused=True).accepted
    world.spin(0.3)
    held = len(states)
    assert episodes[-1].phase == Episode.PAUSED
    loaded = world.ask(LoadPolicy, "load_policy", path=str(policy_path("rl-cbf-clf-qp")))
    assert (loaded.accepted, loaded.version) == (True, SHIPPED.version)
    world.spin(0.3)
    assert len(states) == held
    world.ask(Pause, "pause", paused=False)
    world.wait(lambda: torques[-1].policy_version == SHIPPED.version)
    assert torques[held - 2].policy_version == "zero"
    assert world.ask(ResetEpisode, "reset_episode", seed=4).episode == 2
    world.wait(lambda: (episodes[-1].episode, episodes[-1].phase) == (2, Episode.ENDED))
    world.processes.stop(("one_process",))
    world.processes.stop()
    assert episodes[-1].outcome == "walked"
    checked = list(check_episodes(world.folder / "recording"))
    assert [(each.episode.seed, each.episode.lost, each.differing) for each in checked] == [(3, 0, []), (4, 0, [])]


def test_it_walks_in_real_time(world: Any) -> None:
    timing = world.hear("timing")
    states, _, episodes = begin(world, mass_scale=1.0, real_time=True, held_ticks=1000)
    world.wait(lambda: bool(episodes) and episodes[-1].phase == Episode.ENDED)
    assert episodes[-1].outcome == "walked"
    world.wait(lambda: len(timing) == states[-1].tick == episodes[-1].tick)


def test_what_comes_from_elsewhere_on_a_handed_over_topic_is_not_heard(world: Any) -> None:
    """A stranger's torque moves nothing."""
    from rabbit_msgs.msg import TorqueCommand

    _, torques, episodes = begin(world, mass_scale=1.0, pace=1.0)
    stranger = world.node.create_publisher(TorqueCommand, "torque", 10)
    for tick in range(20):
        stranger.publish(TorqueCommand(episode=1, tick=tick, fault="stranger"))
        world.spin(0.05)
    world.wait(lambda: episodes[-1].phase == Episode.ENDED)
    assert episodes[-1].outcome == "walked"
    assert {each.fault for each in torques} == {"", "stranger"}

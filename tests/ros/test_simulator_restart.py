"""A simulator that was killed in an episode and is started again says truly which episode it was that ended."""

from typing import Any

import pytest
from rabbit_msgs.msg import Episode, EpisodePlan
from std_srvs.srv import SetBool

from .conftest import SHORT


@pytest.mark.timeout(600)
def test_the_broken_episode_ends_under_the_seed_noise_and_policy_it_began_with(make_world: Any) -> None:
    world = make_world("memory")
    announced, states = world.hear("episode"), world.hear("state")
    own = {**SHORT, "memory": str(world.folder / "memory"), "episodes": 2, "trainer": "follow", "pace": 1.0}
    world.start("simulator", **own)
    world.start("controller", controller="rl-cbf-clf-qp", swap_at="episode")
    world.say("episode_plan", EpisodePlan(after_episode=0, seed=77, sigma=0.25, policy_version="zero"))
    world.go()
    world.wait(lambda: bool(states) and states[-1].touchdowns >= 1)
    world.processes.kill(("simulator",))
    world.start("simulator", **own)
    world.wait(lambda: announced[-1].phase == Episode.ENDED)
    ended = announced[-1]
    assert (ended.episode, ended.outcome, ended.touchdowns) == (1, "reset", states[-1].touchdowns)
    assert (ended.seed, ended.sigma, ended.policy_version) == (77, 0.25, "zero")
    assert world.ask(SetBool, "pause", data=False).success
    world.say("episode_plan", EpisodePlan(after_episode=1, seed=78, sigma=0.0, policy_version="zero"))
    world.wait(lambda: announced[-1].episode == 2)

"""The state estimator in a graph: what it does when it is late, comes in the middle, or is alone."""

from typing import Any

import numpy as np
from rabbit_msgs.msg import Episode

PLANT = {"motor_lag": 0.004, "stones": 3, "sensors": "lab", "gait": "paper_stones"}
PARAMETERS = {
    **{"controller": "rl-cbf-clf-qp", "adaptation": "identification", "objective": "pd_centred"},
    **{"gait": "paper_stones", "stone_margin": 0.01},
}


def begin(world: Any, **simulator: Any) -> tuple[list[Any], list[Any]]:
    """A graph that walks; returns states and episodes."""
    heard = world.hear("state"), world.hear("episode")
    world.start("simulator", **{**PLANT, **simulator})
    world.start("estimator")
    world.start("controller", **PARAMETERS)
    world.go()
    return heard


def ended(episodes: list[Episode], number: int) -> list[Episode]:
    """The announcement of an episode's end, once it is there."""
    return [each for each in episodes if (each.episode, each.phase) == (number, Episode.ENDED)]


def test_an_estimator_that_comes_in_the_middle_says_so_and_the_next_episode_walks(world: Any) -> None:
    states, episodes = begin(world, episodes=2, answer_timeout=120.0, pace=1.0)
    world.wait(lambda: bool(states) and states[-1].tick > 20)
    world.processes.kill(("estimator",))
    world.start("estimator")
    world.wait(lambda: bool(ended(episodes, 2)))
    (first,), (second,) = ended(episodes, 1), ended(episodes, 2)
    assert (first.outcome, second.outcome) == ("fault", "walked")
    assert first.reason == f"the state of tick {first.tick} is not known: see the estimator's log"
    said = (world.folder / "log" / "estimator.log").read_text()
    assert f"the estimator came in at tick {first.tick}, in the middle of the episode" in said
    (unknown,) = {m.tick for m in states if m.episode == 1 and np.isnan(m.q).all()}
    assert unknown == first.tick

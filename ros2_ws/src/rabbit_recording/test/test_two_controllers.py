"""What a recording holds of two controllers in one graph."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rabbit_recording.checking import check_episodes
from recorded_walk import CONTROLLER, TICK_NS, Walk, told, write

OTHER = "/other fedcba9876543210"


def told_by_two(walk: Walk, is_other_first: bool) -> Iterator[tuple[str, int, Any]]:
    """Another controller tells its settings and answers each tick, with other torques, before or after the first."""
    settings = walk.parameters.model_copy(update={"eps": 0.5}).model_dump_json()
    for topic, tick, what in told(walk):
        others: list[tuple[str, int, Any]] = []
        if topic == "controller_settings":
            others = [(topic, tick, replace(what, parameters=settings, sender=OTHER))]
        elif topic == "torque":
            others = [(topic, tick, replace(what, torque=what.torque + 10, sender=OTHER))]
        elif topic == "controller_state":
            others = [(topic, tick, replace(what, mu=what.mu + 1, sender=OTHER))]
        elif topic == "learner_terms":
            others = [(topic, tick, replace(what, mu_qp=what.mu_qp + 1, sender=OTHER))]
        both = [*others, (topic, tick, what)] if is_other_first else [(topic, tick, what), *others]
        yield from ((topic, tick * TICK_NS, what) for topic, tick, what in both)


@pytest.mark.parametrize("is_other_first", [True, False])
def test_the_torques_that_acted_are_read(tmp_path: Path, walk: Walk, is_other_first: bool) -> None:
    (checked,) = check_episodes(write(tmp_path / "bag", told_by_two(walk, is_other_first)))
    episode = checked.episode
    assert (episode.controller, episode.lost, checked.differing) == (CONTROLLER, 0, [])
    for name in ("torque", "mu", "mu_qp"):
        recorded = [getattr(record.output, name) for record in episode.records]
        np.testing.assert_array_equal(recorded, [getattr(record.output, name) for record in walk.records])


def test_a_tick_that_only_the_other_answered_is_lost(tmp_path: Path, walk: Walk) -> None:
    def spoilt() -> Iterator[tuple[str, int, Any]]:
        for topic, tick, what in told(walk):
            if topic == "episode":
                what = replace(what, refused_controller=OTHER)
            is_others = (topic, tick) == ("torque", 30)
            yield topic, tick * TICK_NS, replace(what, sender=OTHER) if is_others else what

    (checked,) = check_episodes(write(tmp_path / "bag", spoilt()))
    assert (checked.episode.lost, checked.episode.refused_controller) == (1, OTHER)
    assert 30 not in [record.state.tick for record in checked.episode.records]

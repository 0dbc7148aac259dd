"""Ticks are put together whatever the order, a lost one is counted; transitions come back from the journal."""

import itertools
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP
from rl_trainer.checkpoint import line_of, read_journal, transitions_of
from rl_trainer.parameters import TrainingParameters
from rl_trainer.tick_synchronizer import End, Tick, TickSynchronizer
from rl_trainer.transitions import Doubt, Transition

PARTS = ("state", "torque", "details")


def arrivals(episode: int, last: int) -> dict[str, list[tuple[str, int, int, Any]]]:
    """What each topic delivers, in its order: answers to all states but the last, and the announced end."""
    topics: dict[str, list[tuple[str, int, int, Any]]] = {
        part: [(part, episode, tick, (part, episode, tick)) for tick in range(last + (part == "state"))]
        for part in PARTS
    }
    topics["end"] = [("end", episode, last, False)]
    return topics


def feed(walk: TickSynchronizer, message: tuple[str, int, int, Any]) -> list[tuple[int, Tick | End]]:
    """Hand a message to the walk."""
    part, episode, tick, content = message
    return walk.end(episode, tick, content) if part == "end" else walk.add(part, episode, tick, content)


@settings(deadline=None)
@given(last=st.integers(0, 5), data=st.data())
def test_any_interleaving_of_two_episodes_comes_out_in_order(last: int, data: st.DataObject) -> None:
    queues = [[*first, *second] for first, second in zip(*(arrivals(e, last).values() for e in (1, 2)), strict=True)]
    walk, out = TickSynchronizer(PARTS), []
    while any(queues):
        queue = data.draw(st.sampled_from([queue for queue in queues if queue]))
        out += feed(walk, queue.pop(0))
    expected: list[tuple[int, Tick | End]] = []
    for episode in (1, 2):
        ticks = [Tick(tick, tuple((part, episode, tick) for part in PARTS)) for tick in range(last)]
        expected += [(episode, tick) for tick in ticks] + [(episode, End(("state", episode, last)))]
    assert out == expected
    assert (walk.lost, walk.done) == (0, 2)


@pytest.mark.parametrize(("part", "tick"), list(itertools.product(PARTS, (0, 2, 4))))
def test_a_lost_message_costs_its_tick_alone(part: str, tick: int) -> None:
    walk, out = TickSynchronizer(PARTS), []
    for messages in arrivals(1, 5).values():
        for message in messages:
            if message[:3] != (part, 1, tick):
                out += feed(walk, message)
    out += walk.give_up()
    ticks = [event.tick for _, event in out if isinstance(event, Tick)]
    assert ticks == [t for t in range(5) if t != tick]
    assert isinstance(out[-1][1], End)
    assert walk.lost == 1


def test_each_message_is_judged_by_its_turn() -> None:
    walk = TickSynchronizer(PARTS, done=3, announced=4)
    walk.add("state", 4, 0, "first")
    walk.add("state", 4, 1, "second")
    judged = {turn: walk.judge("state", *turn) for turn in [(3, 0), (4, 0), (4, 1), (4, 2), (4, 5001), (4, 5002)]}
    assert list(judged.values()) == ["late", "late", "again", "good", "good", "wrong tick"]
    assert [walk.judge("state", episode, 0) for episode in (5, 6, 2**32 - 1)] == ["good", *["wrong episode"] * 2]


def test_who_joins_in_the_middle_has_lost_nothing() -> None:
    walk, out = TickSynchronizer(PARTS, done=0, announced=1), []
    walk.join(1, 40)
    for tick in (40, 41):
        for part in PARTS:
            out += walk.add(part, 1, tick, (part, tick))
    assert [event.tick for _, event in out if isinstance(event, Tick)] == [40, 41]
    assert walk.lost == 0


PROBLEM = RL_CBF_CLF_QP
PARAMETERS = TrainingParameters(problem=PROBLEM)


def transition(observations: int) -> Transition:
    """With numbers of its own in every place."""
    rng = np.random.default_rng(observations)
    n = len(PROBLEM.quantities)
    shapes = {"observation": observations, "next_observation": observations, "beta": n, "nominal": n, "measured": n}
    numbers = {"problem", "tick", "step_index", "failed", "doubt", "alpha"}
    arrays = {f.name: rng.standard_normal(shapes.get(f.name, 4)) for f in fields(Transition) if f.name not in numbers}
    return Transition(
        problem=PROBLEM, tick=3, step_index=2, failed=False, doubt=Doubt.NONE, alpha=rng.random((n, 4)), **arrays
    )


@pytest.mark.parametrize("names", PROBLEM.observations[1:])
def test_an_observation_comes_back_with_or_without_a_step_length(names: tuple[str, ...]) -> None:
    before = transition(len(names))
    (after,), lines = transitions_of(line_of(before, PARAMETERS), PARAMETERS)
    assert lines == 1
    for field in fields(Transition):
        assert np.array_equal(getattr(after, field.name), getattr(before, field.name)), field.name


def test_every_prefix_of_a_journal_has_the_lines_that_are_whole(tmp_path: Path) -> None:
    """As a kill leaves it; what is added afterwards is whole again."""
    line, path = line_of(transition(15), PARAMETERS), tmp_path / "journal"
    for cut in range(len(line)):
        path.write_bytes(line + line[:cut])
        is_whole = cut >= len(line) - 1
        assert len(read_journal(path, PARAMETERS)) == 1 + is_whole
        path.write_bytes(line[:cut] + line)
        assert len(read_journal(path, PARAMETERS)) == 1 + is_whole
        path.write_bytes(line[:cut])
        assert len(read_journal(path, PARAMETERS)) == is_whole

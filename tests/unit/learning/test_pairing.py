"""Ticks are put together whatever the order between topics, and a lost one is counted, not waited for."""

import itertools
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rl_trainer.pairing import End, Tick, Walk

PARTS = ("state", "torque", "details")


def arrivals(episode: int, last: int) -> dict[str, list[tuple[str, int, int, Any]]]:
    """What each topic delivers, in its order: answers to all states but the last, and the announced end."""
    topics: dict[str, list[tuple[str, int, int, Any]]] = {
        part: [(part, episode, tick, (part, episode, tick)) for tick in range(last + (part == "state"))]
        for part in PARTS
    }
    topics["end"] = [("end", episode, last, False)]
    return topics


def feed(walk: Walk, message: tuple[str, int, int, Any]) -> list[tuple[int, Tick | End]]:
    """Hand a message to the walk."""
    part, episode, tick, content = message
    return walk.end(episode, tick, content) if part == "end" else walk.add(part, episode, tick, content)


@given(last=st.integers(0, 5), data=st.data())
def test_any_interleaving_of_two_episodes_comes_out_in_order(last: int, data: st.DataObject) -> None:
    queues = [[*first, *second] for first, second in zip(*(arrivals(e, last).values() for e in (1, 2)), strict=True)]
    walk, out = Walk(PARTS), []
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
    walk, out = Walk(PARTS), []
    for messages in arrivals(1, 5).values():
        for message in messages:
            if message[:3] != (part, 1, tick):
                out += feed(walk, message)
    out += walk.give_up()
    ticks = [event.tick for _, event in out if isinstance(event, Tick)]
    assert ticks == [t for t in range(5) if t != tick]
    assert isinstance(out[-1][1], End)
    assert walk.lost == 1


def test_a_refused_message_is_a_lost_one() -> None:
    walk = Walk(PARTS)
    for tick in range(3):
        for part in PARTS:
            walk.add(part, 1, tick, None if (part, tick) == ("details", 1) else "good")
    walk.add("state", 1, 3, "last")
    events = walk.end(1, 3, acted=False)
    assert events == [(1, End("last"))]
    assert walk.lost == 1


def test_a_fault_is_a_tick_with_an_answer() -> None:
    walk, out = Walk(PARTS), []
    for tick in range(2):
        for part in PARTS:
            out += walk.add(part, 1, tick, (part, tick))
    out += walk.end(1, 1, acted=True)
    assert [event.tick for _, event in out if isinstance(event, Tick)] == [0, 1]
    assert out[-1] == (1, End(("state", 1)))


def test_what_comes_after_the_end_is_ignored() -> None:
    walk = Walk(PARTS, done=3)
    assert walk.add("state", 3, 0, "old") == []
    assert walk.end(3, 0, acted=False) == []
    assert not walk.is_held_up

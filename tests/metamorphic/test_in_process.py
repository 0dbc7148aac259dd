"""The same run by every road within a process gives the same digits."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import zip_longest

import pytest
from drawn_runs import Run, assert_same, digits, replay, runs, tick_of, walk
from hypothesis import Phase, given, settings

Road = Callable[[Run, Run], list]


def with_used_parts(run: Run, other: Run) -> list:
    """By the plant and the controller that have walked from another seed."""
    with run.parts() as parts:
        digits(run.model_copy(update={"seed": other.seed, "ticks": other.ticks}), parts)
        return digits(run, parts)


def after_another(run: Run, other: Run) -> list:
    """When the process has walked another run."""
    digits(other)
    return digits(run)


def rehearsed(run: Run, other: Run) -> list:
    """By a controller that was made ready as the node makes its own."""
    with run.parts() as parts:
        parts[1].rehearse()
        return digits(run, parts)


def read_late(run: Run, other: Run) -> list:
    """What a tick says is read when the run is over."""
    with run.parts() as parts:
        return [tick_of(found) for found in [*walk(run, parts)]]


def interleaved(run: Run, other: Run) -> list:
    """Tick by tick in turn with another run."""
    with run.parts() as ours, other.parts() as theirs:
        both = zip_longest(walk(run, ours), walk(other, theirs))
        return [tick_of(found) for found, _ in both if found is not None]


def in_threads(run: Run, other: Run) -> list:
    """Beside another run and itself."""
    with ThreadPoolExecutor(3) as pool:
        found, _, again = pool.map(digits, (run, other, run))
    assert_same(again, found, run)
    return found


def with_another_policy_between(run: Run, other: Run) -> list:
    """Before each tick another policy is set, and then the former one again."""
    with run.parts() as parts, run.model_copy(update={"policy": "zero"}).parts() as (_, another):
        own, found = parts[1].policy, []
        for record in walk(run, parts):
            found.append(tick_of(record))
            parts[1].policy = another.policy
            parts[1].policy = own
        return found


def replayed(run: Run, other: Run) -> list:
    """A new controller gets the states that the plant gave."""
    with run.parts() as parts:
        walked = [*walk(run, parts)]
    return [tick_of(found) for found in replay(run, walked, rehearse=True)]


ROADS = (
    with_used_parts,
    after_another,
    rehearsed,
    read_late,
    interleaved,
    in_threads,
    with_another_policy_between,
    replayed,
)


@pytest.mark.parametrize("road", ROADS, ids=lambda road: road.__name__)
@settings(max_examples=settings.default.max_examples // 10, phases=(Phase.reuse, Phase.generate))
@given(run=runs(), other=runs())
def test_every_road_has_the_same_digits(road: Road, run: Run, other: Run) -> None:
    expected = digits(run)
    assert_same(road(run, other), expected, run)

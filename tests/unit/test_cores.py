"""A processor for simulator and controller: which ones each node gets, and that the launcher gets its own back."""

import os

import pytest
from pydantic import ValidationError
from rabbit_bringup.launching.cores import SHARED, cores_of, keeping_to
from rabbit_bringup.launching.walk import WalkOptions

OWN = frozenset(os.sched_getaffinity(0))


def test_where_all_share_nothing_is_bound() -> None:
    assert cores_of(SHARED, is_walker=True) == cores_of(SHARED, is_walker=False) == frozenset()


@pytest.mark.skipif(len(OWN) < 2, reason="one processor only")
def test_the_others_get_what_the_walkers_do_not() -> None:
    core = min(OWN)
    assert cores_of(core, is_walker=True) == {core}
    assert cores_of(core, is_walker=False) == OWN - {core}
    with keeping_to(OWN - {core}):
        assert os.sched_getaffinity(0) == OWN - {core}
    assert os.sched_getaffinity(0) == OWN


def test_a_processor_that_is_not_there_is_refused() -> None:
    with pytest.raises(ValidationError, match=r"core\n.*-1, or one of"):
        WalkOptions(core=max(OWN) + 1)


def test_the_only_processor_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3})
    with pytest.raises(ValueError, match="another one is left for the other nodes"):
        cores_of(3, is_walker=True)

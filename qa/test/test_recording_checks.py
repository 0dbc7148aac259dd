"""Does a campaign of faults see it when a recording is read otherwise than its graph was heard?"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rabbit_campaigns.faults.recording_checks import MonitorRecord, misreadings
from recorded_walk import Walk

WriteBag = Callable[..., Path]


def heard_of(walk: Walk) -> MonitorRecord:
    """All ticks of episode 1, by a witness who was there all the time."""
    ticks = frozenset((1, record.state.tick) for record in walk.records)
    return MonitorRecord(ticks, ticks, {1: "walked"}, is_cut=False)


def without(topic: str, tick: int) -> Callable[[str, Any], Any]:
    return lambda name, message: None if (name, getattr(message, "tick", -1)) == (topic, tick) else message


def test_what_was_heard_is_read(walk: Walk, write_bag: WriteBag, tmp_path: Path) -> None:
    assert misreadings(write_bag(tmp_path / "bag"), heard_of(walk)) == []


def test_a_recording_that_began_in_the_middle_is_read_as_far_as_it_goes(
    walk: Walk, write_bag: WriteBag, tmp_path: Path
) -> None:
    late = write_bag(tmp_path / "bag", change=lambda _, m: None if 0 <= getattr(m, "tick", -1) < 20 else m)
    heard = heard_of(walk)
    assert misreadings(late, replace(heard, wanted=frozenset(t for t in heard.wanted if t[1] >= 20))) == []
    assert any("20 ticks are not read" in text for text in misreadings(late, heard))


@pytest.mark.parametrize("topic", ["state", "torque", "controller_state", "learner_terms"])
def test_a_gap_is_seen(walk: Walk, write_bag: WriteBag, tmp_path: Path, topic: str) -> None:
    found = misreadings(write_bag(tmp_path / "bag", change=without(topic, 30)), heard_of(walk))
    assert any("(1, 30)" in text for text in found)
    assert any("lost 1 ticks" in text for text in found)


def test_a_killed_sender_may_take_one_tick_with_it(walk: Walk, write_bag: WriteBag, tmp_path: Path) -> None:
    """It had sent the torque to the simulator, and not to the recorder."""
    cut = write_bag(tmp_path / "bag", change=without("torque", 30))
    heard = heard_of(walk)
    killed = replace(heard, wanted=heard.wanted - {(1, 30)}, halved=frozenset({(1, 30)}))
    assert misreadings(cut, killed) == []
    assert any("lost 1 ticks" in text for text in misreadings(cut, replace(killed, halved=frozenset({(2, 30)}))))


def test_ticks_that_nobody_heard_are_seen(walk: Walk, write_bag: WriteBag, tmp_path: Path) -> None:
    heard = replace(heard_of(walk), wanted=frozenset(), ever=frozenset())
    assert any("never heard" in text for text in misreadings(write_bag(tmp_path / "bag"), heard))


def test_another_end_is_seen(walk: Walk, write_bag: WriteBag, tmp_path: Path) -> None:
    heard = replace(heard_of(walk), ended={1: "fall"})
    assert any("ended as walked, expected fall" in text for text in misreadings(write_bag(tmp_path / "bag"), heard))


def test_another_torque_is_seen(walk: Walk, write_bag: WriteBag, tmp_path: Path) -> None:
    def spoil(topic: str, message: Any) -> Any:
        if (topic, getattr(message, "tick", -1)) == ("torque", 30):
            message.torque[0] += 1e-9
        return message

    found = misreadings(write_bag(tmp_path / "bag", change=spoil), heard_of(walk))
    assert found == ["check: episode 1 does not replay at ticks [30]"]

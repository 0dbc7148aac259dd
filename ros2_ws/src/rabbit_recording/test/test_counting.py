"""What is counted and put aside while a recording is read."""

from io import BytesIO
from pathlib import Path

from rabbit_recording.chunk_index import ChunkIndex
from rabbit_recording.message_loss import Loss


def one() -> int:
    """Publishers of a topic."""
    return 1


def test_gaps_in_a_publishers_count_are_losses() -> None:
    loss = Loss()
    for number in (5, 6, 9, 10):
        loss.heard("/state", number, one)
    assert loss.lost == {"/state": 2}
    loss.heard("/state", 1, one)  # started anew
    loss.heard("/state", 2, one)
    loss.heard("/torque", 2**64 - 1, one)  # not numbered
    assert loss.lost == {"/state": 2}


def test_a_strangers_messages_are_no_losses() -> None:
    loss = Loss()
    for number in (416, 1, 417, 418, 2, 419, 421):
        loss.heard("/state", number, one)
    assert loss.lost == {"/state": 1}


def test_the_index_gives_back_what_it_was_given(tmp_path: Path) -> None:
    index, records = ChunkIndex(tmp_path), [bytes([i]) * (i + 1) for i in range(50)]
    for part in (records[:20], records[20:]):
        for data in part:
            record = BytesIO()
            record.write(data)
            index.append(record)
        assert [record.getvalue() for record in index][-1] == part[-1]
    assert [record.getvalue() for record in index] == records
    assert all(record.tell() == len(record.getvalue()) for record in index)
    assert len(index) == len(records)
    assert not list(tmp_path.iterdir())


def test_a_publisher_that_is_heard_after_a_stranger_has_lost_nothing() -> None:
    """A recorder that is started again may hear a stranger's latched message 1, then the simulator's from 198 on."""
    loss = Loss()
    for number in (1, 198, 199):
        loss.heard("/preview", number, lambda: 2)
    assert loss.lost == {"/preview": 0}
    loss.heard("/preview", 202, one)  # the stranger has gone
    assert loss.lost == {"/preview": 2}

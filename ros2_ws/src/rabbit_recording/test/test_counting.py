"""What is counted and put aside while a recording is read."""

from io import BytesIO
from pathlib import Path

from rabbit_recording.chunk_index import ChunkIndex
from rabbit_recording.message_loss import Loss


def test_gaps_in_a_publishers_count_are_losses() -> None:
    loss = Loss()
    for number in (5, 6, 9, 10):
        loss.heard("/state", number)
    assert loss.lost == {"/state": 2}
    loss.heard("/state", 1)  # started anew
    loss.heard("/state", 2)
    loss.heard("/torque", 2**64 - 1)  # not numbered
    assert loss.lost == {"/state": 2}


def test_a_strangers_messages_are_no_losses() -> None:
    loss = Loss()
    for number in (416, 1, 417, 418, 2, 419, 421):
        loss.heard("/state", number)
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

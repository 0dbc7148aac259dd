"""A recorder that is killed, or whose disk is full, loses at most the last second; any cut leaves what is before it."""

import contextlib
import multiprocessing
import random
import struct
import time
from pathlib import Path
from typing import Any

import pytest
from rabbit_recording import RecordingError
from rabbit_recording.bag_writer import BagWriter, graph_types
from rabbit_recording.open_recording import opened
from rabbit_recording.recover import recover

TICKS_A_SECOND = 100
TICK_SECONDS = 1 / TICKS_A_SECOND
FORK = multiprocessing.get_context("fork")
PADDING = bytes(300)  # a tick is about so long


def open_writer(path: Path) -> BagWriter:
    """With one topic; what it carries does not matter here."""
    writer = BagWriter(path, graph_types([]))
    writer.add("/tick", "std_msgs/msg/String", [])
    return writer


def record_forever(path: Path, written: Any) -> None:
    """A tick every 10 ms, its number in its bytes; `written` is the last one that was handed over."""
    writer = open_writer(path)
    tick = 0
    while True:
        writer.write("/tick", tick, struct.pack("<q", tick) + PADDING)
        written.value = tick
        tick += 1
        time.sleep(TICK_SECONDS)


def ticks_in(path: Path) -> list[int]:
    """The numbers of the ticks in a recording."""
    with opened(path) as reader:
        return [struct.unpack_from("<q", data)[0] for _, _, data in reader.messages()]


@pytest.mark.parametrize("seed", range(2))
def test_a_kill_loses_at_most_the_last_second(tmp_path: Path, seed: int) -> None:
    written = FORK.Value("q", -1, lock=False)
    recorder = FORK.Process(target=record_forever, args=(tmp_path / "bag", written))
    recorder.start()
    while written.value < TICKS_A_SECOND:
        time.sleep(TICK_SECONDS)
    time.sleep(random.Random(seed).uniform(0.0, 1.0))
    recorder.kill()
    recorder.join()
    with pytest.raises(RecordingError, match=r"not finished.*rabbit bag recover"), opened(tmp_path / "bag"):
        pass
    done = recover(tmp_path / "bag")
    there = ticks_in(done.path)
    assert there == list(range(done.messages))
    assert there[-1] >= written.value - TICKS_A_SECOND


def test_any_cut_of_an_mcap_file_leaves_what_is_before_it(tmp_path: Path) -> None:
    writer = open_writer(tmp_path / "bag")
    for tick in range(40):
        writer.write("/tick", tick, struct.pack("<q", tick) + PADDING)
        if tick % 8 == 7:
            writer.flush()
    writer.close()
    whole = (tmp_path / "bag" / "bag.mcap").read_bytes()
    found = []
    for size in sorted(random.Random(0).sample(range(len(whole)), 30)):
        cut = tmp_path / f"{size}.mcap"
        cut.write_bytes(whole[:size])
        found.append(0)
        with contextlib.suppress(RecordingError):
            found[-1] = len(ticks_in(recover(cut, tmp_path / f"{size}").path))
    assert found == sorted(found)
    assert {0, 8, 16, 24, 32, 40} >= set(found) > {0, 40}


def test_what_is_recovered_is_the_recording(tmp_path: Path) -> None:
    writer = open_writer(tmp_path / "bag")
    for tick in (3, 1, 2):  # in the order of arrival, not of time
        writer.write("/tick", tick, struct.pack("<q", tick))
    writer.close()
    done = recover(tmp_path / "bag")
    assert done.messages == 3
    assert done.path == tmp_path / "bag-recovered"
    assert ticks_in(done.path) == ticks_in(tmp_path / "bag") == [1, 2, 3]
    with opened(done.path) as new, opened(tmp_path / "bag") as old:
        (one,), (other,) = new.connections, old.connections
        assert (one.topic, one.msgtype, one.msgdef, one.digest) == (
            other.topic,
            other.msgtype,
            other.msgdef,
            other.digest,
        )
    with pytest.raises(RecordingError, match="exists already"):
        recover(tmp_path / "bag")

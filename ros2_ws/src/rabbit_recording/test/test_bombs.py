"""Small recordings that would take gigabytes or hours: refused in one line, or read in proportion to their bytes."""

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rabbit_recording import RecordingError
from rabbit_recording.bag_writer import BagWriter, graph_types
from rabbit_recording.contents import contents
from rabbit_recording.episode_inventory import MOST_UNHEARD
from rabbit_recording.reader import iterate_episodes
from recorded_walk import MESSAGES
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

STATE = "rabbit_msgs/msg/RobotState"
TICK = {"/state": STATE, "/torque": "rabbit_msgs/msg/TorqueCommand"}
TICK |= {"/controller_state": "rabbit_msgs/msg/ControllerState", "/learner_terms": "rabbit_msgs/msg/LearnerTerms"}
TYPES = graph_types([MESSAGES])


def state(episode: int, tick: int) -> bytes:
    """The beginning of a message, as far as it is read without decoding it."""
    stamp = (tick // 100, tick % 100 * 10_000_000)
    head = bytes([0, 1, 0, 0]) + struct.pack("<iIIIII", *stamp, 1, 0, episode, tick)
    no_torque_and_three_empty_texts = bytes(4) + 3 * struct.pack("<II", 1, 0)
    return head + no_torque_and_three_empty_texts


def write(path: Path, messages: list[bytes], chunks: int = 1) -> Path:
    """A recording of ticks by our own recorder, all messages of one with the same bytes; its index names each chunk
    so many times.
    """
    writer = BagWriter(path, TYPES)
    for topic, kind in TICK.items():
        writer.add(topic, kind, [])
    for at, data in enumerate(messages):
        for topic in TICK:
            writer.write(topic, at, data)
        writer.flush()
    if chunks > 1:
        index: Any = writer._writer.storage.chunks
        for record in list(index) * (chunks - 1):
            index.append(record)
    writer.close()
    return path


def zeros(path: Path, bytes_: int, definition: str | None = None) -> Path:
    """A recording of one message of zeros, compressed by chunks; its definition may be another."""
    writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        text = definition or TYPES.generate_msgdef(STATE, ros_version=2)[0]
        connection = writer.add_connection("/state", STATE, msgdef=text, rihs01=TYPES.hash_rihs01(STATE))
        writer.write(connection, 0, bytes(bytes_))
    return path


def chunk_of_zeros(path: Path) -> str:
    zeros(path, 300_000_000)
    return "a chunk of 300"


def chunk_named_often(path: Path) -> str:
    write(path, [state(1, tick) for tick in range(3)], chunks=1000)
    return "overlap: expected each once"


def long_array(path: Path) -> str:
    zeros(path, 100, "builtin_interfaces/Time stamp\nstring[4000000000] q\n")
    return "an array of more than"


BOMBS = (chunk_of_zeros, chunk_named_often, long_array)


@pytest.mark.parametrize("bomb", BOMBS)
def test_a_bomb_is_refused_in_one_line(tmp_path: Path, bomb: Callable[[Path], str]) -> None:
    said = bomb(tmp_path / "bag")
    for read in (contents, lambda path: list(iterate_episodes(path))):
        with pytest.raises(RecordingError) as refused:
            read(tmp_path / "bag")
        assert said in str(refused.value)
        assert "\n" not in str(refused.value)
        assert len(str(refused.value)) < 2000


def test_a_sound_compressed_recording_is_read(tmp_path: Path) -> None:
    assert contents(zeros(tmp_path / "bag", 1000)).messages == 1


def test_a_damaged_tick_takes_no_memory(tmp_path: Path) -> None:
    """2^32 - 3 ticks are counted as lost, and none is kept."""
    last = 2**32 - 1
    (episode,) = contents(write(tmp_path / "bag", [state(1, 0), state(1, 1), state(1, last)])).episodes
    assert (episode.recorded, episode.lost) == (3, last - 2)


def test_damaged_episode_numbers_take_no_memory(tmp_path: Path) -> None:
    """Each is far from the one before."""
    numbers = [1 + 10_000 * i for i in range(300)]
    whole = contents(write(tmp_path / "bag", [state(number, tick) for number in numbers for tick in (0, 1)]))
    assert [episode.number for episode in whole.episodes if episode.presence == "recorded"] == numbers
    assert sum(episode.presence == "lost" for episode in whole.episodes) == MOST_UNHEARD

"""A recorder that is killed loses at most the last second; any cut leaves what is before it.

Recordings that would take gigabytes or hours, or are none, are refused in one line.
"""

import contextlib
import multiprocessing
import random
import shutil
import struct
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rabbit_recording import RecordingError
from rabbit_recording.bag_writer import BagWriter, graph_types
from rabbit_recording.commands.bag import app
from rabbit_recording.contents import contents
from rabbit_recording.episode_inventory import MOST_UNHEARD
from rabbit_recording.open_recording import opened
from rabbit_recording.reader import iterate_episodes
from rabbit_recording.recover import recover
from recorded_walk import DRAWS, MESSAGES
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from typer.testing import CliRunner

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


def test_what_is_made_of_a_recording_lies_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """However it is named; a file's lies beside its folder."""
    writer = open_writer(tmp_path / "bag")
    writer.write("/tick", 0, PADDING)
    writer.close()
    (file,) = writer.path.glob("*.mcap")
    (tmp_path / "bag" / "inside").mkdir()
    for here, name in (("bag", "."), ("bag", file.name), ("bag/inside", ".."), (".", "bag")):
        monkeypatch.chdir(tmp_path / here)
        assert recover(Path(name)).path.resolve() == tmp_path / "bag-recovered"
        shutil.rmtree(tmp_path / "bag-recovered")


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


BOMBS: dict[str, Callable[[Path], Path]] = {
    "a chunk of 300": lambda path: zeros(path, 300_000_000),
    "overlap: expected each once": lambda path: write(path, [state(1, tick) for tick in range(3)], chunks=1000),
    "an array of more than": lambda path: zeros(path, 100, "builtin_interfaces/Time stamp\nstring[4000000000] q\n"),
}


@pytest.mark.parametrize("said", BOMBS)
def test_a_bomb_is_refused_in_one_line(tmp_path: Path, said: str) -> None:
    bag = BOMBS[said](tmp_path / "bag")
    for read in (contents, lambda path: list(iterate_episodes(path))):
        with pytest.raises(RecordingError) as refused:
            read(bag)
        assert said in str(refused.value)
        assert "\n" not in str(refused.value)
        assert len(str(refused.value)) < 2000


def test_damaged_ticks_and_episode_numbers_take_no_memory(tmp_path: Path) -> None:
    """2^32 - 3 ticks are counted as lost, and none is kept; each episode is far from the one before."""
    last = 2**32 - 1
    (episode,) = contents(write(tmp_path / "ticks", [state(1, 0), state(1, 1), state(1, last)])).episodes
    assert (episode.recorded, episode.lost) == (3, last - 2)
    numbers = [1 + 10_000 * i for i in range(300)]
    whole = contents(write(tmp_path / "numbers", [state(number, tick) for number in numbers for tick in (0, 1)]))
    assert [episode.number for episode in whole.episodes if episode.presence == "recorded"] == numbers
    assert sum(episode.presence == "lost" for episode in whole.episodes) == MOST_UNHEARD


@pytest.mark.parametrize("command", ["info", pytest.param("plot", marks=DRAWS), "check"])
@pytest.mark.parametrize(("name", "said"), [("none", "no such file or folder"), (".", "expected a rosbag2 folder")])
def test_refused_in_one_line(tmp_path: Path, command: str, name: str, said: str) -> None:
    done = CliRunner().invoke(app, [command, str(tmp_path / name)])
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1), done.output
    assert said in done.stderr
    assert str(tmp_path / name) in done.stderr


@DRAWS
def test_other_message_definitions_are_refused(tmp_path: Path) -> None:
    """A recording of a version whose state had no `q`."""
    share = shutil.copytree(MESSAGES, tmp_path / "rabbit_msgs")
    (share / "msg" / "RobotState.msg").write_text("uint32 episode\nuint32 tick\nfloat64 angle\n")
    types = graph_types([share])
    writer = BagWriter(tmp_path / "bag", types)
    writer.add("/state", "rabbit_msgs/msg/RobotState", [])
    state = types.types["rabbit_msgs/msg/RobotState"](episode=1, tick=0, angle=0.0)
    writer.write("/state", 0, bytes(types.serialize_cdr(state, "rabbit_msgs/msg/RobotState")))
    writer.close()
    done = CliRunner().invoke(app, ["plot", str(tmp_path / "bag")])
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1), done.output
    assert "other message definitions" in done.stderr

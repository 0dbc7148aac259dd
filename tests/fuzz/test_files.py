"""Each kind of file, changed anyhow: it is used, or refused in one line that names it. Then a sound one is read."""

import io
import pickle
import signal
import time
import warnings
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest
import torch
from entrances import NAMES, Entrance, entrances
from hypothesis import given, settings
from hypothesis import strategies as st
from mutations import BOMBS, flipped, mutated
from rabbit_experiments.assembly import Assembly
from rabbit_sim.parameters import SimulationParameters
from recorded_walk import SEED, Walk
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_trainer.checkpoint import DIGEST
from walked import walked

MOST_SECONDS, MOST_BYTES, LONGEST = 3.0, 500_000_000, 5000  # CPU, three times its bar; memory; of a refusal, characters
HANGS = 60  # s, wall clock
TICKS = 12  # of the walk that is recorded
SEALED = ("policy", "journal", "checkpoint")
SEEDS = st.integers(0, 2**32 - 1)


def first_ticks() -> Walk:
    """Of a walk."""
    parameters = ControllerParameters(sigma=1.0)
    records, _ = walked(Assembly(SimulationParameters(stones=1), parameters, "zero"), SEED)
    return Walk(parameters, records[:TICKS], [])


@cache
def table() -> dict[str, Entrance]:
    """All that are read, by name."""
    return entrances(first_ticks())


class TooSlow(BaseException):
    """Raised by the alarm; no reader may catch it."""


def on_alarm(_signal: int, _frame: FrameType | None) -> None:
    raise TooSlow


def peak(field: str) -> int:
    """Bytes: `VmRSS` now, or `VmHWM`, the most since it was last reset."""
    (line,) = (line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith(field))
    return int(line.split()[1]) * 1024


def read(entrance: Entrance, path: Path, data: bytes) -> tuple[Any, str]:
    """What is read of a file, and the refusal; all within the bounds."""
    path.write_bytes(data)
    Path("/proc/self/clear_refs").write_text("5")
    before, begin, value, said = peak("VmRSS"), time.process_time(), None, ""
    signal.signal(signal.SIGALRM, on_alarm)
    signal.alarm(HANGS)
    try:
        value = entrance.reads(path)
    except entrance.error as error:
        said = str(error)
        assert str(path.parent) in said or not entrance.is_told
        assert "\n" not in said
        assert len(said) <= LONGEST
    finally:
        signal.alarm(0)
    assert time.process_time() - begin < MOST_SECONDS
    assert peak("VmHWM") - before < MOST_BYTES
    return value, said


@pytest.fixture
def folder(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Makes empty folders: a reader may leave something in its own."""
    return lambda: tmp_path_factory.mktemp("hostile")


def is_taken(entrance: Entrance, folder: Path) -> bool:
    """Whether a sound file is read."""
    return read(entrance, folder / entrance.file, entrance.sound)[1] == ""


@pytest.mark.parametrize("name", NAMES)
@given(seed=SEEDS)
def test_a_changed_file_is_used_or_refused(name: str, folder: Any, seed: int) -> None:
    """Within seconds and 500 MB; half of them with checksums that fit."""
    entrance, rng = table()[name], np.random.default_rng(seed)
    data = mutated(entrance.seal(entrance.sound) if rng.random() < 0.5 else entrance.sound, rng)
    with warnings.catch_warnings(action="ignore"):
        read(entrance, folder() / entrance.file, entrance.seal(data) if rng.random() < 0.7 else data)
    assert is_taken(entrance, folder())


@pytest.mark.parametrize("bomb", BOMBS)
@pytest.mark.parametrize("name", NAMES)
def test_a_bomb_is_refused_within_bounds(name: str, bomb: str, folder: Any) -> None:
    """A journal has no sound line then; an empty file of parameters changes none."""
    entrance = table()[name]
    value, said = read(entrance, folder() / entrance.file, BOMBS[bomb])
    assert said or value == b"" or bomb == "nothing"
    assert is_taken(entrance, folder())


class Bomb:
    """What makes a file when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.mark,)


def saved_by_torch(bomb: Bomb, file: io.BytesIO) -> None:
    torch.save({"parameters": bomb}, file)


def saved_by_numpy(bomb: Bomb, file: io.BytesIO) -> None:
    np.savez(file, about=np.array([bomb], dtype=object))


LOADS: dict[Any, Any] = {
    pickle.dump: pickle.load,
    saved_by_torch: lambda file: torch.load(file, weights_only=False),
    saved_by_numpy: lambda file: dict(np.load(file, allow_pickle=True)),
}


@pytest.mark.filterwarnings("ignore:Detected pickle protocol")
@pytest.mark.parametrize("save", LOADS)
def test_no_pickle_is_run(save: Any, folder: Any, tmp_path: Path) -> None:
    """Each would run code where it is loaded, and no reader loads it."""
    file = io.BytesIO()
    save(Bomb(tmp_path / "mark"), file)
    assert table().keys() == {*NAMES}
    for entrance in table().values():
        for data in (file.getvalue(), entrance.seal(bytes(DIGEST) + file.getvalue())):
            value, said = read(entrance, folder() / entrance.file, data)
            assert said or value == b""
    assert not (tmp_path / "mark").exists()
    LOADS[save](io.BytesIO(file.getvalue()))
    assert (tmp_path / "mark").exists(), "the bomb is live"


@pytest.mark.parametrize("name", SEALED)
@settings(max_examples=300)
@given(seed=SEEDS)
def test_no_flipped_bit_is_taken(name: str, folder: Any, seed: int) -> None:
    """Of a policy, checkpoint or journal: it changes nothing, or is refused; a journal loses the line alone."""
    entrance = table()[name]
    data = bytearray(entrance.sound)
    flipped(data, np.random.default_rng(seed))
    value, said = read(entrance, folder() / entrance.file, bytes(data))
    sound, _ = read(entrance, folder() / entrance.file, entrance.sound)
    if name == "policy":
        assert said or value.version == sound.version
    else:
        rows = {sound[at : at + 56] for at in range(0, len(sound), 56)}  # of 14 numbers of 4 bytes
        assert said or {value[at : at + 56] for at in range(0, len(value), 56)} <= rows

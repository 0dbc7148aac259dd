"""What is read is data: no file that is handed to the project, whatever it pretends to be, gets to run code."""

import ast
import contextlib
import hashlib
import io
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from rabbit_description.gait import GaitError, load_gait
from rabbit_experiments.results import ResultsError
from rabbit_experiments.walk_records import RecordsError, load_records
from rabbit_recording import RecordingError
from rabbit_recording.open_recording import one_line_errors, opened
from rabbit_recording.recover import recover
from rabbit_sim.stones import CourseError, read_course
from rl_cbf_clf_controller import parameters as controller
from rl_cbf_clf_controller import weights
from rl_trainer.checkpoint import CHECKPOINT, CheckpointError, read_checkpoint
from rosbags.rosbag2 import StoragePlugin, Writer

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ROOT / "ros2_ws" / "src", ROOT / "studies", ROOT / "qa"
REFUSED = (
    weights.PolicyFileError,
    CheckpointError,
    CourseError,
    GaitError,
    RecordsError,
    RecordingError,
    ResultsError,
    controller.ParameterError,
)
RUNS_CODE = {"eval", "exec", "compile", "__import__"}
RUNS_CODE |= {"pickle.load", "pickle.loads", "marshal.load", "marshal.loads", "joblib.load", "shelve.open"}
RUNS_CODE |= {"yaml.load", "yaml.load_all", "yaml.unsafe_load", "yaml.full_load", "os.system", "os.popen"}


class Bomb:
    """What makes a file when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return Path.touch, (self.mark,)


def read_as_checkpoint(path: Path) -> object:
    """With the checksum that makes a checkpoint sound."""
    data = path.read_bytes()
    (path.parent / CHECKPOINT).write_bytes(hashlib.sha256(data).digest() + data)
    return read_checkpoint(path.parent)


@pytest.fixture
def mark(tmp_path: Path) -> Iterator[Path]:
    """A file that must not be there afterwards."""
    path = tmp_path / "code_was_run"
    yield path
    assert not path.exists()


def saved_by_torch(mark: Path) -> bytes:
    """A bomb as `torch.save` writes it."""
    file = io.BytesIO()
    torch.save({"parameters": Bomb(mark)}, file)
    return file.getvalue()


def saved_by_numpy(mark: Path) -> bytes:
    """A bomb as an array of objects, in an archive of arrays."""
    file = io.BytesIO()
    np.savez(file, about=np.array([Bomb(mark)], dtype=object))
    return file.getvalue()


def test_the_bombs_are_live(tmp_path: Path) -> None:
    """Else the tests below would show nothing."""
    for number, arm in enumerate((lambda m: pickle.dumps(Bomb(m)), saved_by_torch, saved_by_numpy)):
        mark = tmp_path / str(number)
        file = io.BytesIO(arm(mark))
        if arm is saved_by_torch:
            torch.load(file, weights_only=False)
        else:
            dict(np.load(file, allow_pickle=True)) if arm is saved_by_numpy else pickle.load(file)
        assert mark.exists()


@pytest.mark.filterwarnings("ignore:Detected pickle protocol")
@pytest.mark.parametrize("arm", [lambda mark: pickle.dumps(Bomb(mark)), saved_by_torch, saved_by_numpy])
@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("policy.safetensors", weights.read),
        ("checkpoint.pt", read_as_checkpoint),
        ("records.npz", load_records),
        ("bag.mcap", lambda path: opened(path).__enter__()),
        ("bag.db3", lambda path: opened(path).__enter__()),
        ("bag.mcap", recover),
        ("course.yaml", lambda path: read_course(path, 1, 0.05)),
        ("course.csv", lambda path: read_course(path, 1, 0.05)),
        ("gait.yaml", load_gait),
    ],
)
def test_pickles_are_refused(
    arm: Callable[[Path], bytes], name: str, read: Callable[[Path], object], tmp_path: Path, mark: Path
) -> None:
    (tmp_path / name).write_bytes(arm(mark))
    with pytest.raises(REFUSED):
        read(tmp_path / name)


@pytest.mark.parametrize(
    ("kind", "definition"),
    [
        ("a/msg/B:\n    pass\n{code}\nclass C", "float64 x\n"),
        ("a/msg/B", "float64 x\n{code}\n"),
        ("a/msg/B", "float64 x = {code}\n"),
        ("a/msg/B", "string X = \"'''\n{code}\n'''\"\n"),
        ("a/msg/B", "float64[({code})] x\n"),
    ],
)
def test_message_definitions_in_a_recording_run_nothing(kind: str, definition: str, tmp_path: Path, mark: Path) -> None:
    """The library that reads recordings makes Python out of the definitions in them."""
    code = f"__import__('pathlib').Path('{mark}').touch()"
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        told = {"msgdef": definition.format(code=code), "rihs01": "RIHS01_0"}
        connection = writer.add_connection("/t", kind.format(code=code), **told)
        writer.write(connection, 0, bytes(12))
    bag = tmp_path / "bag"
    with contextlib.suppress(RecordingError), opened(bag) as reader, one_line_errors(bag):
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)


def test_no_module_runs_what_it_reads() -> None:
    found = []
    for path in [path for folder in FOLDERS for path in sorted(folder.rglob("*.py")) if path.parent.name != "test"]:
        for call in (n for n in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(n, ast.Call)):
            name, given = ast.unparse(call.func), {k.arg: ast.unparse(k.value) for k in call.keywords}
            unsafe = name in RUNS_CODE or given.get("allow_pickle") == "True" or given.get("shell") == "True"
            if unsafe or (name == "torch.load" and given.get("weights_only") != "True"):
                found.append((str(path.relative_to(ROOT)), name))
    assert not found

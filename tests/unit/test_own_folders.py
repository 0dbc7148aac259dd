"""What `--out` names is written to only if nothing is there, or the same command's own, and nobody writes there."""

import fcntl
import os
from pathlib import Path

import pytest
import typer
from rabbit_bringup.cli import commands
from rabbit_command import invoke
from rabbit_common.own_folder import RESERVED
from typer.testing import Result

FOREIGN = (
    *("summary.json", "runs.csv", "violations.csv", "parameters.yaml", "model.json", "curve.csv", "evaluation.json"),
    *("cache/notes.txt", "made_with/0.json", "training/1.txt", "policies/1.txt", "pictures/1.png", "checkpoint.pt"),
    *("progress.json", "search.log", "results.jsonl"),
)
CART_POLE = Path(__file__).parents[2] / "examples" / "cart_pole.py"
FOLDERS = {
    "evaluate": (),
    "train": (),
    "benchmark": ("nominal", "--cells", "flat/scale-1", "--courses", 1),
    "reproduce": ("stepping-stone", "--quick"),
    "misses": ("--fit-plants", 10),
    "speed": ("--plants", 5),
    "scales": ("--controller", "rl-clf-qp"),
    "estimator": (),
    "gait": ("--name", "mine"),
    "rival end-to-end": ("--ticks", 1),
    "residual": ("--ticks", 1),
    "bag plot": ("none.mcap",),
    "walk": (),
    "evaluate, of a task": ("--task", CART_POLE, "--rides", 1),
    "benchmark, of a task": ("--task", CART_POLE, "--rides", 1, "--jobs", 1),
    "soak": (),
    "jitter": (),
}
FILES = {
    "bag record": (),
    "bag rerun": ("none.mcap",),
    "bench": (),
    "estimates": ("rl-cbf-clf-qp",),
    "rival gp": ("session",),
    "rival task": (CART_POLE,),
    "train, of a task": ("--task", CART_POLE),
}


def rabbit(name: str, *words: object) -> Result:
    """A command of this name."""
    return invoke(*name.partition(",")[0].split(), *words)


def contents(folder: Path) -> dict[str, bytes]:
    """All files below."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """A folder of someone else."""
    for path in (tmp_path / "theirs" / name for name in FOREIGN):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("mine")
    return tmp_path / "theirs"


def refused(done: Result, path: Path) -> None:
    """In one line that names it."""
    assert done.exit_code == 2, done.output
    assert done.stderr.count("\n") == 1, done.stderr
    assert str(path) in done.stderr


@pytest.mark.parametrize("name", {**FOLDERS, **FILES})
def test_a_folder_of_someone_else_stays_as_it_is(foreign: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """And a file that is there."""
    monkeypatch.chdir(foreign.parent)
    out, before = foreign if name in FOLDERS else foreign / FOREIGN[0], contents(foreign)
    done = rabbit(name, *{**FOLDERS, **FILES}[name], "--out", out)
    refused(done, out)
    assert "expected a new or empty folder" in done.stderr or name in FILES
    assert contents(foreign) == before


@pytest.mark.parametrize("name", {**FOLDERS, **FILES})
def test_two_commands_do_not_write_to_one_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "out.safetensors"
    if name in FOLDERS:
        path.mkdir()
        command = name.partition(",")[0].replace(" ", "-")
        if command not in ("walk", "soak", "jitter"):  # theirs are always new
            (path / f".rabbit-{command}").touch()
    place = path if name in FOLDERS else tmp_path / RESERVED.format(path.name)
    descriptor = os.open(place, os.O_RDONLY | (0 if name in FOLDERS else os.O_CREAT))
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    before = contents(tmp_path)
    done = rabbit(name, *{**FOLDERS, **FILES}[name], "--out", path)
    refused(done, path)
    assert "another command is writing there" in done.stderr
    assert contents(tmp_path) == before
    os.close(descriptor)


@pytest.mark.parametrize(("first", "second"), [("evaluate", "train"), ("train", "evaluate")])
def test_a_folder_belongs_to_one_command(tmp_path: Path, first: str, second: str) -> None:
    (tmp_path / f".rabbit-{first}").touch()
    refused(rabbit(second, "--out", tmp_path), tmp_path)


def test_every_command_with_a_place_for_results_is_among_these() -> None:
    found = set()
    for name, command in commands().items():
        group = typer.main.get_command(command.load())
        parts = getattr(group, "commands", {"": group}).items()
        found |= {f"{name} {part}".strip() for part, command in parts if any("--out" in o.opts for o in command.params)}
    assert found == {name.partition(",")[0] for name in (*FOLDERS, *FILES, "bag recover")}

"""A long command that is interrupted, at any moment and in any way, goes on when it is called again."""

import random
from pathlib import Path

import pytest
from interrupted import COMMANDS, chain, disk, finished, may_mount

SLOW = [pytest.param(name, seed, marks=pytest.mark.slow) for name in COMMANDS for seed in (2, 3)]
EACH = [pytest.param(name, marks=() if name == "evaluate" else pytest.mark.slow) for name in COMMANDS]


@pytest.mark.timeout(1800)
@pytest.mark.parametrize(("name", "seed"), [("evaluate", 1), *SLOW])
def test_an_interrupted_command_goes_on(name: str, seed: int, tmp_path: Path) -> None:
    """To the result of one that nobody disturbs; no process is left, and nothing foreign is lost."""
    interruptions, wrong = chain(name, tmp_path / "disk", random.Random(seed))
    assert [each for each in interruptions if each.wrong] == []
    assert wrong == ""


@pytest.mark.parametrize("name", EACH)
def test_a_full_disk_is_one_line(name: str, tmp_path: Path) -> None:
    if not may_mount():
        pytest.skip("this user may not mount a tmpfs")
    with disk(tmp_path / "disk", "size=4k"):
        said, code = finished(name, tmp_path / "disk" / "out")
    assert code != 0, said
    assert "Traceback" not in said
    (line,) = (line for line in said.splitlines() if line.startswith("rabbit: "))
    assert f"{tmp_path / 'disk' / 'out'}" in line
    assert "No space left on device" in line


@pytest.mark.parametrize("name", EACH)
def test_a_read_only_disk_is_one_line(name: str, tmp_path: Path) -> None:
    if not may_mount():
        pytest.skip("this user may not mount a tmpfs")
    with disk(tmp_path / "disk", "ro"):
        said, code = finished(name, tmp_path / "disk" / "out")
    assert code == 2, said
    assert "Traceback" not in said
    (line,) = (line for line in said.splitlines() if line.startswith("rabbit: "))
    assert f"{tmp_path / 'disk' / 'out'}: Read-only file system" in line

"""The executables: the right node, and a Ctrl-C at any moment of the start ends without a traceback."""

import os
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCES = Path(__file__).resolve().parents[2]
SCRIPTS = sorted(SOURCES.glob("*/bin/*"))


@pytest.fixture(autouse=True)
def interrupts_as_before() -> Iterator[None]:
    """`main` changes what a Ctrl-C does."""
    before = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, before)


def ended(process: "subprocess.Popen[str]") -> tuple[int, str, str]:
    """Exit code and what it said."""
    out, said = process.communicate(timeout=180)
    return process.returncode, out, said


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
@pytest.mark.parametrize("seconds", [0.0, 0.02, 0.05, 0.1, 0.2])
def test_an_early_interrupt_is_quiet(script: Path, seconds: float) -> None:
    """Also before the first line of ours: the interpreter itself would answer with a traceback."""
    process = subprocess.Popen(
        [str(script), "--help"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    time.sleep(seconds)
    process.send_signal(signal.SIGINT)
    _, _, said = ended(process)
    assert "Traceback" not in said


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_without_the_workspace_an_executable_says_what_to_source(script: Path) -> None:
    bare = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run([str(script)], capture_output=True, text=True, timeout=180, check=False, env=bare)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 2
    assert "No module named 'rabbit_" in line
    assert "setup.bash" in line

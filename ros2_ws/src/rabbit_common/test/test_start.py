"""The executables: the right node, and a Ctrl-C at any moment of the start ends without a traceback."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from rabbit_common import start

SOURCES = Path(__file__).resolve().parents[2]
SCRIPTS = sorted(SOURCES.glob("*/bin/*"))
AS_A_SLOW_NODE = """
import sys
from importlib.metadata import EntryPoint
from rabbit_common import start
start.entry_points = lambda **wanted: [EntryPoint("walker", "slow_node:main", "rabbit.nodes")]
start.main()
"""


@pytest.fixture(autouse=True)
def interrupts_as_before() -> Iterator[None]:
    """`main` changes what a Ctrl-C does."""
    before = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, before)


def test_the_node_of_the_executables_name_is_run(monkeypatch: pytest.MonkeyPatch) -> None:
    module, runs = ModuleType("a_node"), []
    module.main = lambda: runs.append(list(sys.argv))  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "a_node", module)
    nodes = EntryPoints([EntryPoint("walker", "a_node:main", "rabbit.nodes")])
    monkeypatch.setattr(start, "entry_points", lambda **wanted: nodes.select(**wanted))
    monkeypatch.setattr(sys, "argv", ["/anywhere/lib/walker", "--ros-args"])
    start.main()
    assert runs == [["/anywhere/lib/walker", "--ros-args"]]


def test_a_node_that_is_not_installed_is_named(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    monkeypatch.setattr(start, "entry_points", lambda **wanted: EntryPoints().select(**wanted))
    with pytest.raises(SystemExit) as end:
        start.main("nowhere/walker")
    assert end.value.code == 2
    assert capsys.readouterr().err.startswith("error: 0 nodes nowhere/walker installed")


def ended(process: "subprocess.Popen[str]") -> tuple[int, str, str]:
    """Exit code and what it said."""
    out, said = process.communicate(timeout=180)
    return process.returncode, out, said


def test_an_interrupt_during_the_import_is_quiet(tmp_path: Path) -> None:
    (tmp_path / "slow_node.py").write_text("import time\nprint('imports', flush=True)\ntime.sleep(600)\n")
    paths = os.pathsep.join((str(tmp_path), os.environ.get("PYTHONPATH", "")))
    command = [sys.executable, "-c", AS_A_SLOW_NODE]
    process = subprocess.Popen(
        command,
        env={**os.environ, "PYTHONPATH": paths},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "imports\n"
    process.send_signal(signal.SIGINT)
    assert ended(process) == (-signal.SIGINT, "", "")


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

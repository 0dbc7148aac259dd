"""The executables of the nodes: the right node, and no traceback of a Ctrl-C while it imports."""

import signal
import sys
from collections.abc import Iterator
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from types import ModuleType

import pytest
from rabbit_ros import start


def called_as(name: str, module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Be the executable `name`, whose node is in `module`."""
    nodes = EntryPoints([EntryPoint(name, f"{module}:main", "rabbit.nodes")])
    monkeypatch.setattr(start, "entry_points", lambda **wanted: nodes.select(**wanted))
    monkeypatch.setattr(sys, "argv", [f"/anywhere/lib/{name}", "--ros-args"])


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Ctrl-C raises, also where the tests' own caller has it ignored (a job in the background)."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_the_node_of_the_executables_name_is_run(monkeypatch: pytest.MonkeyPatch) -> None:
    module, runs = ModuleType("a_node"), []
    module.main = lambda: runs.append(list(sys.argv))  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "a_node", module)
    called_as("walker", "a_node", monkeypatch)
    start.main()
    assert runs == [["/anywhere/lib/walker", "--ros-args"]]


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_during_the_import_is_quiet(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "slow_node.py").write_text(
        "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(10)\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    called_as("walker", "slow_node", monkeypatch)
    with pytest.raises(SystemExit) as end:
        start.main()
    assert end.value.code == 130
    assert capfd.readouterr() == ("", "")

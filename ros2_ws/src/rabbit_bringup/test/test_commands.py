"""`rabbit` finds its subcommands by entry points: those of these packages, and a stranger's."""

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path

import pytest
from rabbit_bringup.cli import GROUP, app, commands
from rabbit_common.exit_codes import Interrupted
from typer.testing import CliRunner

DISTRIBUTION = "Metadata-Version: 2.1\nName: stranger\nVersion: 1\n"
COMMAND = '''"""Dance: a stranger's command."""

import typer

app = typer.Typer()


@app.command()
def dance() -> None:
    """Say so."""
    print("it dances")
'''


@pytest.fixture
def stranger(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], None]]:
    """Puts a package on the path that brings the command `dance` from a module of that name."""

    def bring(module: str) -> None:
        (tmp_path / "stranger_of_rabbit.py").write_text(COMMAND)
        about = tmp_path / "stranger-1.dist-info"
        about.mkdir()
        (about / "METADATA").write_text(DISTRIBUTION)
        (about / "entry_points.txt").write_text(f"[{GROUP}]\ndance = {module}:app\n")
        monkeypatch.syspath_prepend(tmp_path)
        commands.cache_clear()

    yield bring
    commands.cache_clear()


def test_a_strangers_command_is_listed_last_and_runs(stranger: Callable[[str], None]) -> None:
    before = list(commands())
    stranger("stranger_of_rabbit")
    assert list(commands()) == [*before, "dance"]
    assert "Dance: a stranger's command." in CliRunner().invoke(app, ["--help"]).output
    assert CliRunner().invoke(app, ["dance"]).output == "it dances\n"


def test_a_studys_command_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    product = {name: command for name, command in commands().items() if name != "benchmark"}
    monkeypatch.setattr("rabbit_bringup.cli.commands", lambda: product)
    refused = CliRunner().invoke(app, ["benchmark", "--list"])
    assert (refused.exit_code, refused.stderr.count("\n")) == (2, 1)
    assert "benchmark is not installed: call make studies" in refused.stderr


@pytest.mark.parametrize(
    ("library", "words", "line"),
    [
        ("torch", ("train", "--out", "out"), "pip install 'rl_trainer[learn]'; in a checkout make torch"),
        ("torch", ("walk", "--trainer"), "pip install 'rl_trainer[learn]'; in a checkout make torch"),
        ("mujoco", ("evaluate", "--plant", "mujoco"), "which is not installed: pip install 'rabbit_sim[mujoco]'"),
        ("pybullet", ("play", "--plant", "pybullet"), "which is not installed: pip install 'rabbit_sim[pybullet]'"),
    ],
)
def test_a_library_that_pip_leaves_out_is_named(
    library: str, words: tuple[str, ...], line: str, tmp_path: Path
) -> None:
    script = f"import sys; sys.modules[{library!r}] = None; from rabbit_bringup.cli import main; main()"
    command = [sys.executable, "-c", script, *words]
    refused = subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=tmp_path)
    assert (refused.returncode, refused.stdout, refused.stderr.count("\n")) == (2, "", 1)
    assert refused.stderr.startswith("rabbit: ")
    assert refused.stderr.endswith(f"{line}\n")


@pytest.mark.parametrize(("error", "code"), [(KeyboardInterrupt(), 130), (Interrupted(signal.SIGTERM), 143)])
def test_a_command_that_a_signal_ends_has_the_shells_code(
    stranger: Callable[[str], None], monkeypatch: pytest.MonkeyPatch, error: BaseException, code: int
) -> None:
    def dance(*_: object, **__: object) -> None:
        raise error

    stranger("stranger_of_rabbit")
    monkeypatch.setattr("typer.core.TyperCommand.invoke", dance)
    assert CliRunner().invoke(app, ["dance"]).exit_code == code


def test_an_unknown_command_is_named() -> None:
    refused = CliRunner().invoke(app, ["dance"])
    assert refused.exit_code == 2
    assert refused.stderr == "rabbit: no command dance; rabbit --help lists them\n"
    near = CliRunner().invoke(app, ["evalute"])
    assert near.stderr == "rabbit: no command evalute: did you mean evaluate?\n"
    told = CliRunner().invoke(app, ["--version"])
    assert (told.exit_code, told.stdout) == (0, f"rabbit {version('rabbit_bringup')}\n")


def test_the_command_runs_by_the_interpreter_beside_it(tmp_path: Path) -> None:
    """Called by a path, or by a link to it, in an environment that is not activated."""
    (tmp_path / "bin").mkdir()
    command, interpreter = tmp_path / "bin" / "rabbit", tmp_path / "bin" / "python3"
    command.write_bytes((Path(__file__).parents[1] / "bin" / "rabbit").read_bytes())
    interpreter.write_text('#!/bin/sh\necho "$@"\n')
    for path in (command, interpreter):
        path.chmod(0o755)
    link = tmp_path / "rabbit"
    link.symlink_to(command)
    done = subprocess.run([link, "a  word"], capture_output=True, text=True, env={"PATH": "/usr/bin:/bin"})
    assert done.stdout == f"{link} a  word\n"

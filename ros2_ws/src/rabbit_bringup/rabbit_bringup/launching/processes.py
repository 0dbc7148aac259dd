"""The nodes as processes: each with a log file, ended together, whatever ends first; the file of their parameters.

They have sessions to themselves, so a Ctrl-C reaches the launcher alone, which ends them in order. If the launcher is
killed, the kernel tells them to end.
"""

import contextlib
import math
import signal
import subprocess
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rabbit_common.child_process import end_with_parent
from rabbit_common.executables import LaunchError, find_executable
from rabbit_common.exit_codes import ExitCode, Interrupted
from rabbit_description.atomic_file import replace_text
from rabbit_description.yaml_file import dump_yaml

PATIENCE = 12.0  # s for a node to end after SIGTERM: a recorder drains, a trainer ends its update
POLL_SECONDS = 0.02
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
PACKAGES = {  # of each node
    "simulator": "rabbit_sim",
    "estimator": "rabbit_estimator",
    "controller": "rl_cbf_clf_controller",
    "trainer": "rl_trainer",
    "recorder": "rabbit_recording",
    "viewer": "rabbit_viewer",
}
ECHO_SECONDS = 0.2  # in which a Ctrl-C may come twice: of the terminal, and of a program that passes it on


class NodeEnded(LaunchError):
    """A node ended by itself; with exit code 2 it refused an argument or a parameter."""

    def __init__(self, name: str, returncode: int, last_words: str) -> None:
        how = f"signal {signal.Signals(-returncode).name}" if returncode < 0 else f"exit code {returncode}"
        super().__init__(f"the {name} ended by itself ({how}): {last_words}")
        self.code = ExitCode.REFUSED if returncode == ExitCode.REFUSED else ExitCode.NODE_DIED


class Processes:
    """The nodes, `running` by name."""

    def __init__(self, logs: Path) -> None:
        self._logs = logs
        self.running: dict[str, subprocess.Popen[bytes]] = {}
        self._signal, self._hurry = 0, False

    @property
    def names(self) -> list[str]:
        """The nodes that were started and not yet ended."""
        return list(self.running)

    def start(self, name: str, arguments: Sequence[str] = (), kind: str = "", package: str = "") -> None:
        """Start a node, by default ours of that name; else the executable `kind` of a `package`.

        Raises `LaunchError`.
        """
        kind = kind or name
        command = [str(find_executable(package or PACKAGES[kind], kind)), *arguments]
        self._logs.mkdir(parents=True, exist_ok=True)
        with (self._logs / f"{name}.log").open("ab") as log:
            self.running[name] = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
                preexec_fn=end_with_parent,
            )

    def check(self) -> None:
        """Raises `NodeEnded`, with the log's last line, if a node has ended by itself; or `Interrupted`."""
        if self._signal:
            raise Interrupted(self._signal)
        for name, process in self.running.items():
            if (code := process.poll()) is not None:
                raise NodeEnded(name, code, self._last_words(name))

    @contextlib.contextmanager
    def ended_at_last(self) -> Iterator[None]:
        """Ends all nodes at the end, those that others listen to first. A signal before makes `check` raise.

        A later one, or one while they end, ends them at once. No signal raises by itself: an exception out of the
        middle of a callback or a destructor may be lost. The exit raises it as `Interrupted`.
        """
        noted = -math.inf

        def note(number: int, frame: object) -> None:
            nonlocal noted
            now = time.monotonic()
            self._hurry, self._signal = bool(self._signal) and now - noted > ECHO_SECONDS, number
            noted = now

        before = {number: signal.signal(number, note) for number in ENDING}
        try:
            yield
        finally:
            self._signal = self._signal or ENDING[0]
            for names in (("simulator", "controller"), ("estimator", "trainer"), ()):
                self.stop(names)
            for number, handler in before.items():
                signal.signal(number, handler)
        if noted > -math.inf:
            raise Interrupted(self._signal)

    def stop(self, names: Sequence[str] = ()) -> None:
        """End the named nodes, or all: politely, and when they or the user lose patience, not."""
        chosen = {name: process for name, process in self.running.items() if name in (names or self.running)}
        for process in chosen.values():
            process.send_signal(signal.SIGTERM)
        deadline = time.monotonic() + PATIENCE
        while any(process.poll() is None for process in chosen.values()):
            if self._hurry or time.monotonic() > deadline:
                for process in chosen.values():
                    process.send_signal(signal.SIGKILL)
            time.sleep(POLL_SECONDS)
        self.running = {name: process for name, process in self.running.items() if name not in chosen}

    def _last_words(self, name: str) -> str:
        log = self._logs / f"{name}.log"
        lines = log.read_text(encoding="utf-8", errors="replace").split("\n")
        return f"{next(filter(None, reversed(lines)), 'without a word')} ({log})"


def write_parameters(path: Path, nodes: dict[str, dict[str, Any]]) -> None:
    """Write a ROS parameter file of parameters by node name; they hold in whatever namespace the node is.

    Empty lists are left out: a parameter file has no type for them, and the node's default is the same.
    """
    plain = {
        name: {key: value for key, value in values.items() if value not in ([], ())} for name, values in nodes.items()
    }
    replace_text(path, dump_yaml({f"/**/{name}": {"ros__parameters": values} for name, values in plain.items()}))

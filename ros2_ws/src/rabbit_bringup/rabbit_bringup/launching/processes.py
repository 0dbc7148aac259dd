"""The nodes as processes: each with a log file, ended together, whatever ends first.

They have sessions of their own, so a Ctrl-C reaches the launcher alone, which ends them in order. If the launcher is
killed, the kernel tells them to end.
"""

import contextlib
import ctypes
import os
import select
import signal
import subprocess
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rabbit_cli.executables import LaunchError, find_executable
from rabbit_cli.exit_codes import ExitCode

PATIENCE = 12.0  # s for a node to end after SIGTERM: a recorder drains, a trainer ends its update
POLL_SECONDS = 0.02
PACKAGES = {  # of each node
    "simulator": "rabbit_sim",
    "controller": "rl_cbf_clf_controller",
    "trainer": "rl_trainer",
    "recorder": "rabbit_recording",
    "viewer": "rabbit_viewer",
}
UNKNOWN = 256  # as an exit code: it went to the process that started it
_PR_SET_PDEATHSIG = 1
_libc = ctypes.CDLL(None)


@dataclass(frozen=True)
class NodeSpec:
    """A node to start."""

    package: str
    executable: str
    arguments: tuple[str, ...] = ()


class NodeEnded(LaunchError):
    """A node ended by itself; with exit code 2 it refused an argument or a parameter."""

    def __init__(self, name: str, returncode: int, last_words: str) -> None:
        super().__init__(f"the {name} ended by itself{_how(returncode)}{last_words and f': {last_words}'}")
        self.code = ExitCode.REFUSED if returncode == ExitCode.REFUSED else ExitCode.NODE_DIED


class Foreign:
    """A process that somebody else has started; what `Processes` needs of `subprocess.Popen`."""

    def __init__(self, pid: int) -> None:
        self.pid, self.returncode = pid, UNKNOWN
        try:
            self._handle = os.pidfd_open(pid)
        except ProcessLookupError:
            self._handle = -1

    def poll(self) -> int | None:
        """None while it runs."""
        has_ended = self._handle < 0 or select.select([self._handle], [], [], 0)[0]
        return self.returncode if has_ended else None

    def send_signal(self, number: int) -> None:
        """Nobody else can have its number meanwhile."""
        with contextlib.suppress(ProcessLookupError):
            signal.pidfd_send_signal(self._handle, number)


class Processes:
    """The running nodes, by executable."""

    def __init__(self, logs: Path) -> None:
        self._logs = logs
        self._running: dict[str, subprocess.Popen[bytes] | Foreign] = {}
        self.hurry = False
        logs.mkdir(parents=True, exist_ok=True)

    def adopt(self, name: str, pid: int) -> None:
        """Look after a node that somebody else has started, and shows what it prints."""
        self._running[name] = Foreign(pid)

    def start(self, node: NodeSpec) -> None:
        """Start a node; raises `LaunchError` if there is none."""
        command = [str(find_executable(node.package, node.executable)), *node.arguments]
        with (self._logs / f"{node.executable}.log").open("ab") as log:
            self._running[node.executable] = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
                preexec_fn=end_with_parent,
            )

    def check(self) -> None:
        """Raises `NodeEnded` with the last line of its log if a node has ended by itself."""
        for name, process in self._running.items():
            if (code := process.poll()) is not None:
                raise NodeEnded(name, code, self._last_words(name))

    def stop(self, names: Sequence[str] = ()) -> None:
        """End the named nodes, or all: politely, and when they or the user (`hurry`) lose patience, not."""
        chosen = [process for name, process in self._running.items() if name in (names or self._running)]
        for process in chosen:
            _send(process, signal.SIGTERM)
        deadline = time.monotonic() + PATIENCE
        while any(process.poll() is None for process in chosen):
            if self.hurry or time.monotonic() > deadline:
                for process in chosen:
                    _send(process, signal.SIGKILL)
            time.sleep(POLL_SECONDS)
        self._running = {name: process for name, process in self._running.items() if process not in chosen}

    def kill(self, names: Sequence[str] = ()) -> None:
        """End the named nodes, or all, at once."""
        for name in names or list(self._running):
            process = self._started(name)
            _send(process, signal.SIGKILL)
            process.wait()

    def runs(self, name: str) -> bool:
        """Whether it was started and not yet ended or waited for."""
        return name in self._running

    def pid(self, name: str) -> int:
        """Process of a running node."""
        return self._running[name].pid

    def wait(self, name: str, timeout: float) -> int:
        """Exit code of a node that ends by itself; raises `subprocess.TimeoutExpired`."""
        return self._started(name).wait(timeout)

    def _started(self, name: str) -> subprocess.Popen[bytes]:
        """Take out a node that this process has started."""
        process = self._running.pop(name)
        assert isinstance(process, subprocess.Popen)
        return process

    def _last_words(self, name: str) -> str:
        log = self._logs / f"{name}.log"
        if not log.is_file():
            return ""
        lines = log.read_text(encoding="utf-8", errors="replace").split("\n")
        return f"{next(filter(None, reversed(lines)), 'without a word')} ({log})"


def _send(process: subprocess.Popen[bytes] | Foreign, number: int) -> None:
    if process.poll() is not None:
        return
    if isinstance(process, Foreign):
        process.send_signal(number)
    else:
        os.killpg(process.pid, number)


def _how(code: int) -> str:
    if code == UNKNOWN:
        return ""
    return f" (signal {signal.Signals(-code).name})" if code < 0 else f" (exit code {code})"


def end_with_parent() -> None:
    """In a child: end as by SIGTERM when the process that started it dies."""
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)

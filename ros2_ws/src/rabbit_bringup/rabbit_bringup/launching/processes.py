"""The nodes as processes: each with a log file, ended together, whatever ends first.

They have sessions of their own, so a Ctrl-C reaches the launcher alone, which ends them in order. If the launcher is
killed, the kernel tells them to end.
"""

import ctypes
import os
import signal
import subprocess
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rabbit_bringup.launching.executables import LaunchError, find_executable

PATIENCE = 12.0  # s for a node to end after SIGTERM: a recorder drains, a trainer ends its update
POLL_SECONDS = 0.02
LOG_TAIL = 12  # lines shown of a node that failed
_PR_SET_PDEATHSIG = 1
_libc = ctypes.CDLL(None)


@dataclass(frozen=True)
class NodeSpec:
    """A node to start."""

    package: str
    executable: str
    arguments: tuple[str, ...] = ()


class Processes:
    """The running nodes, by executable."""

    def __init__(self, logs: Path) -> None:
        self._logs = logs
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self.hurry = False
        logs.mkdir(parents=True, exist_ok=True)

    def start(self, node: NodeSpec) -> None:
        """Start a node; raises `LaunchError` if there is none."""
        command = [str(find_executable(node.package, node.executable)), *node.arguments]
        with (self._logs / f"{node.executable}.log").open("ab") as log:
            self._running[node.executable] = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True, preexec_fn=_follow
            )

    def check(self) -> None:
        """Raises `LaunchError` with the end of its log if a node has ended by itself."""
        for name, process in self._running.items():
            if process.poll() is not None:
                tail = "\n".join(self._tail(name))
                raise LaunchError(f"the {name} ended by itself ({_how(process.returncode)}):\n{tail}")

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
            process = self._running.pop(name)
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
        return self._running.pop(name).wait(timeout)

    def _tail(self, name: str) -> list[str]:
        lines = (self._logs / f"{name}.log").read_text(encoding="utf-8", errors="replace").splitlines()
        return lines[-LOG_TAIL:]


def _send(process: subprocess.Popen[bytes], number: int) -> None:
    if process.poll() is None:
        os.killpg(process.pid, number)


def _how(code: int) -> str:
    return f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"


def _follow() -> None:
    """In the child: end when the launcher dies."""
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)

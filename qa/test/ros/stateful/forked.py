"""Nodes as children of a server that has imported them already: one starts in a tenth of the time.

Each is a process of its own, as those of `Processes`: it can be killed, stopped and ended by signals.
"""

import ctypes
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from importlib.metadata import entry_points
from multiprocessing import forkserver
from multiprocessing.context import ForkServerProcess
from pathlib import Path

from rabbit_bringup.launching.processes import PACKAGES, POLL_SECONDS, Processes
from rabbit_common.executables import find_executable

GROUP = "rabbit.nodes"
IMPORTED = "qa.test.ros.stateful.imported"
_PR_SET_PDEATHSIG = 1

_context = multiprocessing.get_context("forkserver")


class ForkedProcesses(Processes):
    """Starts nodes by forking the server."""

    def start(self, name: str, arguments: Sequence[str] = (), kind: str = "") -> None:
        """Start a node, one of `kind` under a name of its own if that is given; raises `LaunchError`."""
        kind = kind or name
        command = (str(find_executable(PACKAGES[kind], kind)), *arguments)
        self._logs.mkdir(parents=True, exist_ok=True)
        _context.set_forkserver_preload([IMPORTED])
        child = _context.Process(target=_run, args=(command, str(self._logs / f"{name}.log")), daemon=True)
        child.start()
        self._running[name] = Child(child)


class Child(subprocess.Popen[bytes]):
    """A forked process as a Popen."""

    def __init__(self, process: ForkServerProcess) -> None:
        self._child_created = False  # by Popen: there is nothing to wait for where this object is collected
        self._process, self.pid, self.returncode = process, process.pid or 0, None
        while self.poll() is None and os.getsid(self.pid) != self.pid:  # until it can be sent signals
            time.sleep(POLL_SECONDS)

    def poll(self) -> int | None:
        """The exit code; None while it runs."""
        return self._process.exitcode

    def wait(self, timeout: float | None = None) -> int:
        """The exit code; raises `subprocess.TimeoutExpired`."""
        self._process.join(timeout)
        if self._process.exitcode is None:
            raise subprocess.TimeoutExpired(str(self.pid), timeout or 0.0)
        return self._process.exitcode


def _run(command: tuple[str, ...], log: str) -> None:
    """In the child: become the node."""
    os.setsid()
    os.close(forkserver._forkserver._forkserver_alive_fd)  # else the server lives as long as its children
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    with Path(log).open("ab") as file:
        for number in (1, 2):
            os.dup2(file.fileno(), number)
    sys.argv = list(command)
    (entry,) = entry_points(group=GROUP, name=Path(command[0]).name)
    entry.load()()

"""Nodes of a test as processes, which it may kill and stop."""

import signal
from collections.abc import Sequence

from rabbit_bringup.launching.processes import PATIENCE, Processes


class NodeProcesses(Processes):
    """Those of a test."""

    def kill(self, names: Sequence[str]) -> None:
        """End the named nodes at once."""
        for name in names:
            self.send(name, signal.SIGKILL)
            self.wait(name, PATIENCE)

    def send(self, name: str, number: signal.Signals) -> None:
        """Send a node a signal."""
        self.running[name].send_signal(number)

    def pid(self, name: str) -> int:
        """Process of a running node."""
        return self.running[name].pid

    def wait(self, name: str, timeout: float) -> int:
        """Exit code of a node that ends; raises `subprocess.TimeoutExpired`."""
        code = self.running[name].wait(timeout)
        del self.running[name]
        return code

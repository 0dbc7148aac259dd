"""A command of `rabbit` that serves a page."""

import re
import signal
import subprocess

from rabbit_command import RABBIT


class Served:
    """`address`: of its page."""

    def __init__(self, *words: str) -> None:
        command = [*RABBIT, *words, "--no-browser", "--port", "0"]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout
        self.address = re.findall(r"http://[\d.:]+", self._process.stdout.readline())[0]

    def end(self) -> int:
        """By Ctrl-C; the exit code."""
        self._process.send_signal(signal.SIGINT)
        self._process.communicate(timeout=180)
        return self._process.returncode

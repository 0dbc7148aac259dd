"""A command of `rabbit` that serves a page."""

import re
import signal
import subprocess
from typing import Self

from rabbit_command import RABBIT


class Served:
    """A context manager, which ends it by Ctrl-C; `address`: of its page."""

    def __init__(self, *words: str) -> None:
        command = [*RABBIT, *words, "--no-browser", "--port", "0"]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout
        self.address = re.findall(r"http://[\d.:]+", self._process.stdout.readline())[0]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.send_signal(signal.SIGINT)
        self._process.communicate(timeout=180)
        assert self._process.returncode == 0

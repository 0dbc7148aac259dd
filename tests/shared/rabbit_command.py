"""`rabbit` as tests call it."""

import os
import subprocess
import sys
from pathlib import Path

from rabbit_bringup.cli import app
from typer.testing import CliRunner, Result

RABBIT = (sys.executable, "-c", "from rabbit_bringup.cli import app; app()")


def rabbit(*words: object, cwd: Path | None = None, **environment: str) -> subprocess.CompletedProcess[str]:
    """In a process of its own, until it has ended."""
    own = {"env": {**os.environ, **environment}, "cwd": cwd}
    return subprocess.run([*RABBIT, *map(str, words)], capture_output=True, text=True, timeout=400, **own)


def invoke(*words: object) -> Result:
    """In this process."""
    return CliRunner().invoke(app, [str(word) for word in words])

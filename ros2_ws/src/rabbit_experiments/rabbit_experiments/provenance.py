"""Where a result comes from: commit, command, versions."""

import hashlib
import json
import platform
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

LIBRARIES = ("numpy", "scipy", "pin", "pybullet", "mujoco", "osqp", "daqp", "torch", "casadi", "safetensors", "joblib")


def versions() -> dict[str, str]:
    """Of Python and of the libraries."""
    return {"python": platform.python_version(), **installed(LIBRARIES)}


def installed(libraries: Sequence[str]) -> dict[str, str]:
    """Versions of those that are installed."""
    found = {}
    for name in libraries:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


@cache
def commit() -> str:
    """The repository's commit, `+` where files differ from it; empty outside a repository."""
    folder = Path(__file__).parent
    head = _git(folder, "rev-parse", "HEAD")
    return head + "+" * bool(head and _git(folder, "status", "--porcelain", "--untracked-files=no"))


def command() -> str:
    """This process's command line."""
    return " ".join(("rabbit", *sys.argv[1:]))


def content_key(identity: dict[str, Any], plain: Callable[[Any], Any] | None = None) -> str:
    """SHA-256, 16 digits, of plain data; `plain` makes such data of anything else in it."""
    return hashlib.sha256(json.dumps(identity, sort_keys=True, default=plain).encode()).hexdigest()[:16]


def _git(folder: Path, *words: str) -> str:
    try:
        done = subprocess.run(["git", *words], cwd=folder, capture_output=True, text=True, check=False, timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""

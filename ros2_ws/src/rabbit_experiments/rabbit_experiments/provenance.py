"""Where a result comes from: commit, content of the code, versions, machine."""

import hashlib
import json
import platform
import subprocess
import sys
from collections.abc import Iterable
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import ModuleType
from typing import Any

import cbf_clf_qp
import rabbit_description
import rabbit_sim
import rl_cbf_clf_controller

import rabbit_experiments

LIBRARIES = ("numpy", "scipy", "pin", "pybullet", "osqp", "daqp", "torch", "casadi", "safetensors", "joblib")
PACKAGES = (cbf_clf_qp, rabbit_description, rabbit_sim, rl_cbf_clf_controller, rabbit_experiments)
NEITHER = {"commands", "reproduce", "ros"}  # folders that decide neither how a run goes nor how it is judged


def versions() -> dict[str, str]:
    """Python and the libraries that decide a result, as installed."""
    found = {"python": platform.python_version()}
    for name in LIBRARIES:
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


@cache
def code_hash(packages: Iterable[ModuleType] = PACKAGES) -> str:
    """SHA-256, 16 digits, over the files that decide how a run goes and how it is judged."""
    digest = hashlib.sha256()
    for package in packages:
        root = Path(str(package.__file__)).parent
        for path in sorted((*root.rglob("*.py"), *root.rglob("*.urdf"))):
            if not NEITHER & set(path.relative_to(root).parts) and not path.name.endswith("node.py"):
                digest.update(str(path.relative_to(root)).encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def content_key(identity: dict[str, Any]) -> str:
    """SHA-256, 16 digits, of plain data."""
    return hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()[:16]


def _git(folder: Path, *words: str) -> str:
    try:
        done = subprocess.run(["git", *words], cwd=folder, capture_output=True, text=True, check=False, timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""

"""pip with hashes, bounded waiting, and its errors in one line."""

import os
import re
from pathlib import Path

from common import ROOT, STATE, VENV, SetUpError, logged

REQUIREMENTS = ROOT / "requirements"
CAUSES = (
    (r"No space left on device|\[Errno 28\]", "no room on the disk: make room (3 GB; 10 GB with CUDA)"),
    (r"Disk quota exceeded|\[Errno 122\]", "the disk quota is used up: make room (3 GB; 10 GB with CUDA)"),
    (r"Permission denied|\[Errno 13\]", "a folder is not writable: see to its owner"),
    (
        r"DO NOT MATCH THE HASHES",
        "a download is not the file that the lock names: try again, or clear pip's cache (`pip cache purge`)",
    ),
    (r"Python\.h: No such file", "Python's headers are missing: install python3-dev"),
    (r"(gcc|g\+\+|cc|c\+\+|clang).*(No such file or directory|not found)", "no C++ compiler: install build-essential"),
    (
        r"timed out|Connection(Error| refused| reset)|NewConnection|name resolution|Max retries|SSLError|ProxyError"
        r"|No matching distribution|Could not find a version|HTTP error",
        "the package registry did not answer or lacks a file: check the network and pip's settings",
    ),
)


def cause(output: str) -> str:
    """What pip's output says about its failure, as an advice."""
    for pattern, advice in CAUSES:
        if re.search(pattern, output):
            return advice
    return "pip failed for another reason"


def pip_install(*locks: str, first: bool = False, target: Path | None = None) -> None:
    """Install locked packages, in .venv or in the folder `target`.

    `first` marks the first thing asked of the registry: it waits less.

    Raises:
        SetUpError: pip failed; the line says why as far as pip's output shows it.
    """
    log = STATE / f"pip-{Path(locks[0]).stem}.log"
    patience = (
        ["--timeout", "30", "--retries", "1"] if first else ["--timeout", os.environ.get("PIP_DEFAULT_TIMEOUT", "60")]
    )
    files = [part for lock in locks for part in ("-r", str(REQUIREMENTS / lock))]
    options = ["--disable-pip-version-check", "--no-input", "--no-deps", "--no-build-isolation", "--require-hashes"]
    options += ["--no-compile"]  # Python compiles what is imported; all of it would be 0.3 GB
    options += ["--target", str(target)] if target else []
    command = [str(VENV / "bin" / "python"), "-I", "-m", "pip", "install", *options, *patience, *files]
    if logged(command, log):
        advice = cause(log.read_text(encoding="utf-8"))
        raise SetUpError(f"{advice}, then call make again (log: {log.relative_to(ROOT)})")

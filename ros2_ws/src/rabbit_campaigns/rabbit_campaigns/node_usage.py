"""What the running nodes take of the machine: memory, descriptors, threads, processor time, from /proc."""

import os
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

KILOBYTES_PER_MB = 1024


@dataclass(frozen=True)
class Usage:
    """Of one process now: resident memory (MB), open descriptors, threads, processor time since it began (s)."""

    memory: float
    descriptors: int
    threads: int
    cpu: float


def node_processes(folder: Path, names: Collection[str]) -> dict[str, int]:
    """Process ids of the nodes that were started with the parameters in `folder`, by node."""
    mark, found = str(folder / "parameters.yaml").encode(), {}
    for process in Path("/proc").glob("[0-9]*"):
        try:
            words = (process / "cmdline").read_bytes().split(b"\0")
        except OSError:  # it has ended
            continue
        if mark in words:
            (name,) = [name for name in names if any(word.endswith(f"/{name}".encode()) for word in words)]
            found[name] = int(process.name)
    return found


def usage(process: int) -> Usage:
    """What a process takes; raises `OSError` if it has ended."""
    home = Path("/proc") / str(process)
    lines = (line.split(":", 1) for line in (home / "status").read_text().splitlines())
    status = {name: value.split() for name, value in lines}
    user, system = (home / "stat").read_text().rpartition(")")[2].split()[11:13]
    return Usage(
        memory=int(status["VmRSS"][0]) / KILOBYTES_PER_MB,
        descriptors=len(list((home / "fd").iterdir())),
        threads=int(status["Threads"][0]),
        cpu=(int(user) + int(system)) / os.sysconf("SC_CLK_TCK"),
    )

"""Which fault comes when: drawn from a seed and the fault's number alone, so that a campaign can be resumed."""

import json
import random
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

RESULTS = "faults.jsonl"

Kind = Literal["kill", "terminate", "stop", "full disk", "messages"]

NODES = ("simulator", "controller", "trainer", "recorder")
SECOND = "recorder2"  # begins with its fault, which ends it
KINDS: dict[Kind, float] = {"kill": 0.32, "terminate": 0.12, "stop": 0.28, "full disk": 0.04, "messages": 0.24}
WRITERS = ("recorder", "trainer")  # whose disk may be full
HEARERS = ("simulator", "controller", "trainer")
LONGEST_STOP = 3.0  # s, longer than the simulator waits for an answer
LONGEST_ABSENCE = 2.0  # s between the end of a node and its new start
LONGEST_WAIT = 20  # ticks before the fault


@dataclass(frozen=True)
class Fault:
    """One fault.

    `after_ticks` since the graph recovered from the one before, or since the second recorder began; `seconds` that a
    node is stopped or away, or for which wrong messages come.
    """

    number: int
    kind: Kind
    node: str
    after_ticks: int
    seconds: float


def draw(seed: int, number: int) -> Fault:
    """Fault `number` of a campaign."""
    rng = random.Random(f"{seed}-{number}")
    (kind,) = rng.choices(list(KINDS), list(KINDS.values()))
    nodes: dict[Kind, tuple[str, ...]] = {"full disk": WRITERS, "messages": HEARERS, "stop": NODES}
    node = rng.choice(nodes.get(kind, (*NODES, SECOND)))
    longest = {"stop": LONGEST_STOP, "messages": 1.0}.get(kind, LONGEST_ABSENCE)
    return Fault(number, kind, node, rng.randint(0, LONGEST_WAIT), rng.uniform(0.0, longest))


def read_results(out: Path) -> list[dict[str, Any]]:
    """What was done already; a line that a killed campaign has cut is left out."""
    path = out / RESULTS
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True) if path.exists() else []
    return [json.loads(line) for line in lines if line.endswith("\n")]

"""Which fault comes when: drawn from a seed and the fault's number alone, so that a campaign can be resumed."""

import random
from dataclasses import dataclass
from typing import Literal

Kind = Literal["kill", "terminate", "stop", "full disk", "messages"]

NODES = ("simulator", "controller", "trainer", "recorder")
SECOND = "second recorder"  # begins with its fault, which ends it
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

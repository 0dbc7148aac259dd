"""Which fault comes when: drawn from a seed and the fault's number alone, so that a campaign can be resumed."""

import random
from dataclasses import dataclass
from typing import Literal

Kind = Literal["kill", "terminate", "stop", "full disk", "messages"]

NODES = ("simulator", "controller", "trainer", "recorder")
KINDS: dict[Kind, float] = {"kill": 0.32, "terminate": 0.12, "stop": 0.28, "full disk": 0.04, "messages": 0.24}
WRITERS = ("recorder", "trainer")  # whose disk may be full
HEARERS = ("simulator", "controller", "trainer")
LONGEST_STOP = 5.0  # s, longer than the simulator waits for an answer
LONGEST_ABSENCE = 4.0  # s between the end of a node and its new start
LONGEST_WAIT = 80  # ticks before the fault


@dataclass(frozen=True)
class Fault:
    """One fault.

    `after_ticks` since the graph recovered from the one before; `seconds` that a node is stopped or away, or for which
    wrong messages come.
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
    node = rng.choice({"full disk": WRITERS, "messages": HEARERS}.get(kind, NODES))
    longest = {"stop": LONGEST_STOP, "messages": 1.0}.get(kind, LONGEST_ABSENCE)
    return Fault(number, kind, node, rng.randint(0, LONGEST_WAIT), rng.uniform(0.0, longest))

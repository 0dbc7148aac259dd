"""What becomes of a claim of the paper, from plain yes-or-no parts of it."""

from collections.abc import Mapping
from enum import StrEnum


class Verdict(StrEnum):
    """Of a claim."""

    REPRODUCED = "reproduced"
    PARTLY = "partly"
    NOT = "not"
    NOTHING = "shows nothing"  # the nominal controller passes too, so that learning is not what did it
    OPEN = "no claim"  # ours, beside the paper


def judge(parts: Mapping[str, bool], nominal_passes: bool = False) -> Verdict:
    """All parts hold: reproduced, or shows nothing where the nominal controller passes as well. Some: partly.

    Raises:
        ValueError: no parts.
    """
    if not parts:
        raise ValueError("parts: expected at least one")
    if not any(parts.values()):
        return Verdict.NOT
    if not all(parts.values()):
        return Verdict.PARTLY
    return Verdict.NOTHING if nominal_passes else Verdict.REPRODUCED


def missing(parts: Mapping[str, bool]) -> str:
    """Which parts do not hold, in words; nothing where all do."""
    wrong = [name for name, holds in parts.items() if not holds]
    return "not: " + "; ".join(wrong) if wrong else ""

"""What a picture of a system is made of: lines and discs in the plane, m."""

from dataclasses import dataclass

from rabbit_description.state import Array


@dataclass(frozen=True)
class Line:
    """Through `points` (k, 2)."""

    points: Array
    colour: str = "black"
    width: float = 3.0  # points


@dataclass(frozen=True)
class Disc:
    """Around `centre` (2,)."""

    centre: Array
    radius: float
    colour: str = "tab:red"


Shape = Line | Disc

"""When and where a foot comes down: by its force on a stone's top, or by falling into a gap.

A foot over a stone is never in a gap, however deep it sinks and however little it carries: the stone is under it.
"""

from collections.abc import Callable, Sequence
from math import ceil, inf
from typing import Any

from rabbit_description.state import Leg

from rabbit_sim.kinematics import Point
from rabbit_sim.plant import CLEAR_HEIGHT, CONTACT_FORCE, Touch
from rabbit_sim.terrain import Ground

FASTEST_FALL = 0.005  # m a substep, 5 m/s; while a foot is high enough for it, nobody looks
EDGE_DEPTH = 0.005  # m, a first contact deeper below the top than this is with a stone's side
LEGS = Leg.LEFT, Leg.RIGHT

Feet = tuple[Point, Point]  # left, right


class TouchdownDetector:
    """Watches both feet substep by substep. `locate` gives their true positions; `ground` is what is under them."""

    def __init__(self, locate: Callable[[], Feet]) -> None:
        self._locate = locate
        self.ground = Ground()
        self.clear: Any = [False, False]  # been high since the last contact, so that it can come down
        self.crossings: list[Touch | None] = [None, None]  # of feet that have just gone below the ground
        self.touches: list[Touch] = []

    def begin_tick(self, feet: Feet) -> None:
        """Forget the last tick's touches; `feet` are where they are now."""
        self.touches = []
        for leg in LEGS:
            x, z = feet[leg]
            self.clear[leg] = self.clear[leg] or z - self.ground.level(x) > CLEAR_HEIGHT
        self._see(feet)

    def substep(self, forces: Sequence[Sequence[float]]) -> None:
        """Take in the forces (rows left, right; columns x, z; N) of the substep that has just ended."""
        for leg in LEGS:
            if forces[leg][1] > CONTACT_FORCE:
                if self.clear[leg]:
                    feet = self._locate()
                    x, z = feet[leg]
                    hold = z - self.ground.top(x) > -EDGE_DEPTH
                    self._touch(Touch(leg, x, feet[leg.other][0], hold))
                self.clear[leg] = False
        self._unseen -= 1
        if self._unseen <= 0:
            self._watch_heights()

    def _watch_heights(self) -> None:
        """Over a gap an engine may stop a foot at an edge once it is below the mouth: one that goes on has no stone."""
        feet = self._locate()
        for leg in LEGS:
            crossing = self.crossings[leg]
            if crossing is not None and self.clear[leg]:
                self._touch(crossing)
            x, z = feet[leg]
            if self.clear[leg] and not self.ground.is_under(x) and z < (mouth := self.ground.mouth(x)):
                above = self._last[leg][1] - mouth
                share = above / (above - (z - mouth)) if above > 0 else 0.0
                along = [start[0] + share * (end[0] - start[0]) for start, end in zip(self._last, feet, strict=True)]
                self.crossings[leg] = Touch(leg, along[leg], along[leg.other], hold=False)
        self._see(feet)

    def _see(self, feet: Feet) -> None:
        """Look again in the substep before the first in which a clear foot may be below the highest top."""
        self._last = feet
        height = min(feet[leg][1] - self.ground.highest if self.clear[leg] else inf for leg in LEGS)
        self._unseen = max(ceil(height / FASTEST_FALL) - 1, 1) if height < inf else inf

    def _touch(self, touch: Touch) -> None:
        self.touches.append(touch)
        self.clear[touch.leg] = False
        self.crossings[touch.leg] = None

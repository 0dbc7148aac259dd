"""When and where a foot comes down: by its force on a stone, or by falling below the ground's height over a gap."""

from collections.abc import Callable, Sequence

from rabbit_description.state import Array, Leg

from rabbit_sim.plant import CLEAR_HEIGHT, CONTACT_FORCE, Touch

NEAR_HEIGHT = 0.05  # m, a foot below it may reach the ground within the tick
EDGE_DEPTH = 0.005  # m, a first contact deeper than this is with a stone's side


class TouchdownDetector:
    """Watches both feet substep by substep. `locate` gives their true positions, (2, 2): rows left, right; x, z."""

    def __init__(self, locate: Callable[[], Array]) -> None:
        self._locate = locate
        self._clear = [False, False]
        self._crossings: list[Touch | None] = [None, None]  # of feet that have just gone below the ground
        self.touches: list[Touch] = []

    def begin_tick(self, feet: Array) -> None:
        """Forget the last tick's touches; `feet` are where they are now."""
        self.touches = []
        heights = feet[:, 1].tolist()
        for leg in Leg:
            self._clear[leg] |= heights[leg] > CLEAR_HEIGHT
        self._near = any(self._clear[leg] and heights[leg] < NEAR_HEIGHT for leg in Leg)
        self._last = feet

    def substep(self, forces: Sequence[Sequence[float]]) -> None:
        """Take in the forces (rows left, right; columns x, z; N) of the substep that has just ended."""
        for leg in Leg:
            if forces[leg][1] > CONTACT_FORCE:
                if self._clear[leg]:
                    feet = self._locate()
                    self._touch(_touch(leg, feet, hold=bool(feet[leg, 1] > -EDGE_DEPTH)))
                self._clear[leg] = False
        if self._near:
            self._watch_heights()

    def _watch_heights(self) -> None:
        """The engine stops a foot only once it is below the ground: one that stays there has no stone."""
        feet = self._locate()
        for leg in Leg:
            crossing = self._crossings[leg]
            if crossing is not None and self._clear[leg]:
                self._touch(crossing)
            if self._clear[leg] and feet[leg, 1] < 0:
                share = self._last[leg, 1] / (self._last[leg, 1] - feet[leg, 1])
                self._crossings[leg] = _touch(leg, self._last + share * (feet - self._last), hold=False)
        self._last = feet

    def _touch(self, touch: Touch) -> None:
        self.touches.append(touch)
        self._clear[touch.leg] = False
        self._crossings[touch.leg] = None


def _touch(leg: Leg, feet: Array, hold: bool) -> Touch:
    return Touch(leg, float(feet[leg, 0]), float(feet[leg.other, 0]), hold)

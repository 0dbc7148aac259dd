"""When and where a foot comes down: by its force on a stone, or by falling below the ground's height over a gap."""

from collections.abc import Callable, Sequence

from rabbit_description.state import Array, Leg

from rabbit_sim.plant import CONTACT_FORCE, SUBSTEPS, Touch

CLEAR_SUBSTEPS = SUBSTEPS  # substeps without contact after which a foot is clear
RISEN_HEIGHT = 0.001  # m, only a foot that has been higher can fall into a gap
NEAR_HEIGHT = 0.05  # m, a foot below it may reach the ground within the tick
EDGE_DEPTH = 0.005  # m, a first contact deeper than this is with a stone's side


class TouchWatch:
    """Watches both feet substep by substep. `locate` gives their true positions, (2, 2): rows left, right; x, z."""

    def __init__(self, locate: Callable[[], Array]) -> None:
        self._locate = locate
        self._free_substeps = [0, 0]
        self._risen = [False, False]
        self._crossing: list[float | None] = [None, None]  # x where a foot has just gone below the ground
        self._last = locate()
        self.touches: list[Touch] = []

    def begin_tick(self, feet: Array) -> None:
        """Forget the last tick's touches; `feet` are where they are now."""
        self.touches = []
        heights = feet[:, 1].tolist()
        for leg in Leg:
            self._risen[leg] |= heights[leg] > RISEN_HEIGHT
        self._near = any(self._risen[leg] and heights[leg] < NEAR_HEIGHT for leg in Leg)
        self._last = feet

    def substep(self, forces: Sequence[Sequence[float]]) -> None:
        """Take in the forces (rows left, right; columns x, z; N) of the substep that has just ended."""
        if self._near:
            self._watch_heights(forces)
        for leg in Leg:
            if forces[leg][1] <= CONTACT_FORCE:
                self._free_substeps[leg] += 1
                continue
            if self._free_substeps[leg] >= CLEAR_SUBSTEPS:
                self._land(leg)
            self._free_substeps[leg] = 0
            self._risen[leg] = False

    def _watch_heights(self, forces: Sequence[Sequence[float]]) -> None:
        """A foot below the ground for a whole substep without a force has no stone: the engine sees overlaps late."""
        feet = self._locate()
        for leg in Leg:
            crossing = self._crossing[leg]
            if crossing is not None and forces[leg][1] <= CONTACT_FORCE:
                self.touches.append(Touch(leg, crossing, hold=False))
                self._risen[leg] = False
            below = self._risen[leg] and feet[leg, 1] < 0
            self._crossing[leg] = _ground_crossing(self._last[leg], feet[leg]) if below else None
        self._last = feet

    def _land(self, leg: Leg) -> None:
        x, z = self._locate()[leg]
        self.touches.append(Touch(leg, float(x), hold=bool(z > -EDGE_DEPTH)))


def _ground_crossing(above: Array, below: Array) -> float:
    """World x where the way from one (x, z) to the other passes z = 0."""
    share = above[1] / (above[1] - below[1])
    return float(above[0] + share * (below[0] - above[0]))

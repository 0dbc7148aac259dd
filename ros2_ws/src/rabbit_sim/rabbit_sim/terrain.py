"""Where the stones lie in the world, and the one that is seen."""

from rabbit_description.state import StonePreview

from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.plant import Span
from rabbit_sim.stones import Stone

GROUND = Span(-10.0, 4000.0)  # m, all the ground there is on flat terrain
PLATFORM_START = -1.0  # m, the platform behind the first stance foot
KEPT_STONES = 3  # one under the trailing foot, one under the stance foot, the next


class Terrain:
    """Stones placed one at a time. `placed`: edges of all so far, world x, m. On flat ground there is no stone."""

    def __init__(self, parameters: SimulationParameters, course: list[Stone]) -> None:
        self._absolute = parameters.stone_placement == "absolute"
        self._flat = parameters.terrain == "flat"
        self._course = course
        self._previews_height = parameters.height_preview
        half = parameters.stone_width / 2
        self.placed: list[Span] = [GROUND if self._flat else Span(PLATFORM_START, half)]
        self._middle = 0.0  # of the last stone placed, m

    @property
    def present(self) -> list[Span]:
        """The stones in reach: those far behind are taken away."""
        return self.placed[-KEPT_STONES:]

    def place_next(self, index: int, foot: float) -> StonePreview | None:
        """Place stone `index` (from 1) for the stance foot at world x = `foot`, m; None where there is none."""
        if self._flat or index > len(self._course):
            return None
        stone = self._course[index - 1]
        origin = self._middle if self._absolute else foot
        near, far = origin + stone.l_min, origin + stone.l_max
        self._middle = (near + far) / 2
        height = stone.height - self.placed[-1].top if self._previews_height else 0.0
        self.placed.append(Span(near, far, stone.height))
        return StonePreview(index, near - foot, far - foot, height)

    def drop(self, index: int, depth: float) -> None:
        """Stone `index` gives way: its top is lower by `depth`, m."""
        stone = self.placed[index]
        self.placed[index] = stone._replace(top=stone.top - depth)

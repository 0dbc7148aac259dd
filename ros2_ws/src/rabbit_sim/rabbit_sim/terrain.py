"""Where the stones lie in the world, the one that is seen, and what is under a foot."""

from collections.abc import Sequence

from rabbit_description.state import StonePreview

from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.plant import FOOT_RADIUS, Span
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


class Ground:
    """The stones as the judges see them; heights are of a foot's centre on a top that carries nothing, m."""

    def __init__(self, spans: Sequence[Span] = ()) -> None:
        self._spans = list(spans)
        self.highest = max((span.top for span in spans), default=0.0)

    def is_under(self, x: float) -> bool:
        """Whether a stone is under a foot's centre at `x`; the foot's own radius at each edge belongs to it."""
        return any(span.near - FOOT_RADIUS <= x <= span.far + FOOT_RADIUS for span in self._spans)

    def top(self, x: float) -> float:
        """The top of the stone under or nearest to `x`; of several the highest; 0 without stones."""
        if not self._spans:
            return 0.0
        return -min((max(span.near - x, x - span.far, 0.0), -span.top) for span in self._spans)[1]

    def below(self, x: float) -> float:
        """The height at `x` of the line over all tops: along a stone its top, over a gap straight from edge to edge."""
        behind, ahead = self._beside(x)
        on_stone = any(span.near <= x <= span.far for span in self._spans)
        if on_stone or behind is None or ahead is None:
            return self.top(x)
        return behind.top + (ahead.top - behind.top) * (x - behind.far) / (ahead.near - behind.far)

    def mouth(self, x: float) -> float:
        """Below this height a foot over a gap is in it: the lower of the tops to both sides."""
        return min((span.top for span in self._beside(x) if span), default=0.0)

    def level(self, x: float) -> float:
        """The top under `x`, or the mouth of the gap there."""
        return self.top(x) if self.is_under(x) else self.mouth(x)

    def _beside(self, x: float) -> tuple[Span | None, Span | None]:
        """The last stone that ends before `x`, and the first that begins after it."""
        behind = max((span for span in self._spans if span.far <= x), default=None, key=lambda span: span.far)
        ahead = min((span for span in self._spans if span.near >= x), default=None, key=lambda span: span.near)
        return behind, ahead

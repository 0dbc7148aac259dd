"""The stones as the judges see them: which one is under a foot, how high its top is, where a gap begins."""

from collections.abc import Sequence

from rabbit_sim.plant import FOOT_RADIUS, Span


class Ground:
    """Stones whose tops are rigid or give; heights are of a foot's centre on a top that carries nothing, m."""

    def __init__(self, spans: Sequence[Span] = ()) -> None:
        self._spans = list(spans)
        self.highest = max((span.top for span in spans), default=0.0)

    def is_under(self, x: float) -> bool:
        """Whether a stone is under a foot's centre at `x`; the foot's own radius at each edge belongs to it."""
        return any(span.near - FOOT_RADIUS <= x <= span.far + FOOT_RADIUS for span in self._spans)

    def top(self, x: float) -> float:
        """Of the stone under or nearest to `x`; of several the highest; 0 without stones."""
        if not self._spans:
            return 0.0
        return -min((max(span.near - x, x - span.far, 0.0), -span.top) for span in self._spans)[1]

    def below(self, x: float) -> float:
        """Of the line over all tops at `x`: along a stone its top, over a gap straight from one edge to the other."""
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

"""A stone that gives way."""

from typing import Annotated

from rabbit_sim.perturbation import ENGINES_ALONE, Control, Number, Perturbation, setting
from rabbit_sim.plant import HIGHEST_TOP


class LooseStone(Perturbation):
    """Its top drops in the tick of the touchdown, and the foot falls onto it. Nothing of it is previewed."""

    loose_stone: Annotated[int, ENGINES_ALONE] = setting(
        0,
        0,
        4000,
        "stone that gives way under the first foot on it; 0: none",
        Control("stone that gives way, 0: none", high=200, at_reset=True),
    )
    loose_depth: Number = setting(
        0.02, 0.001, HIGHEST_TOP, "depth by which the loose stone drops, m", Control("by", 0.001, "m", at_reset=True)
    )

    def drop(self, stone: int, offset: float) -> float:
        return self.loose_depth if 0 < self.loose_stone == stone else 0.0

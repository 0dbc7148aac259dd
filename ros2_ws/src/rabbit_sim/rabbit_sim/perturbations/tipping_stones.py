"""Stones that tip about their middle: the farther from it a foot stands, the lower."""

from math import radians, tan
from typing import Annotated

from rabbit_sim.perturbation import ENGINES_ALONE, Control, Number, Perturbation, setting


class TippingStones(Perturbation):
    """A stone's top drops by |offset| tan(angle) in the tick of the touchdown. Nothing of it is previewed."""

    stone_tilt: Annotated[Number, ENGINES_ALONE] = setting(
        0.0,
        0,
        45,
        "angle by which each stone tips under a foot, degrees",
        Control("stones tip by", 1, "degrees", at_reset=True),
    )

    def drop(self, stone: int, offset: float) -> float:
        return abs(offset) * tan(radians(self.stone_tilt))

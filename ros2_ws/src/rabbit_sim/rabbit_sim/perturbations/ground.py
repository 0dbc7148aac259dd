"""The true ground: friction, softness and slope; stones that give way."""

from math import radians, tan
from typing import Annotated

from rabbit_sim.perturbation import ENGINES_ALONE, Control, EngineNumber, Number, Perturbation, setting
from rabbit_sim.plant import HIGHEST_TOP

# A foot's rubber. A rigid contact has two answers where friction carries the leg (Painleve): an engine's iteration
# starts at no force and may stay there, so a standing foot lets go. Compliance leaves the one that presses.
RUBBER_STIFFNESS = 1e6  # N/m
RUBBER_DAMPING = 3e4  # N s/m; impacts are inelastic: with less the rubber throws the foot back


class Ground(Perturbation):
    """Read by the plants where they make contact and gravity; the engines have a contact whatever the fields say."""

    ground_friction: Number = setting(
        1.5, 1e-6, 5, "Coulomb coefficient of the true ground", Control("friction", 0.05, low=0.2, high=2, first=True)
    )
    ground_stiffness: EngineNumber = setting(
        RUBBER_STIFFNESS,
        1e4,
        RUBBER_STIFFNESS,
        "stiffness of ground and foot together, N/m",
        Control("ground stiffness", 1e4, "N/m"),
    )
    ground_damping: EngineNumber = setting(
        RUBBER_DAMPING,
        0,
        RUBBER_DAMPING,
        "damping of ground and foot together, N s/m",
        Control("ground damping", 500, "N s/m"),
    )
    friction_spread: EngineNumber = setting(
        0.0, 0, 1, "share of the friction that a stone or a step may lack", Control("friction varies", 0.05)
    )
    slope: Number = setting(
        0.0, -20, 20, "rise of the ground, unknown to the controller, degrees", Control("slope", 0.5, "degrees")
    )


class LooseStone(Perturbation):
    """A stone's top drops in the tick of the touchdown, and the foot falls onto it. Nothing of it is previewed."""

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


class TippingStones(Perturbation):
    """Each stone's top drops by |offset| tan(angle) in the tick of the touchdown. Nothing of it is previewed."""

    stone_tilt: EngineNumber = setting(
        0.0,
        0,
        45,
        "angle by which each stone tips under a foot, degrees",
        Control("stones tip by", 1, "degrees", at_reset=True),
    )

    def drop(self, stone: int, offset: float) -> float:
        return abs(offset) * tan(radians(self.stone_tilt))

"""The true ground: its friction, its softness and its slope. The engines have a contact whatever the fields say."""

from rabbit_sim.perturbation import Control, EngineNumber, Number, Perturbation, setting

# A foot's rubber. A rigid contact has two answers where friction carries the leg (Painleve): an engine's iteration
# starts at no force and may stay there, so a standing foot lets go. Compliance leaves the one that presses.
RUBBER_STIFFNESS = 1e6  # N/m
RUBBER_DAMPING = 3e4  # N s/m; impacts are inelastic: with less the rubber throws the foot back


class Ground(Perturbation):
    """Read by the plants where they make contact and gravity."""

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
    slope: Number = setting(
        0.0, -20, 20, "rise of the ground, unknown to the controller, degrees", Control("slope", 0.5, "degrees")
    )

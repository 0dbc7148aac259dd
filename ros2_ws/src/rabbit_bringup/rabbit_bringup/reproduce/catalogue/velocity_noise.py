"""Noise of the measured joint rates (Discussion: numerical differentiation "could be noisy in experiments")."""

from collections.abc import Sequence
from typing import ClassVar

from rabbit_bringup.reproduce.contenders import CBF_CLF, CBF_CLF_ORACLE, RL_CBF_CLF
from rabbit_bringup.reproduce.lines import Found
from rabbit_bringup.reproduce.report import Claim
from rabbit_bringup.reproduce.sweep import Sweep, largest_text
from rabbit_bringup.reproduce.verdict import Verdict


class VelocityNoise(Sweep):
    """White, drawn anew each tick."""

    name = "velocity-noise"
    title = "Noise of the measured rates, stepping stones"
    label = "sec:discussion"
    paper = "Measured derivatives could be noisy in experiments; no figure is given."
    field = "velocity_noise"
    values = (0.0, 0.02, 0.05, 0.1, 0.2, 0.4)
    plants: ClassVar = {RL_CBF_CLF: {"mass_scale": 2.0}, CBF_CLF_ORACLE: {"mass_scale": 2.0}, CBF_CLF: {}}
    axis = "standard deviation of the measured rates (rad/s)"
    caption = (
        "Courses of 20 stones walked over the noise; learned and oracle at scale 2, nominal at scale 1; 95% intervals."
    )

    def claims(self, found: Found) -> Sequence[Claim]:
        """How much each takes."""
        return [
            Claim(
                claim=f"noise that {each.title} takes (scale {plant.get('mass_scale', 1.0):g})",
                paper="-",
                ours=largest_text(self.walks(found, each), self.scale, "rad/s"),
                verdict=Verdict.OPEN,
            )
            for each, plant in self.plants.items()
        ]

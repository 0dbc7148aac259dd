"""Dead time of the motors, which the paper does not have."""

from collections.abc import Sequence
from typing import ClassVar

from rabbit_bringup.reproduce.contenders import CBF_CLF, CBF_CLF_ORACLE, RL_CBF_CLF
from rabbit_bringup.reproduce.lines import Found
from rabbit_bringup.reproduce.report import Claim
from rabbit_bringup.reproduce.sweep import Sweep, largest_text
from rabbit_bringup.reproduce.verdict import Verdict


class Delay(Sweep):
    """Beside the motors' lag."""

    name = "delay"
    title = "Delay of the torque, stepping stones"
    label = "further"
    paper = "nothing; it has a motor lag of 4 ms."
    field = "torque_delay"
    values = (0.0, 0.002, 0.004, 0.006, 0.008)
    plants: ClassVar = {RL_CBF_CLF: {"mass_scale": 2.0}, CBF_CLF_ORACLE: {"mass_scale": 2.0}, CBF_CLF: {}}
    axis = "delay of the torque (ms)"
    scale = 1e3
    caption = (
        "Courses of 20 stones walked over the delay; learned and oracle at scale 2, nominal at scale 1; 95% intervals."
    )

    def claims(self, found: Found) -> Sequence[Claim]:
        """How much each takes."""
        return [
            Claim(
                claim=f"delay that {each.title} takes (scale {plant.get('mass_scale', 1.0):g})",
                paper="-",
                ours=largest_text(self.walks(found, each), self.scale, "ms"),
                verdict=Verdict.OPEN,
            )
            for each, plant in self.plants.items()
        ]

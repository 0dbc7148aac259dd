"""Less mass than the model believes: scales 0.7 and 0.5 (Discussion), with the policies trained at scale 2."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from rabbit_description.state import TICK_SECONDS

from rabbit_bringup.reproduce.contenders import CBF_CLF, CBF_CLF_ORACLE, CLF, CLF_ORACLE, RL_CBF_CLF, RL_CLF, Contender
from rabbit_bringup.reproduce.experiment import Experiment
from rabbit_bringup.reproduce.lines import Found, Line
from rabbit_bringup.reproduce.report import Claim
from rabbit_bringup.reproduce.verdict import judge
from rabbit_bringup.reproduce.walks import Walks

WHO = {"flat": (RL_CLF, CLF, CLF_ORACLE), "stones": (RL_CBF_CLF, CBF_CLF, CBF_CLF_ORACLE)}
SCALES = (0.7, 0.5)
AT_ONCE = 2.0  # steps, mean, within which "fails after just one step" counts as the same


class SmallMass(Experiment):
    """The paper trained at 0.7; here the scale-2 policies are asked, an error of the other sign."""

    name = "small-mass"
    title = "Mass scales 0.7 and 0.5, policies trained at 2"
    label = "sec:discussion"
    paper = (
        "At scale 0.7, trained there, it walks indefinitely within its constraints, and the nominal controller fails "
        "after one step. At 0.5 the nominal controller lasts 0.06 s and the method fails."
    )

    @cached_property
    def grid(self) -> dict[tuple[float, Contender], Line]:
        """A line for each scale and controller."""
        return {
            (scale, each): Line(f"{each.title}, scale {scale:g}", each.assembly(mass_scale=scale))
            for scale in SCALES
            for row in WHO.values()
            for each in row
        }

    def lines(self) -> Sequence[Line]:
        return list(self.grid.values())

    def claims(self, found: Found) -> Sequence[Claim]:
        """The learned controllers, and the nominal ones."""
        walks = {key: found.walks(line) for key, line in self.grid.items()}
        return [claim for terrain in WHO for claim in self._on(terrain, walks)]

    def _on(self, terrain: str, walks: dict[tuple[float, Contender], Walks]) -> list[Claim]:
        learned, nominal, oracle = WHO[terrain]
        at_7, at_5 = ({each: walks[scale, each] for each in WHO[terrain]} for scale in SCALES)
        lasted = float(np.median([row.ticks for row in at_5[nominal].rows])) * TICK_SECONDS
        return [
            Claim(
                claim=f"{learned.title} walks at scale 0.7 (the paper's was trained there)",
                paper="indefinitely",
                ours=f"{at_7[learned].text}; nominal {at_7[nominal].text}, oracle {at_7[oracle].text}",
                verdict=judge({"walks": at_7[learned].passes}, at_7[nominal].passes),
            ),
            Claim(
                claim=f"{nominal.title} fails at once at scale 0.7",
                paper="fails after one step",
                ours=at_7[nominal].text,
                verdict=judge(
                    {"fails": not at_7[nominal].passes, "at once": at_7[nominal].mean_stones <= AT_ONCE},
                ),
            ),
            Claim(
                claim=f"scale 0.5 is beyond {learned.title}",
                paper="nominal lasts 0.06 s, the method fails",
                ours=f"{at_5[learned].text}; nominal lasts {lasted:.2f} s, oracle {at_5[oracle].text}",
                verdict=judge({"fails": not at_5[learned].passes, "nominal fails": not at_5[nominal].passes}),
            ),
        ]

"""The largest payload with which each controller still walks on flat ground (Simulation 1)."""

from collections.abc import Sequence
from typing import ClassVar

from rabbit_experiments.reproduce.controllers import CLF, CLF_ORACLE, FLAT, IO_RL, RL_CLF, Contender
from rabbit_experiments.reproduce.report import Claim
from rabbit_experiments.reproduce.sweep import Sweep, largest_text
from rabbit_experiments.reproduce.table_lines import Found
from rabbit_experiments.reproduce.verdict import judge

PAPER = {RL_CLF: 72.0, IO_RL: 53.0}  # kg
LEAST = 32.0  # kg, of [fig:clf-torso-results]; the nominal controller may well carry less


class PayloadFlat(Sweep):
    """Also the oracle, for what the gait and the QP allow."""

    name = "payload-flat"
    title = "Largest payload, flat ground"
    label = "sec:results, Simulation 1"
    paper = "RL-CLF-QP walks with up to 72 kg on the torso (225% of the robot's mass), IO-RL + CLF-QP with up to 53 kg."
    why = (
        "The policies were trained at scale 2 and ask for more than a robot of scale 1 needs. RL-CLF-QP has no "
        "row for the ground's force: in PyBullet it lifts the stance foot, without a payload too. On `rigid`, "
        "whose stance foot is pinned, it cannot, as in the paper. IO-RL + CLF-QP adds what it has learned at "
        "scale 2, whatever the plant. With exact estimates the QP keeps to the gait, whose orbit needs the ground "
        "to pull under payload (docs/gaits.md)."
    )
    judged_on_rigid = True
    field = "payload"
    values = (0.0, 8.0, 16.0, 24.0, 32.0, 40.0, 48.0, 53.0, 56.0, 64.0, 72.0, 80.0)
    plants: ClassVar = {each: {} for each in (*FLAT, CLF_ORACLE)}
    nominal = CLF
    axis = "payload on the torso (kg)"
    caption = (
        "Courses of 20 steps walked over the payload, plant at scale 1, policies trained at scale 2; 95% intervals."
    )
    paper_values: ClassVar = {(each, most): f"up to {most:g} kg" for each, most in PAPER.items()}

    def claims(self, found: Found) -> Sequence[Claim]:
        """How far each comes."""
        return [self._claim(found, each) for each in PAPER]

    def _claim(self, found: Found, contender: Contender) -> Claim:
        walks, nominal = self.walks(found, contender), self.walks(found, CLF)
        most = PAPER[contender]
        inside = [value for value in self.values if LEAST <= value <= most]
        parts = {f"{value:g} kg": walks[value].passes for value in inside}
        unit = "kg"
        return Claim(
            claim=f"{contender.title} walks with {LEAST:g} to {most:g} kg",
            paper=f"up to {most:g} kg",
            ours=f"{largest_text(walks, 1, unit)}; nominal {largest_text(nominal, 1, unit)}",
            verdict=judge(parts, all(nominal[value].passes for value in inside)),
        )

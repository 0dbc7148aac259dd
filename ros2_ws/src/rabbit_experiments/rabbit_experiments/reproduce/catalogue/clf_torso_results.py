"""32 kg on the torso, flat ground, ten steps [fig:clf-torso-results]."""

from collections.abc import Sequence
from typing import ClassVar

from rabbit_experiments.reproduce.report import Claim
from rabbit_experiments.reproduce.table_lines import Found
from rabbit_experiments.reproduce.ten_steps import TenSteps


class ClfTorsoResults(TenSteps):
    """An error that no policy has been trained on."""

    name = "clf-torso-results"
    title = "32 kg on the torso, flat ground, ten steps"
    label = "fig:clf-torso-results"
    paper = "RL-CLF-QP and IO-RL + CLF-QP walk with 32 kg on the torso (100% of the robot's mass), untrained on it."
    why = "See payload-flat."
    judged_on_rigid = True
    plant: ClassVar = {"payload": 32.0}

    def claims(self, found: Found) -> Sequence[Claim]:
        """Who walks."""
        return self.walking_claims(found)

"""The payloads with which each controller still walks: on flat ground (Simulation 1), over stones (Simulation 2)."""

from typing import ClassVar

from rabbit_experiments.summary import ENOUGH

from rabbit_reproduce.controllers import (
    CBF_CLF,
    CBF_CLF_ORACLE,
    CLF,
    CLF_ORACLE,
    FLAT,
    IO_RL,
    RL_CBF_CLF,
    RL_CLF,
    STONES,
)
from rabbit_reproduce.experiment import Sweep
from rabbit_reproduce.report import Claim, missing
from rabbit_reproduce.table_lines import Results

PAPER = {RL_CLF: 72.0, IO_RL: 53.0}  # kg
LEAST = 32.0  # kg, of [fig:clf-torso-results]; the nominal controller may well carry less
RANGE = (43.0, 72.0)  # kg


class PayloadFlat(Sweep):
    """How much each carries on flat ground: plants at scale 1, policies trained at scale 2; the oracle beside."""

    name = "payload-flat"
    plants: ClassVar = {contender: {} for contender in (*FLAT, CLF_ORACLE)}
    paper_values: ClassVar = {(contender, most): f"up to {most:g} kg" for contender, most in PAPER.items()}

    def claims(self, results: Results) -> list[Claim]:
        """How far each comes."""
        nominal, best, claims = self.row(results, CLF), self.row_at_best(results, CLF), []
        for contender, most in PAPER.items():
            walks = self.row(results, contender)
            inside = [value for value in self.values if LEAST <= value <= most]
            parts = {f"{value:g} kg": walks[value].passes for value in inside}
            ours = f"{self.largest(walks)}; nominal {self.largest(nominal)}"
            passes = all(nominal[value].passes for value in inside)
            tuned = self.largest(best), all(best[value].passes for value in inside)
            claims.append(self.claim("range", ours, parts, passes, tuned, who=contender.title, most=f"{most:g}"))
        return claims


class PayloadStones(Sweep):
    """What RL-CBF-CLF-QP carries over stones, by the same plants and policies; the oracle for what the QP allows."""

    name = "payload-stones"
    plants: ClassVar = {contender: {} for contender in (*STONES, CBF_CLF_ORACLE)}
    paper_values: ClassVar = {(RL_CBF_CLF, most): "walks" for most in RANGE}

    def claims(self, results: Results) -> list[Claim]:
        """The paper's range, stones and forces kept."""
        walks, nominal, best = (
            row(results, who) for row, who in ((self.row, RL_CBF_CLF), (self.row, CBF_CLF), (self.row_at_best, CBF_CLF))
        )
        inside = [value for value in self.values if RANGE[0] <= value <= RANGE[1]]
        parts, kept = (
            {f"{value:g} kg": row[value].with_forces >= ENOUGH * row[value].runs for value in inside}
            for row in (walks, best)
        )
        ours = (
            f"{missing(parts) or 'all of them'}; without regard to forces {self.largest(walks)}, "
            f"nominal {self.largest(nominal)}"
        )
        tuned = f"{missing(kept) or 'all of them'}; without regard to forces {self.largest(best)}", all(kept.values())
        return [self.claim("range", ours, parts, all(nominal[value].passes for value in inside), tuned)]

"""Is the nominal model's CLF a CLF of the true plant? The paper assumes it [Approach2].

At each state of the walks a linear programme looks for a torque within the motors' limits that meets the true CLF row,
V-dot <= -lambda / eps V with the true V-dot, alone and together with the true ground forces and barriers.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from rabbit_experiments.assembly import Assembly
from rabbit_experiments.evaluation import SeededRun, episode_seeds

from rabbit_reproduce.controllers import CBF_CLF, CBF_CLF_ORACLE, RL_CBF_CLF
from rabbit_reproduce.experiment import Experiment
from rabbit_reproduce.feasibility import Feasibility, JudgedWalk, share, total
from rabbit_reproduce.report import Cell, Claim, Table, judge
from rabbit_reproduce.table_lines import Found, Size

WALKERS = (CBF_CLF, RL_CBF_CLF, CBF_CLF_ORACLE)
STEPS = 5  # a walk
PLANTS: Mapping[str, dict[str, Any]] = {
    **{f"scale {scale:g}": {"mass_scale": scale} for scale in (0.5, 0.7, 1.0, 2.0, 3.0)},
    **{f"payload {load:g} kg": {"payload": load} for load in (32.0, 72.0)},
}
ROWS: Mapping[str, dict[str, bool]] = {  # of the true plant, saturation in all
    "CLF row": {"barrier_rows": False, "force_rows": False},
    "CLF row and ground forces": {"barrier_rows": False},
    "and barriers": {},
}
NEARLY_ALL = 0.99  # of the states


class ClfAssumption(Experiment):
    """The oracle's rows, judged on the states of several controllers' walks."""

    name = "clf-assumption"
    title = "States where a torque within the limits meets the true CLF row"
    label = "sec:discussion"
    paper = (
        "The nominal CLF is assumed to be a CLF of the true plant; for high levels of uncertainty it may not be one, "
        "and the method would fail, as at scale 0.5."
    )
    why = (
        "A torque that meets the true CLF row exists at scale 0.5 too. What falls there is this gait: on the "
        "library paper_stones the same exact rows walk nearly all courses, and all with an objective centred on "
        "the PD input (every-plant-stones)."
    )

    def jobs(self, size: Size) -> list[SeededRun]:
        return [job for name in PLANTS for jobs in self._jobs(size, name) for job in jobs]

    def tables(self, found: Found) -> Sequence[Table]:
        columns = ("plant", *ROWS, *(f"CLF row, {each.title}'s states" for each in WALKERS), "states")
        return (Table(name="shares", columns=columns, rows=tuple(self._row(found, name) for name in PLANTS)),)

    def claims(self, found: Found) -> Sequence[Claim]:
        """Where the paper's method works, and where it does not."""
        shares = {name: self._met(found, name) for name in PLANTS}
        ours = {name: ", ".join(f"{rows} {value:.1%}" for rows, value in met.items()) for name, met in shares.items()}
        clf = next(iter(ROWS))
        return [
            Claim(
                claim="at scale 2 a torque within the limits meets the true CLF row",
                paper="assumed",
                ours=ours["scale 2"],
                verdict=judge({"in 99% of the states": shares["scale 2"][clf] >= NEARLY_ALL}),
            ),
            Claim(
                claim="at scale 0.5 the assumption does not hold",
                paper="may not hold",
                ours=ours["scale 0.5"],
                verdict=judge({"in less than 99% of the states": shares["scale 0.5"][clf] < NEARLY_ALL}),
            ),
            Claim(
                claim="and with 72 kg on the torso",
                ours=ours["payload 72 kg"],
            ),
        ]

    def _jobs(self, size: Size, name: str) -> list[list[SeededRun]]:
        """Jobs of each walker on a plant."""
        plant: dict[str, Any] = {**PLANTS[name], "stones": STEPS}
        judges: tuple[Assembly, ...] = tuple(size.own(CBF_CLF_ORACLE.assembly(rows, **plant)) for rows in ROWS.values())
        seeds = episode_seeds(size.seed, 1 if size.quick else 3).values()
        walkers = [size.own(each.assembly(**plant)) for each in WALKERS]
        return [
            [JudgedWalk(walker, seed, judges, title=f"{self.name}, {name}") for seed in seeds] for walker in walkers
        ]

    def _walks(self, found: Found, name: str) -> list[list[Feasibility]]:
        return [[found.result(job) for job in jobs] for jobs in self._jobs(found.size, name)]

    def _met(self, found: Found, name: str) -> dict[str, float]:
        """Share of all states in which the rows can be met."""
        walks = self._walks(found, name)
        return {rows: 1 - share(walks, i, "all") for i, rows in enumerate(ROWS)}

    def _row(self, found: Found, name: str) -> tuple[Cell, ...]:
        walks = self._walks(found, name)
        by_walker = [f"{1 - share([runs], 0, 'all'):.1%}" for runs in walks]
        return (name, *(f"{value:.1%}" for value in self._met(found, name).values()), *by_walker, total(walks))

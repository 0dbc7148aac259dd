"""The Discussion: imperfections of the robot, dead time, and less mass than the model believes."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from rabbit_description.state import TICK_SECONDS
from rabbit_experiments.summary import Walks

from rabbit_reproduce.controllers import (
    CBF_CLF,
    CBF_CLF_ORACLE,
    CLF,
    CLF_ORACLE,
    RL_CBF_CLF,
    RL_CBF_CLF_LIGHT,
    RL_CLF,
    Contender,
)
from rabbit_reproduce.experiment import Experiment
from rabbit_reproduce.report import Claim, judge
from rabbit_reproduce.sweep import Sweep
from rabbit_reproduce.table_lines import MAIN, Found, Line, Runs

WHO = {"flat": (RL_CLF, CLF, CLF_ORACLE), "stones": (RL_CBF_CLF, CBF_CLF, CBF_CLF_ORACLE)}
NOMINAL = {each: row[1] for row in WHO.values() for each in row}
SCALES, SMALL = (1.0, 2.0), (0.7, 0.5)
LONG, LONG_RUNS = 1000, Runs(20, 1)  # steps that stand for "indefinitely"
AT_ONCE = 2.0  # steps, mean, within which "fails after just one step" counts as the same


@dataclass(eq=False)
class Perturbation(Experiment):
    """At scale 1 and 2, flat and on stones: `field` of the plant has `value`; `what` names it in a line."""

    name: str
    title: str
    paper: str
    field: str
    value: float
    what: str
    why: str
    label = "sec:discussion"
    judged_on_rigid = True

    @cached_property
    def by_key(self) -> dict[Any, Line]:
        """The learned controller's line and the nominal one's, by scale and terrain."""
        lines: dict[Any, Line] = {}
        for scale in SCALES:
            for terrain, (learned, nominal, _) in WHO.items():
                beside = self._line(nominal, scale, terrain)
                lines[scale, terrain, 0] = replace(self._line(learned, scale, terrain), paper="walks", nominal=beside)
                lines[scale, terrain, 1] = beside
        return lines

    def claims(self, found: Found) -> list[Claim]:
        walks = self.walks(found)
        return [
            Claim(
                claim=f"{WHO[terrain][0].title} walks with {self.what}, scale {scale:g}, {terrain}",
                paper="successful results",
                ours=f"{walks[scale, terrain, 0].text}; nominal {walks[scale, terrain, 1].text}",
                verdict=judge({"walks": walks[scale, terrain, 0].passes}, walks[scale, terrain, 1].passes),
            )
            for scale in SCALES
            for terrain in WHO
        ]

    def _line(self, contender: Contender, scale: float, terrain: str) -> Line:
        assembly = contender.assembly(**{"mass_scale": scale, self.field: self.value})
        return Line(f"{contender.title}, {self.what}, scale {scale:g}, {terrain}", assembly)


@dataclass(eq=False)
class Tolerance(Sweep):
    """How much `what` the walk over stones takes: learned and oracle at scale 2, nominal at scale 1."""

    name: str
    title: str
    label: str
    paper: str
    field: str
    values: tuple[float, ...]
    axis: str
    what: str
    scale: float = 1.0
    plants: ClassVar = {RL_CBF_CLF: {"mass_scale": 2.0}, CBF_CLF_ORACLE: {"mass_scale": 2.0}, CBF_CLF: {}}

    def __post_init__(self) -> None:
        over = f"Courses of 20 stones walked over the {self.what}"
        self.caption = f"{over}; learned and oracle at scale 2, nominal at scale 1; 95% intervals."

    def claims(self, found: Found) -> list[Claim]:
        """How much each takes."""
        return [
            Claim(
                claim=f"{self.what} that {each.title} takes (scale {plant.get('mass_scale', 1.0):g})",
                ours=self.largest(self.row(found, each)),
            )
            for each, plant in self.plants.items()
        ]


MOTOR_POWER = Perturbation(
    name="motor-power",
    title="Motor power -15%",
    paper="Joint friction as a loss of 15% of motor power: successful results.",
    why="At scale 1 a loss of 15% does not stop the nominal controllers. The policies, trained at scale 2, err by "
    "half the mass there besides: over stones they leave the cone and the stones in PyBullet; on `rigid`, "
    "whose stance foot is pinned, they walk.",
    field="motor_loss",
    value=0.15,
    what="15% less power",
)
JOINT_DAMPING = Perturbation(
    name="joint-damping",
    title="Joint damping 1 (rad/s²)/(rad/s)",
    paper="Joint damping of up to 1 (rad/s²)/(rad/s): successful results.",
    why="Damping alone does not stop the nominal controller on flat ground. At scale 1 the policies, trained at "
    "scale 2, err by half the mass besides: in PyBullet their stance foot leaves the ground, on `rigid`, "
    "where it is pinned, it cannot.",
    field="joint_damping",
    value=1.0,
    what="joints damped by 1/s",
)
LINK_BENDING = Perturbation(
    name="link-bending",
    title="Links bent by 5% of their length",
    paper="Bending of links by up to 5% of their length: successful results.",
    why="A bend of thigh and shin is, to first order, a hip that is turned and does not tell: the outputs are "
    "wrong by it, and so is where the foot lands. The rows do not say so: the oracle, exact in all of them, "
    "falls on stones as well (the benchmark), and what walks there calibrates its joints from the stance "
    "foot. How the paper bent its links, and what its outputs knew of it, is not told.",
    field="link_bend",
    value=0.05,
    what="links bent 5%",
)
VELOCITY_NOISE = Tolerance(
    name="velocity-noise",
    title="Noise of the measured rates, stepping stones",
    label="sec:discussion",
    paper="Measured derivatives could be noisy in experiments; no figure is given.",
    field="velocity_noise",
    values=(0.0, 0.02, 0.05, 0.1, 0.2, 0.4),
    axis="standard deviation of the measured rates (rad/s)",
    what="noise",
)
DELAY = Tolerance(
    name="delay",
    title="Delay of the torque, stepping stones",
    label="further",
    paper="nothing; it has a motor lag of 4 ms.",
    field="torque_delay",
    values=(0.0, 0.002, 0.004, 0.006, 0.008),
    axis="delay of the torque (ms)",
    scale=1e3,
    what="delay",
)


class SmallMass(Experiment):
    """A policy trained at 0.7, as the paper's was, and those trained at 2, an error of the other sign."""

    name = "small-mass"
    title = "Mass scales 0.7 and 0.5"
    label = "sec:discussion"
    paper = (
        "At scale 0.7, trained there, it walks indefinitely within its constraints, and the nominal controller fails "
        "after one step. At 0.5 the nominal controller lasts 0.06 s and the method fails."
    )
    why = (
        "With these gains the nominal controllers do not fail at once at 0.7: they walk on flat ground, and half "
        "of the courses of stones. The policy trained at 0.7 walks 20 stones, but of 1,000 some 90: most episodes "
        "of its training ended within a few steps (studies/docs/history/lab-notes.md), and mu'mu with exact rows loses "
        "courses of 20 there, too."
    )
    judged_on_rigid = True

    @cached_property
    def by_key(self) -> dict[Any, Line]:
        """Of 20 steps, by scale and controller; and one of a thousand."""
        who = (*WHO["flat"], *WHO["stones"], RL_CBF_CLF_LIGHT)
        lines: dict[Any, Line] = {(scale, each): self._line(scale, each) for scale in SMALL for each in who}
        assembly = RL_CBF_CLF_LIGHT.assembly(mass_scale=SMALL[0], stones=LONG)
        what = f"{RL_CBF_CLF_LIGHT.title}, scale {SMALL[0]:g}, {LONG} steps"
        return lines | {LONG: Line(what, assembly, "indefinitely", LONG_RUNS, (MAIN,))}

    def claims(self, found: Found) -> list[Claim]:
        """The learned controllers, and the nominal ones."""
        walks = {key: found.walks(line) for key, line in self.by_key.items() if key != LONG}
        return [
            *([self._trained(found.walks(self.by_key[LONG]), walks)] if found.column is MAIN else []),
            *(self._at_once(nominal, walks[SMALL[0], nominal]) for _, nominal, _ in WHO.values()),
            self._half(walks),
            *(self._untrained(scale, who, walks) for scale in SMALL for who in WHO.values()),
        ]

    def _line(self, scale: float, contender: Contender) -> Line:
        nominal = NOMINAL.get(contender, CBF_CLF)
        beside = self._line(scale, nominal) if contender is not nominal else None
        return Line(f"{contender.title}, scale {scale:g}", contender.assembly(mass_scale=scale), nominal=beside)

    def _trained(self, long: Walks, walks: dict[Any, Walks]) -> Claim:
        """The paper's claim, with a policy trained as the paper's."""
        nominal, short = walks[SMALL[0], CBF_CLF], walks[SMALL[0], RL_CBF_CLF_LIGHT]
        over, lost = long.total("ticks_over_cone"), long.total("ticks_lost")
        return Claim(
            claim=f"{self.by_key[LONG].what}, constraints kept",
            paper="indefinitely long periods, safety and friction respected",
            ours=f"{long.text} steps; over the cone and lost {over} and {lost} of {long.total('ticks')} ticks; "
            f"20 steps: {short.text}, nominal {nominal.text}",
            verdict=judge({"walks": long.passes, "keeps the forces": over + lost == 0}, nominal.passes),
        )

    def _at_once(self, nominal: Contender, mine: Walks) -> Claim:
        return Claim(
            claim=f"{nominal.title} fails at once at scale 0.7",
            paper="fails after one step",
            ours=mine.text,
            verdict=judge({"fails": not mine.passes, "at once": mine.mean_stones <= AT_ONCE}),
        )

    def _half(self, walks: dict[Any, Walks]) -> Claim:
        """Trained at 2 or 0.7, or with exact estimates, which no training can better.

        A training at 0.5 is among those of `learning-curves --retrain`.
        """
        trained, oracle, nominal = (walks[SMALL[1], each] for each in (RL_CBF_CLF_LIGHT, CBF_CLF_ORACLE, CBF_CLF))
        lasted = float(np.median([row.ticks for row in nominal.rows])) * TICK_SECONDS
        fails = not trained.passes and not oracle.passes
        return Claim(
            claim="scale 0.5 is beyond the method, even with exact estimates",
            paper="nominal lasts 0.06 s, the method fails",
            ours=f"trained at 0.7 {trained.text}; oracle {oracle.text}; nominal lasts {lasted:.2f} s",
            verdict=judge({"fails": fails, "nominal fails": not nominal.passes}),
        )

    def _untrained(self, scale: float, who: tuple[Contender, ...], walks: dict[Any, Walks]) -> Claim:
        """Not in the paper: the policies of scale 2."""
        learned, nominal, oracle = (walks[scale, each] for each in who)
        return Claim(
            claim=f"{who[0].title} trained at scale 2 walks at {scale:g}",
            ours=f"{learned.text}; nominal {nominal.text}, oracle {oracle.text}",
        )

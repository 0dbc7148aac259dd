"""Imperfections of the robot that the paper's discussion names, and dead time."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

from rabbit_reproduce.controllers import CBF_CLF, CBF_CLF_ORACLE, CLF, RL_CBF_CLF, RL_CLF, Contender
from rabbit_reproduce.experiment import Experiment
from rabbit_reproduce.report import Claim, judge
from rabbit_reproduce.sweep import Sweep, largest_text
from rabbit_reproduce.table_lines import Found, Line

PAIRS = {"flat": (RL_CLF, CLF), "stones": (RL_CBF_CLF, CBF_CLF)}
SCALES = (1.0, 2.0)
Place = tuple[float, str]


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
    def by_place(self) -> dict[Place, tuple[Line, Line]]:
        """The learned controller's line and the nominal one's, by scale and terrain."""
        places = [(scale, terrain) for scale in SCALES for terrain in PAIRS]
        return {place: self._lines(place) for place in places}

    def lines(self) -> Sequence[Line]:
        return [line for pair in self.by_place.values() for line in pair]

    def claims(self, found: Found) -> Sequence[Claim]:
        return [self._claim(found, place) for place in self.by_place]

    def _lines(self, place: Place) -> tuple[Line, Line]:
        learned, nominal = PAIRS[place[1]]
        beside = self._line(nominal, place)
        return replace(self._line(learned, place), paper="walks", nominal=beside), beside

    def _line(self, contender: Contender, place: Place) -> Line:
        scale, terrain = place
        assembly = contender.assembly(**{"mass_scale": scale, self.field: self.value})
        return Line(f"{contender.title}, {self.what}, scale {scale:g}, {terrain}", assembly)

    def _claim(self, found: Found, place: Place) -> Claim:
        (learned, nominal), (scale, terrain) = (found.walks(line) for line in self.by_place[place]), place
        return Claim(
            claim=f"{PAIRS[terrain][0].title} walks with {self.what}, scale {scale:g}, {terrain}",
            paper="successful results",
            ours=f"{learned.text}; nominal {nominal.text}",
            verdict=judge({"walks": learned.passes}, nominal.passes),
        )


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

    def claims(self, found: Found) -> Sequence[Claim]:
        """How much each takes."""
        return [
            Claim(
                claim=f"{self.what} that {each.title} takes (scale {plant.get('mass_scale', 1.0):g})",
                ours=largest_text(self.walks(found, each), self.scale, self.unit),
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
    "falls on stones as well (every-plant-stones), and what walks there calibrates its joints from the stance "
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

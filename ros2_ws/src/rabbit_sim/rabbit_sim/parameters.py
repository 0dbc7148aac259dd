"""Everything about the true plant, the course, the start and the simulator's node that can be set."""

import math
from functools import cache
from importlib.util import find_spec
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import AfterValidator, Field, model_validator
from rabbit_description import ABOUT_TASK, DEFAULT_GAIT
from rabbit_description.plugins import names
from rabbit_description.state import TICK_SECONDS
from rabbit_description.tick import ABOUT_TICK, TickSeconds
from rabbit_description.validation import Checked

from rabbit_sim.perturbation import ENGINES_ALONE, WHOLE_SUBSTEPS, Control, EngineNumber, Number, Perturbation, setting
from rabbit_sim.perturbations import KINDS
from rabbit_sim.plant import FARTHEST_EDGE, HIGHEST_TOP, SUBSTEP_SECONDS

PLANTS = "rabbit.plants"  # entry points; see rabbit_description.plugins
SLOWEST = 1e-6  # pace: a tick of some hours
USUAL: Literal["pybullet", "mujoco"] = (  # PyBullet has no wheel from Python 3.12 on
    "pybullet" if find_spec("pybullet") else "mujoco"
)
if TYPE_CHECKING:
    PlantName = str
    Perturbed = Any  # the fields of `perturbations/`
else:
    PlantName = Literal[*names(PLANTS)]
    Perturbed = type("Perturbed", KINDS[::-1], {"__module__": __name__})


class Episode(Checked):
    """The plant, the course, the first state, and what ends an episode."""

    plant: PlantName = Field(USUAL, description="physics engine, or rigid: the paper's hybrid model")

    tick_seconds: TickSeconds = Field(TICK_SECONDS, description=ABOUT_TICK)
    terrain: Literal["flat", "stones"] = Field("stones", description="flat ground or stones with gaps")
    stones: int = Field(20, ge=1, le=4000, description="stones of an episode; on flat ground, steps")
    l_min_mean: Number = Field(0.35, ge=1e-6, le=0.8, description="mean of the near edge, m from the stance foot")
    l_min_std: Number = Field(0.02, ge=0, le=0.3, description="standard deviation of the near edge, m")
    l_min_truncation: Number = Field(2.5, ge=1e-6, le=6, description="largest deviation from the mean, in std")
    l_min_distribution: Literal["normal", "uniform"] = Field(
        "normal", description="distribution of the near edge, on mean +- truncation x std"
    )
    stone_width: Number = Field(0.05, ge=1e-3, le=0.5, description="l_max - l_min, m")
    stone_placement: Literal["relative", "absolute"] = Field(
        "relative",
        description="point from which a stone's distance counts: the landed foot, or the middle of the stone before",
    )
    stone_height: EngineNumber = setting(
        0.0,
        0,
        HIGHEST_TOP,
        "largest deviation of a stone's top from the first platform's, m",
        Control("stone height", 0.005, "m", at_reset=True),
    )
    height_preview: bool = Field(True, description="the preview of a stone tells its height")
    course: str = Field("", description="YAML file of stones; empty: drawn")

    x0_position_std: Number = Field(0.02, ge=0, le=0.5, description="noise of the first angles, rad")
    x0_velocity_std: Number = Field(0.05, ge=0, le=1, description="noise of the first angle rates, over their size")
    x0_spread: Number = Field(1.0, ge=0, le=10, description="factor on the noise of the first state")

    stop_at_miss: bool = Field(True, description="a missed stone ends the episode")
    fall_height: Number = Field(0.70, ge=0, le=0.8, description="height of the hip below which the robot has fallen, m")
    fall_pitch: Number = Field(
        math.pi / 3, ge=1e-6, le=math.pi, description="pitch of the torso beyond which the robot has fallen, rad"
    )

    @model_validator(mode="after")
    def _edges_are_in_reach(self) -> Self:
        nearest = self.l_min_mean - self.l_min_truncation * self.l_min_std
        if nearest <= 0:
            raise ValueError(f"l_min_mean - l_min_truncation * l_min_std = {nearest:g}: expected more than 0 m")
        farthest = self.l_min_mean + self.l_min_truncation * self.l_min_std + self.stone_width
        if not self.course and farthest > FARTHEST_EDGE:
            names = "l_min_mean + l_min_truncation * l_min_std + stone_width"
            raise ValueError(f"{names} = {farthest:g}: expected at most {FARTHEST_EDGE} m")
        return self

    @model_validator(mode="after")
    def _plant_can(self) -> Self:
        for name in marked(ENGINES_ALONE) if self.plant == "rigid" else ():
            if (value := getattr(self, name)) != (default := type(self).model_fields[name].default):
                raise ValueError(f"{name} = {value:g} with plant rigid: expected {default:g}, pybullet or mujoco")
        return self

    @model_validator(mode="after")
    def _times_are_whole_substeps(self) -> Self:
        for name in marked(WHOLE_SUBSTEPS):
            steps = getattr(self, name) / SUBSTEP_SECONDS
            if abs(steps - round(steps)) > 1e-6:
                raise ValueError(f"{name} = {getattr(self, name):g}: expected a multiple of {SUBSTEP_SECONDS:g} s")
        return self


class SimulationParameters(Perturbed, Episode):
    """Flat, immutable and checked: pydantic's error names the field, its value and what was expected.

    The fields are those of `Episode` and of all files of `perturbations/`.
    """

    if TYPE_CHECKING:  # the perturbations' fields, too

        def __init__(self, **values: Any) -> None: ...

    @property
    def substeps(self) -> int:
        """The substeps of a tick."""
        return round(self.tick_seconds / SUBSTEP_SECONDS)

    @property
    def needs_path(self) -> bool:
        """Whether a measurement is faster than a tick."""
        return any(perturbation.needs_path for perturbation in self.in_force())

    def in_force(self) -> list[Perturbation]:
        """The perturbations that are not at their defaults, in the order in which they act."""
        return [kind.of(self) for kind in KINDS if kind.is_in_force(self)]


@cache
def marked(mark: str) -> list[str]:
    """The fields with a mark, such as `ENGINES_ALONE`."""
    return [name for name, field in SimulationParameters.model_fields.items() if mark in field.metadata]


def countable(pace: float) -> float:
    """This pace; raises `ValueError` where a tick would last longer than a timer can count."""
    if 0 < pace < SLOWEST:
        raise ValueError(f"0, or at least {SLOWEST:g}")
    return pace


Pace = Annotated[float, Field(ge=0, le=100), AfterValidator(countable)]


class PlayerParameters(Checked):
    """Parameters of who plays episodes, besides the plant's: how many, their pace, and how long is waited for whom."""

    IS_SIMULATED: ClassVar[bool] = True  # a robot's sensors have drivers that publish

    gait: str = Field(
        DEFAULT_GAIT,
        description="gait whose post-impact state the robot starts from: a name or a file, also of a library",
    )
    seed: int = Field(1, ge=0, le=2**63 - 1, description="seed of the first episode; the next ones count up from it")
    episodes: int = Field(
        1_000_000, ge=0, description="episodes to walk by itself; 0: those that reset_episode asks for"
    )
    publish_tf: bool = Field(
        True, description="publish `tf` and `robot_description`; false beside a robot_state_publisher"
    )
    start_paused: bool = Field(False, description="wait for the pause service to let the first episode begin")
    readers: int = Field(1, ge=1, le=100, description="nodes that must hear the state before an episode begins")
    pace: Pace = Field(0.0, description="times real time at most; 0: no limit in lock-step; dynamic")
    real_time: bool = Field(False, description="a tick takes its time (over pace) by the wall clock, answered or not")
    held_ticks: int = Field(
        2, ge=0, le=1000, description="real time: how old a torque may be that stands in for late ones"
    )
    damped_ticks: int = Field(10, ge=1, le=1000, description="real time: of joint damping after these, then it ends")
    damping: float = Field(10.0, ge=0, le=30, description="real time: of each joint in these ticks, N m s/rad")
    late_limit: float = Field(0.001, ge=0, le=1, description="real time: share of late ticks above which it warns")
    priority: int = Field(0, ge=0, le=99, description="SCHED_FIFO priority, where permitted; 0: an ordinary process")
    answer_timeout: float = Field(5.0, gt=0, le=3600, description="s without a torque that end an episode")
    trainer_timeout: float = Field(600.0, gt=0, le=86400, description="s that the trainer may take between episodes")
    memory: str = Field(
        "", description="file that keeps episode and clock for a simulator started again; empty: it counts from 1"
    )
    trainer: Literal["auto", "ignore", "wait", "follow"] = Field(
        "auto",
        description="wait: until it has digested the last episode; follow: and as it plans the next one; "
        "auto: follow while one is there",
    )


class NodeParameters(PlayerParameters):
    """The parameters of the simulator's node."""

    task: str = Field("", description=f"what is simulated; empty: RABBIT; else {ABOUT_TASK}")

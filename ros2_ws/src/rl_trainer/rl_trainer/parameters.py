"""Every parameter of the training, flat, so that options and a node's parameters can name them.

The paper states the observations, actions, networks, T_s and ten steps an episode. Penalty, noise, learning rates and
all else are ours: docs/differences_from_paper.md.
"""

from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field, model_validator
from rabbit_description.plugins import names
from rabbit_description.state import TICK_SECONDS
from rabbit_description.tick import ABOUT_TICK, TickSeconds
from rabbit_description.validation import Checked
from rl_cbf_clf_controller.kinds import NamedProblem
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP, STEP_LENGTH

Scales = tuple[float, ...]
LEARNERS = "rabbit.learners"  # entry points; see rabbit_description.plugins
if TYPE_CHECKING:
    LearnerName = str
else:
    LearnerName = Literal[*names(LEARNERS)]

TYPICAL_LGV = 10.0  # |LgV| + 1 of a walk at scale 2


class TrainingParameters(Checked):
    """Parameters of learner, reward, transitions and schedule; defaults are what works, `PAPER_LITERAL` the paper."""

    problem: NamedProblem = Field(RL_CBF_CLF_QP, description="what is learned: the controller's name")
    learner: LearnerName = Field("ddpg", description="how the actor is trained")
    seed: int = Field(1, ge=0, description="seed of weights, noise, courses and minibatches")
    episodes: int = Field(18, ge=1, le=10_000, description="episodes to train")
    walking_steps: int = Field(10, ge=1, le=1000, description="walking steps an episode")

    # actor
    tick_seconds: TickSeconds = Field(TICK_SECONDS, description=ABOUT_TICK)
    structured: bool = Field(True, description="CLF outputs are a 4x5 matrix contracted with LgV")
    observe_l_min: bool = Field(True, description="l_min is part of the observation (contribution 3)")
    observe_step_length: bool = Field(
        False, description="the length that a gait library steps at is part of the observation, m"
    )
    hidden1: int = Field(400, ge=1, le=4096, description="width of the first hidden layer")
    hidden2: int = Field(300, ge=1, le=4096, description="width of the second hidden layer")
    alpha_scale: Scales = Field((), description="alpha at an output of 1, one a quantity; empty: the default")
    beta_scale: Scales = Field((), description="beta at an output of 1, one a quantity; empty: the default")

    # transitions and reward: -sum of (error / its unit)^2 - failure_penalty
    measurement: Literal["mean", "paper"] = Field(
        "mean", description="means over the tick, V-dot by the rates; or V's own difference, against the tick's start"
    )
    every_tick: bool = Field(False, description="learn from every measured tick, doubtful ones too")
    relative_clf: bool = Field(True, description="the error of V-dot is measured in units of |LgV| + 1")
    failure_penalty: float = Field(0.0, ge=0, le=1e6, description="l_e, subtracted when the pose failed")
    fall_height: float = Field(0.70, ge=0, le=2, description="height of the base below which it has failed, m")
    fall_pitch: float = Field(1.0472, gt=0, le=3.15, description="pitch beyond which it has failed, rad")

    # optimisation
    actor_rate: float = Field(1e-3, gt=0, le=1, description="Adam's learning rate, actor")
    critic_rate: float = Field(1.6e-3, gt=0, le=1, description="Adam's learning rate, critic")
    rate_half_life: float = Field(4000.0, ge=0, description="transitions in which both rates halve; 0: they stay")
    polyak: float = Field(1e-3, gt=0, le=1, description="tau of target networks and of the actor's average")
    probe_noise: float = Field(
        30.0, ge=0, le=1000, description="deviation of the mu that an affine critic judges the actor at, rad/s^2"
    )
    batch: int = Field(128, ge=1, le=65_536, description="transitions a minibatch")
    updates_per_tick: float = Field(1.0, ge=0, le=100, description="updates for each tick walked")
    updates_least: int = Field(200, ge=0, description="least number of updates an episode")
    capacity: int = Field(100_000, ge=1, le=5_000_000, description="transitions kept, the oldest go first")

    # schedule
    nominal_episodes: int = Field(3, ge=0, description="first episodes under the nominal QP, with noise")
    sigma: float = Field(8.0, ge=0, le=1000, description="exploration noise on mu, rad/s^2")
    sigma_factors: tuple[float, ...] = Field(
        (0.0, 0.5, 1.0, 2.0), min_length=1, description="sigma's factor, drawn anew each episode"
    )

    @model_validator(mode="after")
    def _fits(self) -> "TrainingParameters":
        if not self.problem.error_scale:
            raise ValueError(f"problem = {self.problem}: expected an error_scale, the unit of each quantity's error")
        for name in ("alpha_scale", "beta_scale"):
            values: Scales = getattr(self, name)
            if not values and not getattr(self.problem, name):
                raise ValueError(f"{name}: expected {self.n} values, {self.problem} has no default")
            if values and (len(values) != self.n or not all(value > 0 for value in values)):
                raise ValueError(f"{name} = {values}; expected {self.n} positive values for {self.problem.quantities}")
        if self.observe_step_length and self.observation not in self.problem.observations:
            raise ValueError("observe_step_length = True: expected stones, rl-cbf-clf-qp, and observe_l_min = True")
        if self.failure_penalty > 0 and self.learner in ("ddpg", "regression"):
            raise ValueError(f"failure_penalty > 0: expected learner = paper_ddpg; {self.learner} looks one tick ahead")
        return self

    @property
    def n(self) -> int:
        """Number of learned quantities."""
        return len(self.problem.quantities)

    @property
    def key(self) -> str:
        """A key of all that decides a training; the number of its episodes does not."""
        return self.model_dump_json(exclude={"episodes"})

    @property
    def is_structured(self) -> bool:
        """`structured`, where there is a CLF row."""
        return self.structured and self.problem.has_clf

    @property
    def observation(self) -> tuple[str, ...]:
        """Names of the network's inputs."""
        whole = self.problem.observation + (STEP_LENGTH,) * self.observe_step_length
        return tuple(name for name in whole if self.observe_l_min or name not in self.problem.omissible)

    @property
    def scales(self) -> tuple[Scales, Scales, Scales]:
        """Scales of alpha, beta and error, the defaults filled in."""
        error = self.problem.error_scale
        if self.problem.has_clf and not self.relative_clf:
            error = (error[0] * TYPICAL_LGV, *error[1:])
        return self.alpha_scale or self.problem.alpha_scale, self.beta_scale or self.problem.beta_scale, error


# DDPG as the paper states it; what it leaves open is taken from the DDPG paper or our working set
PAPER_LITERAL: dict[str, Any] = {
    "learner": "paper_ddpg",
    "structured": False,
    "measurement": "paper",
    "every_tick": True,
    "relative_clf": False,
    "failure_penalty": 10.0,
    "actor_rate": 1e-4,
    "critic_rate": 1e-3,
    "rate_half_life": 0.0,
    "batch": 64,
    "updates_least": 0,
    "nominal_episodes": 0,
    "sigma_factors": (1.0,),
}

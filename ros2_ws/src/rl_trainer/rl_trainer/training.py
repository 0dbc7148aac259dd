"""Training: what happens with a tick and at an episode's end. The node and `rabbit train` run this same code.

    plan = trainer.begin_episode()      which seed, noise and policy to walk with
    trainer.observe(state, output)      every tick
    trainer.end_episode(last_state)     the updates, always as many as the ticks ask for

The updates wait for the episode's end, so the weights depend on the seed and not on timing; a node that wants to learn
while the robot walks on may call `learn` in between.
"""

import threading
import time
from dataclasses import asdict, dataclass, field
from inspect import isabstract
from typing import Any

import numpy as np
import torch
from rabbit_description.plugins import PluginError, load
from rabbit_description.state import TICK_SECONDS, RobotState
from rl_cbf_clf_controller.controller_output import ControllerOutput
from rl_cbf_clf_controller.policy import ActorPolicy, ZeroPolicy
from rl_cbf_clf_controller.weights import Arrays, PolicyFile, PolicyFileError, PolicyMetadata, problem_fields

from rl_trainer.actor import Actor
from rl_trainer.learner import Learner
from rl_trainer.parameters import LEARNERS, TrainingParameters
from rl_trainer.replay import Replay
from rl_trainer.reward import reward_terms
from rl_trainer.transitions import Doubt, Transition, TransitionBuilder

CRITIC_FIRST = 1000  # updates with a critic that knows nothing yet, which take an actor away from where it began
RATE_FLOOR = 0.05  # the least share of both learning rates
FORM = (  # of a policy file, that a training must share to go on from it
    *("problem", "names", "m", "observation", "observation_center", "observation_scale"),
    *("hidden", "structured", "alpha_scale", "beta_scale", "trained_tick"),
)


class Stopped(Exception):
    """Another thread has set `Trainer.stop`."""


class DivergenceError(RuntimeError):
    """The weights or their outputs are not finite any more."""


@dataclass(frozen=True)
class Provenance:
    """Where the transitions come from and who asks; it ends up in the policy file."""

    plant: dict[str, bool | int | float | str] = field(default_factory=dict)
    commit: str = ""
    command: str = ""


@dataclass(frozen=True)
class EpisodePlan:
    """How to walk the next episode: `policy` zero is the nominal controller; `sigma` in rad/s^2."""

    episode: int
    seed: int
    sigma: float
    policy: ZeroPolicy | ActorPolicy


@dataclass(frozen=True)
class EpisodeReport:
    """An episode in figures: touchdowns, ticks, transitions kept, their mean reward terms, mean losses.

    `failed` by pose; `fault` is the controller's reason to end it, or empty; `left_out` counts the ticks of each doubt;
    `seconds` that it took.
    """

    episode: int
    sigma: float
    nominal: bool
    steps: int
    ticks: int
    kept: int
    failed: bool
    fault: str
    reward: dict[str, float]
    losses: dict[str, float]
    left_out: dict[str, int]
    seconds: float = field(compare=False)

    @property
    def scalars(self) -> dict[str, float]:
        """Its numbers in curve.csv and TensorBoard, by name."""
        row = {f"episode/{name}": float(getattr(self, name)) for name in ("steps", "ticks", "kept", "failed", "sigma")}
        for group in ("reward", "losses", "left_out"):
            row |= {f"{group}/{name}": value for name, value in getattr(self, group).items()}
        return row


class Trainer:
    """Collects transitions, learns from them, and hands out policies.

    `taken`: transitions ever taken in; `reports`: of the newest `episodes` ones.
    """

    def __init__(
        self, parameters: TrainingParameters, provenance: Provenance | None = None, learner: Learner | None = None
    ) -> None:
        """`learner` replaces the one that the parameters name."""
        self.parameters = parameters
        self.provenance = provenance or Provenance()
        self.episode = 0
        self.learner = learner or make_learner(parameters)
        self.replay = Replay(parameters)
        self.taken, self.reports = 0, list[EpisodeReport]()
        self.stop = threading.Event()  # set by another thread: the next update raises `Stopped`
        self._builder = TransitionBuilder(parameters)
        self._start: Arrays = {}  # weights to set the actor back to
        self._adaptation: str | None = None  # that the controller walks with
        self._earlier = 0  # transitions that the policy it began with has seen
        self._unsure = 0  # updates until the critic knows enough to leave that policy; below 0: it does
        self._clear()

    def start_from(self, policy: PolicyFile) -> None:
        """Go on from a policy: its weights in the actor and its average, its episodes and transitions counted on.

        Critic, optimiser and replay begin as from scratch. So the actor is set back to the policy until the critic has
        had `CRITIC_FIRST` updates.

        Raises:
            PolicyFileError: its form is not the one that the parameters ask for.
        """
        for name in FORM:
            here, there = (getattr(file.metadata, name) for file in (self.policy_file(), policy))
            if here != there:
                raise PolicyFileError(f"policy {policy.version}: {name} = {there}; this training has {here}")
        self.episode, self._earlier = policy.metadata.episodes, policy.metadata.transitions
        self._start, self._unsure = policy.arrays, CRITIC_FIRST
        self.learner.set_actors(policy.arrays)

    def begin_episode(self) -> EpisodePlan:
        """Seed, noise and policy of the next episode, from the seed and the episode's number alone."""
        p = self.parameters
        seeds = np.random.SeedSequence([p.seed, self.episode])
        factor = np.random.default_rng(seeds.spawn(1)[0]).choice(p.sigma_factors)
        nominal = self.episode < p.nominal_episodes
        self._clear()
        return EpisodePlan(
            episode=self.episode,
            seed=int(seeds.generate_state(1)[0]),
            sigma=p.sigma if nominal else p.sigma * float(factor),
            policy=ZeroPolicy(p.problem) if nominal else ActorPolicy(self.policy_file()),
        )

    def observe(self, state: RobotState, output: ControllerOutput | None = None) -> Transition | None:
        """Take in a tick, without an output the state that the episode ended in; returns the transition into it.

        Of an episode's end there is one the first time.
        """
        if output:
            self._fault = output.fault
            self._adaptation = None if output.adaptation == "none" else output.adaptation
        return self.take(self._builder.add(state, output))

    def take(self, transition: Transition | None) -> Transition | None:
        """Take in a transition: those of before a kill come this way too."""
        if transition is not None:
            self.taken += 1
            self._walk.append(transition)
            self._kept += self.replay.add(transition)
        return transition

    def end_episode(self, plan: EpisodePlan, state: RobotState) -> EpisodeReport:
        """Take in the last state and learn; the next `begin_episode` has the new policy."""
        self.observe(state)
        p = self.parameters
        losses = self.learn(max(p.updates_least, round(p.updates_per_tick * len(self._walk))))
        self.episode += 1
        self.reports.append(self._report(plan, state, losses))
        del self.reports[: -self.parameters.episodes]
        return self.reports[-1]

    def learn(self, updates: int) -> dict[str, float]:
        """So many updates from the replay buffer; mean losses, empty while there are too few transitions."""
        if len(self.replay) < self.parameters.batch:
            return {}
        total: dict[str, float] = {}
        for _ in range(updates):
            if self.stop.is_set():
                raise Stopped
            for name, loss in self.learner.update(self.replay.sample(), self.rate).items():
                total[name] = total.get(name, 0.0) + loss / updates
            self._unsure -= 1
            if self._unsure == 0:
                self.learner.set_actors(self._start)
        if self._unsure > 0:  # nobody is to walk with what such a critic made of it
            self.learner.set_actors(self._start)
        return total

    @property
    def transitions(self) -> int:
        """Transitions kept so far, those of the policy that it began with included."""
        return self._earlier + self.replay.added

    @property
    def rate(self) -> float:
        """Factor on both learning rates, by the transitions so far."""
        half_life = self.parameters.rate_half_life
        return max(RATE_FLOOR, float(0.5 ** (self.transitions / half_life))) if half_life else 1.0

    def policy_file(self) -> PolicyFile:
        """The present policy with all that says where it comes from.

        Raises:
            DivergenceError: it is not finite.
        """
        p, actor = self.parameters, self.learner.acting
        alpha, beta, _ = p.scales
        metadata = PolicyMetadata(
            **problem_fields(p.problem),
            observation=p.observation,
            observation_center=tuple(actor.scaling.center.tolist()),
            observation_scale=tuple(actor.scaling.scale.tolist()),
            hidden=actor.hidden,
            structured=p.is_structured,
            alpha_scale=alpha,
            beta_scale=beta,
            adaptation=self._adaptation,
            tick_seconds=None if p.tick_seconds == TICK_SECONDS else p.tick_seconds,
            learner=p.learner,
            training_seed=p.seed,
            episodes=self.episode,
            transitions=self.transitions,
            **vars(self.provenance),
        )
        try:
            return PolicyFile(metadata, actor.arrays())
        except PolicyFileError as error:
            text = f"the learning diverged by the end of episode {self.episode}: {error}; earlier checkpoints are kept"
            raise DivergenceError(f"{text}; expected smaller learning rates") from error

    def state_dict(self) -> dict[str, Any]:
        """All that is needed to go on between two episodes as if nothing had happened."""
        return {
            "episode": self.episode,
            "adaptation": self._adaptation,
            "earlier": self._earlier,
            "unsure": self._unsure,
            "learner": self.learner.state_dict(),
            "replay": self.replay.state_dict(),
            "taken": self.taken,
            "reports": [asdict(report) for report in self.reports],
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        self.episode, self._adaptation = state["episode"], state["adaptation"]
        self._earlier = state.get("earlier", self._earlier)  # neither is in an older checkpoint
        self._unsure = state.get("unsure", 0)
        self.learner.load_state_dict(state["learner"])
        self._start = self.learner.acting.arrays()  # where it still is while the critic is unsure
        self.replay.load_state_dict(state["replay"])
        self.taken, self.reports = state["taken"], [EpisodeReport(**report) for report in state["reports"]]

    def _clear(self) -> None:
        self._builder.reset()
        self._walk: list[Transition] = []  # of this episode
        self._kept, self._fault, self._began = 0, "", time.perf_counter()

    def _report(self, plan: EpisodePlan, state: RobotState, losses: dict[str, float]) -> EpisodeReport:
        p, episode = self.parameters, self._walk
        terms = [reward_terms(t, p)[0] for t in episode if self.replay.accepts(t)]
        mean = np.mean(terms, axis=0) if terms else np.zeros(p.n)
        failure = reward_terms(episode[-1], p)[1] if episode else 0.0
        return EpisodeReport(
            episode=plan.episode,
            sigma=plan.sigma,
            nominal=isinstance(plan.policy, ZeroPolicy),
            steps=state.touchdowns,
            ticks=len(episode),
            kept=self._kept,
            failed=bool(episode and episode[-1].failed),
            fault=self._fault,
            reward=dict(zip((*p.problem.quantities, "failure"), (*mean.tolist(), failure), strict=True)),
            losses=losses,
            left_out={f.name.lower(): sum(f in t.doubt for t in episode) for f in Doubt if f.name},
            seconds=time.perf_counter() - self._began,
        )


def make_learner(parameters: TrainingParameters) -> Learner:
    """The learner that the parameters name; its first weights from the seed alone.

    Raises `PluginError`: a package brings something else under that name.
    """
    torch.set_num_threads(1)
    kind = load(LEARNERS, parameters.learner)
    expected = f"{LEARNERS} {parameters.learner}: expected a `Learner`"
    if isabstract(kind):
        raise PluginError(f"{expected} that can be made, with an `update`, found {kind!r}")
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(parameters.seed)
        learner = kind(parameters)
    if not isinstance(learner, Learner) or not isinstance(getattr(learner, "acting", None), Actor):
        raise PluginError(f"{expected} with an `Actor` to walk with, `acting`, found {learner!r}")
    return learner

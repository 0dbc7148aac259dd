"""The learning thread in a tiny world: what it tells, and which weights it publishes."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from rl_cbf_clf_controller.policy import ActorPolicy, ZeroPolicy
from rl_cbf_clf_controller.uncertainty import RL_CLF_QP
from rl_cbf_clf_controller.weights import PolicyFile
from rl_trainer.learning_thread import LearningThread
from rl_trainer.parameters import TrainingParameters
from rl_trainer.publication_gate import EVERY, Verdict
from rl_trainer.rollout import Record, rollout
from rl_trainer.training import EpisodePlan, EpisodeReport, Trainer
from rl_trainer.transitions import Transition

PARAMETERS = TrainingParameters(problem=RL_CLF_QP, batch=16, updates_least=10, hidden1=16, hidden2=12)

STEP = 10  # ticks


@dataclass
class Heard:
    """All that the thread tells."""

    plans: list[EpisodePlan] = field(default_factory=list)
    transitions: list[tuple[Transition, Any]] = field(default_factory=list)
    policies: list[PolicyFile] = field(default_factory=list)
    reports: list[EpisodeReport] = field(default_factory=list)
    verdicts: list[Verdict] = field(default_factory=list)

    def on_plan(self, plan: EpisodePlan, after: int, report: EpisodeReport | None) -> None:
        self.plans.append(plan)
        self.reports += [report] if report else []

    def on_transition(self, transition: Transition, tag: Any) -> None:
        self.transitions.append((transition, tag))

    def on_policy(self, policy: PolicyFile, verdict: Verdict) -> None:
        self.verdicts.append(verdict)
        self.policies += [policy] if verdict.passes else []


def wait_for(holds: Callable[[], bool], seconds: float = 120.0) -> None:
    """Until something holds."""
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.01)


def walk(learning: LearningThread, number: int, world: Any, make_controller: Any, **last: Any) -> None:
    """An episode for the thread; `last` changes its last state."""

    def observe(record: Record) -> None:
        tick = record.state.tick
        learning.tick(record.state, replace(record.output, step_index=tick // STEP), (number, tick))

    end = rollout(world, make_controller(ZeroPolicy(RL_CLF_QP), 1.0), number, observe)
    learning.end(replace(end, **last), number, (number, end.tick))


def test_the_transition_into_a_failure_is_told(toy_world: Any, toy_controller: Any) -> None:
    heard = Heard()
    learning = LearningThread(Trainer(PARAMETERS), heard)
    learning.start()
    walk(learning, 1, toy_world, toy_controller, q=np.zeros(7))
    wait_for(lambda: len(heard.plans) == 2)
    learning.close()
    assert [tag for _, tag in heard.transitions] == [(1, tick + 1) for tick in range(toy_world.ticks)]
    assert [t.tick for t, _ in heard.transitions] == list(range(toy_world.ticks))
    assert [t.failed for t, _ in heard.transitions] == [False] * (toy_world.ticks - 1) + [True]
    assert heard.reports[0].failed
    assert heard.reports[0].ticks == toy_world.ticks


def test_what_is_learned_beside_passes_the_gate(toy_world: Any, toy_controller: Any) -> None:
    """Published is what is no worse than the policy in force; nothing is, once that one is far ahead."""
    heard, toy_world.ticks = Heard(), 10 * EVERY * STEP
    learning = LearningThread(Trainer(PARAMETERS), heard, beside=20)
    learning.start()
    walk(learning, 1, toy_world, toy_controller)
    wait_for(lambda: len(heard.policies) > 2)
    best = heard.policies[-1]
    learning.in_force(ActorPolicy(best))
    wait_for(lambda: heard.verdicts[-1].version_in_force == best.version)
    learning.close()
    published = [verdict.version for verdict in heard.verdicts if verdict.passes]
    assert published == [policy.version for policy in heard.policies]
    for verdict in heard.verdicts:
        assert verdict.passes == (verdict.error <= verdict.error_in_force)
    sound = [t for t, _ in heard.transitions if not t.doubt]
    assert learning.trainer.replay.added == len(sound) * (EVERY - 1) // EVERY


def test_a_plans_policy_has_no_gate_and_nothing_is_held_out(toy_world: Any, toy_controller: Any) -> None:
    heard, toy_world.ticks = Heard(), 10 * EVERY * STEP
    learning = LearningThread(Trainer(PARAMETERS), heard)
    learning.start()
    walk(learning, 1, toy_world, toy_controller)
    wait_for(lambda: len(heard.plans) == 2)
    learning.close()
    assert not heard.verdicts
    assert learning.trainer.replay.added == sum(not t.doubt for t, _ in heard.transitions)

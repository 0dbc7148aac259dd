"""The learning thread in a tiny world: what it tells."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.uncertainty import RL_CLF_QP
from rl_trainer.learning_thread import LearningThread
from rl_trainer.parameters import TrainingParameters
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
    reports: list[EpisodeReport] = field(default_factory=list)

    def on_plan(self, plan: EpisodePlan, after: int, report: EpisodeReport | None) -> None:
        self.plans.append(plan)
        self.reports += [report] if report else []

    def on_transition(self, transition: Transition, tag: Any) -> None:
        self.transitions.append((transition, tag))


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

"""The replay buffer: what the learner needs of each transition, as float32 columns; the oldest go first."""

from dataclasses import dataclass, fields
from math import prod
from typing import Any

import numpy as np
import torch
from torch import Tensor

from rl_trainer.parameters import TrainingParameters
from rl_trainer.reward import error_unit, reward_terms
from rl_trainer.transitions import Doubt, Transition


@dataclass(frozen=True)
class Batch:
    """b transitions, m observations (raw), n quantities, p inputs; `target` and `reward` in units of the error.

    `observation` (b, m), `LgV` (b, p), `mu` (b, p), `unit` (b, n), `alpha` (b, n, p), `beta` (b, n), `target` (b, n),
    `reward` (b, n), `penalty` (b,), `failed` (b,), and `observation`, `LgV`, `mu` of the next tick.
    """

    observation: Tensor
    LgV: Tensor
    mu: Tensor
    mu_qp: Tensor
    unit: Tensor
    alpha: Tensor
    beta: Tensor
    target: Tensor
    reward: Tensor
    penalty: Tensor
    failed: Tensor
    next_observation: Tensor
    next_LgV: Tensor
    next_mu: Tensor

    @property
    def size(self) -> int:
        """Number of transitions."""
        return len(self.mu)


class Replay:
    """A ring of transitions with a generator of its own, so that sampling depends on the seed alone."""

    def __init__(self, parameters: TrainingParameters) -> None:
        self._parameters = parameters
        self._doubts = sum((Doubt[name.upper()] for name in parameters.leave_out), Doubt.NONE)
        self._generator = torch.Generator().manual_seed(parameters.seed)
        self._added = 0
        self._shapes = _shapes(parameters)
        self._table = torch.zeros(parameters.capacity, sum(map(prod, self._shapes.values())))
        self._columns = self._by_name(self._table)

    @property
    def added(self) -> int:
        """Transitions ever kept."""
        return self._added

    def __len__(self) -> int:
        return min(self._added, self._parameters.capacity)

    def add(self, transition: Transition) -> bool:
        """Keep a transition; False if it is one to leave out."""
        if not self.accepts(transition):
            return False
        row = self._added % self._parameters.capacity
        for name, value in _columns_of(transition, self._parameters).items():
            self._columns[name][row] = torch.as_tensor(value, dtype=torch.float32)
        self._added += 1
        return True

    def accepts(self, transition: Transition) -> bool:
        """Measured and beyond doubt; or a failure, where the learner has a use for it."""
        if transition.doubt & Doubt.UNMEASURED:
            return transition.failed and self._parameters.failure_penalty > 0 and self._parameters.learns_failures
        return not transition.doubt & self._doubts

    def sample(self) -> Batch:
        """A minibatch, drawn evenly with replacement."""
        rows = torch.randint(len(self), (self._parameters.batch,), generator=self._generator)
        return self.rows(rows)

    def rows(self, rows: Tensor | slice) -> Batch:
        """Chosen transitions; the newest has the index `len(self) - 1` until the ring is full."""
        return Batch(**self._by_name(self._table[rows]))

    def _by_name(self, table: Tensor) -> dict[str, Tensor]:
        """The columns of a table, as views."""
        parts = table.split([prod(shape) for shape in self._shapes.values()], 1)
        return {
            name: part.unflatten(1, shape) if shape else part[:, 0]
            for (name, shape), part in zip(self._shapes.items(), parts, strict=True)
        }

    def state_dict(self) -> dict[str, Any]:
        """All that is kept, for a checkpoint."""
        columns = {name: column[: len(self)].clone() for name, column in self._columns.items()}
        return {"columns": columns, "added": self._added, "generator": self._generator.get_state()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        self._added = state["added"]
        self._generator.set_state(state["generator"])
        for name, column in state["columns"].items():
            self._columns[name][: len(self)] = column


def as_batch(transitions: list[Transition], parameters: TrainingParameters) -> Batch:
    """Transitions as one batch, none left out."""
    rows = [_columns_of(transition, parameters) for transition in transitions]
    return Batch(
        **{f.name: torch.as_tensor(np.stack([row[f.name] for row in rows]), dtype=torch.float32) for f in fields(Batch)}
    )


def _columns_of(transition: Transition, parameters: TrainingParameters) -> dict[str, Any]:
    unit = error_unit(transition.LgV, parameters)
    terms = reward_terms(transition, parameters)
    m = len(parameters.observation)
    return {
        "observation": transition.observation[:m],
        "LgV": transition.LgV,
        "mu": transition.mu,
        "mu_qp": transition.mu_qp,
        "unit": unit,
        "alpha": transition.alpha,
        "beta": transition.beta,
        "target": np.nan_to_num(transition.target / unit),
        "reward": terms.estimation,
        "penalty": terms.failure,
        "failed": float(transition.failed),
        "next_observation": transition.next_observation[:m],
        "next_LgV": transition.next_LgV,
        "next_mu": transition.next_mu,
    }


def _shapes(parameters: TrainingParameters) -> dict[str, tuple[int, ...]]:
    m, n, inputs = len(parameters.observation), parameters.n, parameters.problem.inputs
    by_quantity = dict.fromkeys(("unit", "beta", "target", "reward"), (n,))
    by_input = dict.fromkeys(("LgV", "mu", "mu_qp", "next_LgV", "next_mu"), (inputs,))
    observations = dict.fromkeys(("observation", "next_observation"), (m,))
    scalars: dict[str, tuple[int, ...]] = {"penalty": (), "failed": ()}
    return {**observations, **by_input, **by_quantity, "alpha": (n, inputs), **scalars}

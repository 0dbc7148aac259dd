"""The replay buffer: what the learner needs of the transitions, as float32 columns; the oldest go first."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import torch
from torch import Tensor

from rl_trainer.parameters import TrainingParameters
from rl_trainer.reward import error_unit, reward_terms
from rl_trainer.transitions import Doubt, Transition


@dataclass(frozen=True)
class Batch:
    """b transitions, m observations (raw), n quantities, p inputs; the last three are of the next tick."""

    observation: Tensor  # (b, m)
    LgV: Tensor  # (b, p)
    mu: Tensor  # (b, p)
    mu_qp: Tensor  # (b, p)
    unit: Tensor  # (b, n), of the error
    alpha: Tensor  # (b, n, p)
    beta: Tensor  # (b, n)
    target: Tensor  # (b, n), in the error's unit
    reward: Tensor  # (b, n), in the error's unit, squared
    penalty: Tensor  # (b,)
    failed: Tensor  # (b,)
    next_observation: Tensor
    next_LgV: Tensor
    next_mu: Tensor


class Replay:
    """A ring of transitions with a generator that nobody else draws from: sampling depends on the seed alone.

    `added`: transitions ever kept; `columns`: by the names of a `Batch`.
    """

    def __init__(self, parameters: TrainingParameters) -> None:
        self._parameters = parameters
        self._generator = torch.Generator().manual_seed(parameters.seed)
        self.added = 0
        self.columns: dict[str, Tensor] = {}

    def __len__(self) -> int:
        return min(self.added, self._parameters.capacity)

    def add(self, transition: Transition) -> bool:
        """Keep a transition; False if it is one to leave out."""
        if not self.accepts(transition):
            return False
        row = self.added % self._parameters.capacity
        for name, value in vars(as_batch([transition], self._parameters)).items():
            if name not in self.columns:
                self.columns[name] = torch.zeros(self._parameters.capacity, *value.shape[1:])
            self.columns[name][row] = value[0]
        self.added += 1
        return True

    def accepts(self, transition: Transition) -> bool:
        """Measured and beyond doubt; or a failure, where it costs something."""
        if transition.doubt & Doubt.UNMEASURED:
            return transition.failed and self._parameters.failure_penalty > 0
        return self._parameters.every_tick or not transition.doubt

    def sample(self) -> Batch:
        """A minibatch, drawn evenly with replacement."""
        return self.rows(torch.randint(len(self), (self._parameters.batch,), generator=self._generator))

    def rows(self, rows: Tensor | slice) -> Batch:
        """Chosen transitions; the newest has the index `len(self) - 1` until the ring is full."""
        return Batch(**{name: column[rows] for name, column in self.columns.items()})

    def state_dict(self) -> dict[str, Any]:
        """All that is kept, for a checkpoint."""
        columns = {name: column[: len(self)].clone() for name, column in self.columns.items()}
        return {"columns": columns, "added": self.added, "generator": self._generator.get_state()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        self.added = state["added"]
        self._generator.set_state(state["generator"])
        for name, column in state["columns"].items():
            self.columns[name] = torch.zeros(self._parameters.capacity, *column.shape[1:])
            self.columns[name][: len(self)] = column


def as_batch(transitions: list[Transition], parameters: TrainingParameters) -> Batch:
    """Transitions as one batch, none left out."""
    m, rows = len(parameters.observation), list[dict[str, Any]]()
    for t in transitions:
        unit, (reward, penalty) = error_unit(t.LgV, parameters), reward_terms(t, parameters)
        seen = {"observation": t.observation[:m], "next_observation": t.next_observation[:m]}
        learned = {"unit": unit, "target": np.nan_to_num(t.target / unit), "reward": reward, "penalty": penalty}
        rows.append(vars(t) | seen | learned)
    names = [field.name for field in fields(Batch)]
    return Batch(**{n: torch.as_tensor(np.stack([row[n] for row in rows]), dtype=torch.float32) for n in names})

"""Trainings as jobs of the engine: each in a folder of its own, where one that was stopped goes on.

ROOT/NAME-KEY/   a session of `rabbit train`, KEY the hash of all that decides it
"""

import shlex
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel
from rabbit_experiments import provenance
from rabbit_experiments.cache import Job, JobError
from rabbit_experiments.conditions import TRAINING_PLANT, TRAINING_SCALE, TRAINING_SLACK_WEIGHT
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters, load_parameters
from rl_cbf_clf_controller.scene import ControllerError
from rl_trainer.parameters import TrainingParameters

from rabbit_reproduce.command_lines import changed_options


class TrainingReport(BaseModel):
    """`episodes` has the `EpisodeReport` of each, and the `seconds` that it took."""

    commit: str
    episodes: list[dict[str, Any]]


@dataclass(frozen=True)
class TrainingJob(Job):
    """A training as `rabbit train` does it."""

    parameters: TrainingParameters
    mass_scale: float = TRAINING_SCALE
    tuning: tuple[tuple[str, Any], ...] = ()  # controller parameters that are not `ours`
    engine: str = "pybullet"
    root: Path = field(default=Path("runs/training"), compare=False)
    model = TrainingReport

    @property
    def name(self) -> str:
        """Of its folder, without the key."""
        return f"{self.parameters.problem}-scale-{self.mass_scale:g}-seed-{self.parameters.seed}"

    @property
    def command(self) -> str:
        """That makes the same policy."""
        changes = changed_options(self.parameters, TrainingParameters())
        changes += changed_options(self.controller, self._controller_of(()))
        changes += ["--plant", self.engine] if self.engine != "pybullet" else []
        return shlex.join(["rabbit", "train", *changes, "--mass-scale", f"{self.mass_scale:g}", "--out", "DIR"])

    @property
    def controller(self) -> ControllerParameters:
        """That walks while it learns."""
        return self._controller_of(self.tuning)

    @property
    def plant(self) -> SimulationParameters:
        """That it walks on."""
        course = {"terrain": self.controller.terrain, "stones": self.parameters.walking_steps, "plant": self.engine}
        return SimulationParameters.model_validate({**TRAINING_PLANT, **course, "mass_scale": self.mass_scale})

    @property
    def folder(self) -> Path:
        """The session's."""
        asked = provenance.plain(self)
        return self.root / f"{self.name}-{provenance.key_of([asked, provenance.provenance(asked)])}"

    def do(self) -> TrainingReport:
        from rl_trainer.checkpoint import CheckpointError  # torch
        from rl_trainer.training import DivergenceError

        try:
            episodes = self._train()
        except (CheckpointError, DivergenceError, ControllerError, np.linalg.LinAlgError) as error:
            raise JobError(f"{self.title or self.name}: {error}") from error
        return TrainingReport(commit=provenance.commit(), episodes=episodes)

    def _controller_of(self, tuning: tuple[tuple[str, Any], ...]) -> ControllerParameters:
        always = {"controller": self.parameters.problem.name, "slack_weight": TRAINING_SLACK_WEIGHT}
        return load_parameters("ours", **{**dict(tuning), **always})

    def _train(self) -> list[dict[str, Any]]:
        """Train, or go on training; the reports of all episodes."""
        from rabbit_experiments.training_setup import POLICY, training  # torch

        about = self.folder, self.parameters, self.controller, self.plant, self.command
        with training(*about) as (trainer, reports):
            for _ in reports:
                pass
            trainer.policy_file().write(self.folder / POLICY)
            return [asdict(report) for report in trainer.reports]

"""A training session on disk: the episode loop, checkpoints that a killed run resumes from, TensorBoard, policies.

DIR/parameters.yaml        what was asked for
DIR/checkpoint.pt          after each episode, replaced at once or not at all
DIR/policies/NNN.safetensors    the policy after episode NNN
DIR/tensorboard/           reward terms, losses, steps walked
"""

from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
import yaml
from rabbit_description.atomic_file import replacing
from rl_cbf_clf_controller.policy import ActorPolicy, Policy, ZeroPolicy

from rl_trainer.parameters import TrainingParameters
from rl_trainer.rollout import Controller, Simulation, rollout
from rl_trainer.training import EpisodePlan, EpisodeReport, Trainer

MakeController = Callable[[Policy, float], Controller]  # (policy, sigma)
CHECKPOINT = "checkpoint.pt"


class CheckpointError(RuntimeError):
    """A checkpoint that cannot be resumed from."""


def train(trainer: Trainer, simulation: Simulation, make_controller: MakeController) -> Iterator[EpisodeReport]:
    """Walk and learn until the trainer's number of episodes is reached; yields after each."""
    while trainer.episode < trainer.parameters.episodes:
        plan = trainer.begin_episode()
        controller = make_controller(policy_of(plan, trainer.parameters), plan.sigma)
        last = rollout(simulation, controller, plan.seed, lambda record: trainer.observe(record.state, record.output))
        yield trainer.end_episode(plan, last)


def policy_of(plan: EpisodePlan, parameters: TrainingParameters) -> Policy:
    """The policy that an episode walks with."""
    return ActorPolicy(plan.policy) if plan.policy else ZeroPolicy(parameters.problem)


class Session:
    """Trains in a folder, and goes on there if it was killed."""

    def __init__(self, folder: Path, trainer: Trainer) -> None:
        """Raises `CheckpointError` where the folder holds a session of other parameters."""
        self.folder, self.trainer = folder, trainer
        self.resumed = open_folder(folder, trainer) is not None
        text = yaml.safe_dump(trainer.parameters.model_dump(mode="json"), sort_keys=False)
        (folder / "parameters.yaml").write_text(text, encoding="utf-8")

    def run(self, simulation: Simulation, make_controller: MakeController) -> Iterator[EpisodeReport]:
        """The rest of the episodes; all is on disk when an episode's report is yielded."""
        from torch.utils.tensorboard import SummaryWriter  # half a second, for this alone

        writer = SummaryWriter(self.folder / "tensorboard", purge_step=self.trainer.episode)
        try:
            for report in train(self.trainer, simulation, make_controller):
                save_episode(self.folder, self.trainer)
                for name, value in scalars(report).items():
                    writer.add_scalar(name, value, report.episode)
                writer.flush()
                yield report
        finally:
            writer.close()


def scalars(report: EpisodeReport) -> dict[str, float]:
    """What is logged of an episode, by name."""
    values = asdict(report)
    walk = {f"episode/{name}": float(values[name]) for name in ("steps", "ticks", "kept", "failed", "sigma")}
    groups = {f"{group}/{name}": v for group in ("reward", "losses", "left_out") for name, v in values[group].items()}
    return walk | groups


def open_folder(folder: Path, trainer: Trainer) -> dict[str, Any] | None:
    """Make the folder, or go on from its checkpoint; returns what else was kept there, None without a checkpoint.

    Raises:
        CheckpointError: see `load_checkpoint`; or a folder that cannot be made.
    """
    try:
        (folder / "policies").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CheckpointError(f"folder {folder}: {error.strerror}") from error
    path = folder / CHECKPOINT
    return load_checkpoint(path, trainer) if path.exists() else None


def save_episode(folder: Path, trainer: Trainer, more: dict[str, Any] | None = None) -> None:
    """Write the policy, then all of the trainer's state and what else is to be kept; each at once or not at all."""
    trainer.policy_file().write(folder / "policies" / f"{trainer.episode:03d}.safetensors")
    state = {"parameters": trainer.parameters.key, **trainer.state_dict(), "more": more or {}}
    with replacing(folder / CHECKPOINT) as partial:
        torch.save(state, partial)


def load_checkpoint(path: Path, trainer: Trainer) -> dict[str, Any]:
    """Bring the trainer to where the checkpoint was taken; returns what else was kept.

    Raises:
        CheckpointError: damaged, or of other parameters (the number of episodes may differ).
    """
    try:
        state: dict[str, Any] = torch.load(path, weights_only=True)
        is_ours = state.pop("parameters") == trainer.parameters.key
        if is_ours:
            trainer.load_state_dict(state)
    except Exception as error:  # a damaged file may raise anything
        text = " ".join(str(error).split())
        raise CheckpointError(f"checkpoint {path}: {type(error).__name__}: {text[:200]}") from error
    if not is_ours:
        raise CheckpointError(f"checkpoint {path}: made with other parameters; use another folder, or the same ones")
    return state.get("more", {})

"""A training session on disk: the episode loop, checkpoints that a killed run resumes from, TensorBoard, policies.

DIR/parameters.yaml        what was asked for
DIR/checkpoint.pt          after each episode, with a checksum; replaced at once or not at all
DIR/checkpoint-before.pt   the one before; training goes on from it where the newest is damaged
DIR/policies/NNN.safetensors    the policy after episode NNN
DIR/tensorboard/           reward terms, losses, steps walked
"""

import hashlib
import io
import json
import logging
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import torch
from rabbit_description.atomic_file import remove_partials, replace_text, replacing
from rabbit_description.bounded_file import read_bytes
from rabbit_description.yaml_file import dump_yaml
from rl_cbf_clf_controller.policy import ActorPolicy, LearnedPolicy, ZeroPolicy

from rl_trainer.parameters import TrainingParameters
from rl_trainer.rollout import Controller, Simulation, rollout
from rl_trainer.training import EpisodePlan, EpisodeReport, Trainer

MakeController = Callable[[LearnedPolicy, float], Controller]  # (policy, sigma)
CHECKPOINT, BEFORE = "checkpoint.pt", "checkpoint-before.pt"
MOST_BYTES = 10_000_000_000  # of a checkpoint; 5,000,000 transitions have half of it
DIGEST = hashlib.sha256().digest_size  # bytes at the head of a checkpoint

log = logging.getLogger(__name__)


class CheckpointError(RuntimeError):
    """A checkpoint that cannot be resumed from."""


def train(trainer: Trainer, simulation: Simulation, make_controller: MakeController) -> Iterator[EpisodeReport]:
    """Walk and learn until the trainer's number of episodes is reached; yields after each."""
    while trainer.episode < trainer.parameters.episodes:
        plan = trainer.begin_episode()
        controller = make_controller(policy_of(plan, trainer.parameters), plan.sigma)
        last = rollout(simulation, controller, plan.seed, lambda record: trainer.observe(record.state, record.output))
        yield trainer.end_episode(plan, last)


def policy_of(plan: EpisodePlan, parameters: TrainingParameters) -> LearnedPolicy:
    """The policy that an episode walks with."""
    return ActorPolicy(plan.policy) if plan.policy else ZeroPolicy(parameters.problem)


class Session:
    """Trains in a folder, and goes on there if it was killed.

    `episodes`: of each episode its `EpisodeReport` as a dict, with the `seconds` that it took. They are part of the
    checkpoint, so that a kill loses none.
    """

    def __init__(self, folder: Path, trainer: Trainer) -> None:
        """Raises `CheckpointError` where the folder holds a session of other parameters."""
        self.folder, self.trainer = folder, trainer
        more = open_folder(folder, trainer)
        self.resumed = more is not None
        self.episodes: list[dict[str, Any]] = json.loads((more or {}).get("episodes", "[]"))
        replace_text(folder / "parameters.yaml", dump_yaml(trainer.parameters.model_dump(mode="json")))

    def run(self, simulation: Simulation, make_controller: MakeController) -> Iterator[EpisodeReport]:
        """The rest of the episodes; all is on disk when an episode's report is yielded."""
        from torch.utils.tensorboard import SummaryWriter  # half a second, for this alone

        newest = self.episodes[-1:]  # a kill after its checkpoint may have kept it from TensorBoard
        writer = SummaryWriter(self.folder / "tensorboard", purge_step=self.trainer.episode - len(newest))
        try:
            for episode in newest:
                _log(writer, episode)
            start = time.perf_counter()
            for report in train(self.trainer, simulation, make_controller):
                self.episodes.append({**asdict(report), "seconds": time.perf_counter() - start})
                save_episode(self.folder, self.trainer, {"episodes": json.dumps(self.episodes)})
                _log(writer, self.episodes[-1])
                yield report
                start = time.perf_counter()
        finally:
            writer.close()


def _log(writer: Any, episode: Mapping[str, Any]) -> None:
    for name, value in scalars(episode).items():
        writer.add_scalar(name, value, episode["episode"])
    writer.flush()


def scalars(values: Mapping[str, Any]) -> dict[str, float]:
    """What is logged of an episode, by name, from its report as a dict."""
    walk = {f"episode/{name}": float(values[name]) for name in ("steps", "ticks", "kept", "failed", "sigma")}
    groups = {f"{group}/{name}": v for group in ("reward", "losses", "left_out") for name, v in values[group].items()}
    return walk | groups


def open_folder(folder: Path, trainer: Trainer) -> dict[str, Any] | None:
    """Make the folder, or go on from its checkpoint; returns what else was kept there, None without a checkpoint.

    Raises:
        CheckpointError: damaged, of other parameters (their number of episodes may differ), or a folder that cannot
            be made.
    """
    try:
        (folder / "policies").mkdir(parents=True, exist_ok=True)
        remove_partials(folder)
    except OSError as error:
        raise CheckpointError(f"folder {folder}: {error.strerror}") from error
    state = read_checkpoint(folder)
    return None if state is None else _restore(folder / CHECKPOINT, state, trainer)


def save_episode(folder: Path, trainer: Trainer, more: dict[str, Any] | None = None) -> None:
    """Write the policy, then all of the trainer's state and what else is to be kept; each at once or not at all."""
    trainer.policy_file().write(folder / "policies" / f"{trainer.episode:03d}.safetensors")
    state = {"parameters": trainer.parameters.key, **trainer.state_dict(), "more": more or {}}
    content = io.BytesIO()
    torch.save(state, content)
    data, newest = content.getvalue(), folder / CHECKPOINT
    with replacing(newest) as partial:
        partial.write_bytes(hashlib.sha256(data).digest() + data)
        if newest.exists():
            newest.replace(folder / BEFORE)


def read_checkpoint(folder: Path) -> dict[str, Any] | None:
    """The newest checkpoint that is whole, None where there is none. One that is damaged is said.

    Raises:
        CheckpointError: none is whole.
    """
    wrong = []
    for path in (folder / CHECKPOINT, folder / BEFORE):
        if not path.exists():
            continue
        try:
            state = _read(path)
        except Exception as error:  # a damaged file may raise anything
            wrong.append(f"checkpoint {path}: {' '.join(str(error).split())[:200]}")
            continue
        for text in wrong:
            log.warning("%s; going on from %s", text, path.name)
        return state
    if wrong:
        raise CheckpointError(wrong[0])
    return None


def _read(path: Path) -> dict[str, Any]:
    data = read_bytes(path, MOST_BYTES)
    if hashlib.sha256(data[DIGEST:]).digest() != data[:DIGEST]:
        raise ValueError("damaged, or of another version: its checksum is not that of its content")
    content = io.BytesIO(data[DIGEST:])
    with ZipFile(content) as archive:  # torch writes no other, and would decompress whatever comes
        if any(each.file_size > each.compress_size for each in archive.infolist()):
            raise ValueError("compressed: expected plain tensors")
    content.seek(0)
    state = torch.load(content, weights_only=True)
    if not isinstance(state, dict) or not isinstance(state.get("episode"), int):
        raise ValueError("expected names with values, `episode` a whole number")
    return state


def _restore(path: Path, state: dict[str, Any], trainer: Trainer) -> dict[str, Any]:
    """Bring the trainer to where the checkpoint was taken; returns what else was kept."""
    if state.pop("parameters", None) != trainer.parameters.key:
        raise CheckpointError(f"checkpoint {path}: made with other parameters; use another folder, or the same ones")
    more: dict[str, Any] = state.pop("more", {})
    try:
        trainer.load_state_dict(state)
    except Exception as error:  # of a learner of the user's own
        raise CheckpointError(f"checkpoint {path}: {type(error).__name__}: {str(error)[:200]}") from error
    return more

"""Training end to end: PPO or SAC of stable-baselines3 on `JointTargetEnv`.

A session's folder has

    curve.csv             a line for each `EVALUATION` ticks; PPO ends a line with a whole rollout
    policy.safetensors    the network of the best line
    progress.json         where the session stands; what is written before it does not count without it
    checkpoint-N.zip      the learner at tick N, the last line's; of SAC also checkpoint-N.pkl, its replay buffer

A session that was stopped goes on from its last line; its walks are then other ones. Judged are walks of 20 stones and
20 steps under seeds apart from those of the training.
"""

import csv
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from pydantic import BaseModel, ConfigDict, Field
from rabbit_description.atomic_file import replace_text, replacing
from rabbit_description.bounded_file import FileError, read_json
from rabbit_description.gait import load_gaits
from rabbit_description.state import Array
from rabbit_description.yaml_file import read_mapping
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Simulation
from rl_trainer.rollout import rollout
from torch import nn

from rabbit_rivals.joint_target_env import WIDTHS, JointTargetEnv, walking_parameters
from rabbit_rivals.joint_targets import JointTargetController, NetworkAbout, NetworkPolicy
from rabbit_rivals.model_file import ModelFile

MOST_BYTES = 10_000_000  # of progress.json
HIDDEN = (128, 128)
ENVIRONMENTS = 8
EVALUATION = 100_000  # ticks from one line of the learning curve to the next
JUDGING_SEED, JUDGED = 77_000_000, 10  # walks on each terrain
PPO_SETTINGS, SAC_SETTINGS = read_mapping(Path(__file__).with_name("end_to_end.yaml")).values()
COLUMNS = ("steps", "hours", "level", "stones", "stones_walked", "flat_steps", "flat_walked")


class SessionError(RuntimeError):
    """A folder whose session was another, or is damaged."""


class EndToEndOptions(BaseModel):
    """A session."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    learner: str = Field("ppo", pattern="^(ppo|sac)$", description="ppo or sac")
    steps: int = Field(5_000_000, ge=1, le=10**10, description="ticks in all, 10 ms each")
    seed: int = Field(1, ge=0, le=2**31)
    mass_scale: float = Field(2.0, ge=0.1, le=10, description="of the training's plant")


def train(options: EndToEndOptions, out: Path, tell: Callable[[str], None] = print) -> Path:
    """Train, or go on; returns the policy's file. Raises `SessionError`, `ModuleNotFoundError`."""
    from stable_baselines3 import PPO, SAC
    from stable_baselines3.common.vec_env import DummyVecEnv

    torch.set_num_threads(1)
    out.mkdir(parents=True, exist_ok=True)
    plant: dict[str, Any] = {"plant": "mujoco", "mass_scale": options.mass_scale, "motor_lag": 0.004}
    session = _Session(options, plant, out, tell)
    done = session.progress["steps"]
    envs = DummyVecEnv([lambda: JointTargetEnv(session.progress["level"], **plant)] * ENVIRONMENTS)
    kind, settings = (PPO, PPO_SETTINGS) if options.learner == "ppo" else (SAC, SAC_SETTINGS)
    if done:
        model: Any = kind.load(session.checkpoint(done, "zip"), envs, device="cpu")
        model.set_random_seed(options.seed + done)
        if options.learner == "sac":
            model.load_replay_buffer(session.checkpoint(done, "pkl"))
    else:
        form: dict[str, Any] = {"net_arch": list(HIDDEN), "activation_fn": nn.Tanh}
        if options.learner == "ppo":
            form["log_std_init"] = -1.0
        model = kind("MlpPolicy", envs, policy_kwargs=form, seed=options.seed, device="cpu", **settings)
        if options.learner == "ppo":  # the first action is nearly zero: the reference itself
            model.policy.action_net.weight.data *= 0.01
    while model.num_timesteps < options.steps:
        model.learn(min(EVALUATION, options.steps - model.num_timesteps), reset_num_timesteps=False)
        session.note(model)
    return out / "policy.safetensors"


class _Session:
    """A folder: judges, and writes the curve and the checkpoint of each line. Raises `SessionError`."""

    def __init__(self, options: EndToEndOptions, plant: dict[str, Any], out: Path, tell: Callable[[str], None]) -> None:
        self._options, self._plant, self._out, self._tell = options, plant, out, tell
        self.progress = _read_progress(out, options)
        if self.progress["steps"]:
            self._tidy()
        self._since = time.perf_counter()

    def checkpoint(self, steps: int, suffix: str) -> Path:
        """The learner's file after so many ticks."""
        return self._out / f"checkpoint-{steps}.{suffix}"

    def note(self, model: Any) -> None:
        """Judge the network as it is; a line of the curve, the checkpoint, the best network's file."""
        steps, progress = model.num_timesteps, self.progress
        hours = progress["hours"] + (time.perf_counter() - self._since) / 3600
        level = min(model.get_env().get_attr("level"))
        file = self._file(model, hours)
        line = [steps, round(hours, 4), level]
        for terrain in ("stones", "flat"):
            lengths, walked = judge(file, terrain, self._plant)
            line += [round(float(np.mean(lengths)), 2), walked]
        score = sum(line[3:])
        model.save(self.checkpoint(steps, "zip"))
        if self._options.learner == "sac":
            model.save_replay_buffer(self.checkpoint(steps, "pkl"))
        if score >= progress["best"]:
            file.write(self._out / "policy.safetensors")
        progress |= {"steps": steps, "hours": hours, "level": level, "best": max(score, progress["best"])}
        progress["curve"].append(line)
        replace_text(self._out / "progress.json", json.dumps(progress))
        self._tidy()
        self._since = time.perf_counter()
        self._tell(", ".join(f"{name} {value}" for name, value in zip(COLUMNS, line, strict=True)))

    def _tidy(self) -> None:
        """The curve and the checkpoint that belong to `progress.json`, and no other."""
        with replacing(self._out / "curve.csv") as partial, partial.open("w", newline="") as curve:
            csv.writer(curve, lineterminator="\n").writerows([COLUMNS, *self.progress["curve"]])
        for path in self._out.glob("checkpoint-*"):
            if path.stem != f"checkpoint-{self.progress['steps']}":
                path.unlink()

    def _file(self, model: Any, hours: float) -> ModelFile[NetworkAbout]:
        o = self._options
        about = NetworkAbout(
            learner=o.learner,
            hidden=HIDDEN,
            plant=self._plant,
            steps=model.num_timesteps,
            hours=round(hours, 3),
            seed=o.seed,
            command=f"rabbit rival end-to-end --learner {o.learner} --steps {o.steps} --seed {o.seed} --out DIR",
        )
        return ModelFile(about, network(model, o.learner))


def network(model: Any, learner: str) -> dict[str, Array]:
    """The actor's arrays `0.weight` ... of a stable-baselines3 model."""
    policy = model.policy
    if learner == "ppo":
        layers = [*policy.mlp_extractor.policy_net, policy.action_net]
    else:
        layers = [*policy.actor.latent_pi, policy.actor.mu]
    found: dict[str, Array] = {}
    for i, layer in enumerate(each for each in layers if isinstance(each, nn.Linear)):
        found[f"{i}.weight"] = layer.weight.detach().numpy().copy()
        found[f"{i}.bias"] = layer.bias.detach().numpy().copy()
    return found


def judge(file: ModelFile[NetworkAbout], terrain: str, plant: dict[str, Any]) -> tuple[list[int], int]:
    """Stones or steps of each of the walks, and how many were walked to the end."""
    course = {"stone_width": WIDTHS[-1]} if terrain == "stones" else {}
    simulation = Simulation(
        SimulationParameters.model_validate({**plant, "terrain": terrain, **course}), load_gaits("paper_stones")
    )
    controller = JointTargetController(walking_parameters(terrain), load_gaits("paper_stones"), NetworkPolicy(file))
    lengths, walked = [], 0
    for seed in range(JUDGING_SEED, JUDGING_SEED + JUDGED):
        rollout(simulation, controller, seed)
        missed = [landing.missed or not landing.on_stone for landing in simulation.landings]
        lengths.append(missed.index(True) if True in missed else len(missed))
        walked += simulation.outcome.value == "walked"
    simulation.close()
    return lengths, walked


def _read_progress(out: Path, options: EndToEndOptions) -> dict[str, Any]:
    """Where the session in a folder stands; raises `SessionError`."""
    asked = options.model_dump(exclude={"steps"})
    begin: dict[str, Any] = {"steps": 0, "hours": 0.0, "level": 0, "best": -1.0, "curve": [], "options": asked}
    path = out / "progress.json"
    if not path.is_file():
        return begin
    try:
        found = read_json(path, MOST_BYTES)
    except FileError as error:
        raise SessionError(f"{path}: {error}") from error
    if not isinstance(found, dict) or found.keys() != begin.keys() or found["options"] != asked:
        raise SessionError(f"{path}: not a session with {asked}: use another folder")
    checkpoint = path.with_name(f"checkpoint-{found['steps']}.zip")
    if not checkpoint.is_file():
        raise SessionError(f"{checkpoint}: the session goes on from this file, and it is not there")
    return found

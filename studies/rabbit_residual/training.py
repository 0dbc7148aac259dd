"""A training session of the policy within the step.

Its folder has

    curve.csv             a line for each rollout
    session.pt            where it stands, written every `KEPT` rollouts and at the end; it goes on from there
    policy.safetensors    the network, likewise; as a robot walks with it, without noise

After a stop the robots begin new episodes.
"""

import csv
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from pydantic import BaseModel, ConfigDict, Field
from rabbit_benchmark.cells import Terrain
from rabbit_description.atomic_file import replacing
from rabbit_experiments.provenance import commit
from rl_cbf_clf_controller.residual_policy import INPUTS, READS
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP
from rl_cbf_clf_controller.weights import PROBE, RESIDUAL_READS, Actor, PolicyFile, PolicyMetadata, probe_inputs

from rabbit_residual.fleet import KNOWN, Fleet
from rabbit_residual.ppo import Ppo, PpoParameters

SESSION, KEPT = "session.pt", 5  # rollouts
COLUMNS = ("ticks", "hours", "stones_walked", "flat_walked", "episodes", "reward", "std", "divergence")


class SessionError(RuntimeError):
    """A folder whose session was another, or is damaged."""


class Options(BaseModel):
    """A session; `ticks` may grow when it goes on."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    ticks: int = Field(6_000_000, ge=1, le=10**11)
    seed: int = Field(1, ge=0, le=2**31)
    robots: int = Field(128, ge=4, le=4096, description="that walk side by side")
    flat: float = Field(0.25, ge=0, le=1, description="share of them on flat ground")
    rollout: int = Field(96, ge=2, le=10_000, description="ticks of each robot between two updates")
    ppo: PpoParameters = PpoParameters()

    @property
    def asked(self) -> str:
        """What decides a session."""
        return repr(self.model_dump(exclude={"ticks"}))


def train(options: Options, out: Path, tell: Callable[[str], None] = print) -> Path:
    """Train, or go on; returns the policy's file. Raises `SessionError`."""
    torch.set_num_threads(1)
    out.mkdir(parents=True, exist_ok=True)
    learner = Ppo(READS, KNOWN, INPUTS, options.ppo, options.seed)
    done: dict[str, Any] = {"ticks": 0, "hours": 0.0, "episodes": 0}
    if (out / SESSION).is_file():
        done = _restore(out / SESSION, learner, options)
    flat = round(options.robots * options.flat)
    shares: dict[Terrain, int] = {"stones": options.robots - flat, "flat": flat}
    seeds = [options.seed, done["ticks"]]
    fleets = {
        terrain: Fleet(terrain, share, learner.act, [*seeds, i])
        for i, (terrain, share) in enumerate(shares.items())
        if share
    }
    _trim(out / "curve.csv", done["ticks"])
    rollouts = 0
    try:
        while done["ticks"] < options.ticks:
            start = time.perf_counter()
            found = [fleet.walk(options.rollout) for fleet in fleets.values()]
            divergence = learner.update(found)
            done["ticks"] += options.robots * options.rollout
            done["hours"] += (time.perf_counter() - start) / 3600
            done["episodes"] += sum(len(fleet.ends) for fleet in fleets.values())
            ends = [fleets[terrain].ends if terrain in fleets else [] for terrain in shares]
            walked = [np.mean([good for good, _ in each]) if each else np.nan for each in ends]
            reward = float(np.mean(np.concatenate([each.reward.ravel() for each in found])))
            figures = [*walked, done["episodes"], reward, learner.std, divergence]
            line = [done["ticks"], f"{done['hours']:.4f}", *(f"{value:.4g}" for value in figures)]
            with (out / "curve.csv").open("a", newline="") as curve:
                csv.writer(curve, lineterminator="\n").writerow(line)
            tell(", ".join(f"{name} {value}" for name, value in zip(COLUMNS, line, strict=True)))
            rollouts += 1
            if rollouts % KEPT == 0:
                _keep(out, learner, options, done)
    finally:
        if rollouts:
            _keep(out, learner, options, done)
    return out / "policy.safetensors"


def _keep(out: Path, learner: Ppo, options: Options, done: dict[str, Any]) -> None:
    """The session as it stands, and the policy."""
    with replacing(out / SESSION) as partial:
        torch.save({"learner": learner.state(), "asked": options.asked, "done": done}, partial)
    _policy(learner, options, done).write(out / "policy.safetensors")


def _restore(path: Path, learner: Ppo, options: Options) -> dict[str, Any]:
    """Where the session stands; raises `SessionError`."""
    try:
        state = torch.load(path, weights_only=True)
        if state["asked"] != options.asked:
            raise SessionError(f"{path}: a session with {state['asked']}: use another folder")
        learner.restore(state["learner"], options.seed + state["done"]["ticks"])
        return dict(state["done"])
    except SessionError:
        raise
    except Exception as error:  # torch raises what it likes
        raise SessionError(f"{path}: damaged: {str(error).splitlines()[0]}") from error


def _trim(path: Path, ticks: int) -> None:
    """Lines of the curve that belong to what was kept, and no other."""
    lines = list(csv.reader(path.open(newline=""))) if path.is_file() else []
    kept = [line for line in lines[1:] if line and line[0].isdigit() and int(line[0]) <= ticks]
    with replacing(path) as partial, partial.open("w", newline="") as curve:
        csv.writer(curve, lineterminator="\n").writerows([COLUMNS, *kept])


def _policy(learner: Ppo, options: Options, done: dict[str, Any]) -> PolicyFile:
    """The network as a policy file."""
    arrays = learner.arrays()
    metadata = PolicyMetadata(
        problem=RL_CBF_CLF_QP.name,
        observation=RESIDUAL_READS,
        observation_center=(0.0,) * READS,
        observation_scale=(1.0,) * READS,
        hidden=(options.ppo.hidden, options.ppo.hidden),
        structured=False,
        alpha_scale=(),
        beta_scale=(),
        residual=True,
        adaptation="identification",
        learner="ppo",
        plant={"plant": "mujoco"},
        training_seed=options.seed,
        episodes=done["episodes"],
        transitions=done["ticks"],
        commit=commit(),
        command=f"rabbit residual --ticks {done['ticks']} --seed {options.seed} --out DIR",
    )
    actor = Actor(arrays)
    return PolicyFile(metadata, {**arrays, PROBE: actor(probe_inputs(READS))})

"""Policies by what must become of them, and how the good ones walk in process."""

import dataclasses
import hashlib
from functools import cache
from pathlib import Path

import numpy as np
from rabbit_description.gait import load_gait
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Simulation
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ActorPolicy, ZeroPolicy
from rl_cbf_clf_controller.uncertainty import RL_CLF_QP
from rl_cbf_clf_controller.weights import SIZE_LIMIT, PolicyFile, decode, policy_path, read
from rl_trainer.rollout import rollout

from tests.ros.test_policies import policy, tampered

PARAMETERS = ControllerParameters(controller="rl-cbf-clf-qp")
PLANT = SimulationParameters(stones=2, motor_lag=0.004)
ZERO = "zero"
SEEDS = (1, 2, 3)
SIGMAS = (0.0, 0.5, 5.0)  # rad/s^2; with all of them every good policy walks from each of the seeds


@cache
def good() -> dict[str, bytes]:
    """Sound policies that fit, by name."""
    files = {"one": policy(1, 0.05), "two": policy(2, -0.05), "shipped": read(policy_path("rl-cbf-clf-qp-scale-0.7"))}
    return {name: file.encode() for name, file in files.items()}


@cache
def bad() -> dict[str, bytes]:
    """Unfit and forged ones."""
    sound: PolicyFile = policy(3)
    other = np.full(sound.arrays["0.bias"].shape, 0.3, dtype=np.float32)
    data = sound.encode()
    adapted = dataclasses.replace(sound, metadata=sound.metadata.model_copy(update={"adaptation": "identification"}))
    return {
        "for another problem": policy(3, problem=RL_CLF_QP).encode(),
        "for another adaptation": adapted.encode(),
        "random bytes": np.random.default_rng(1).bytes(500),
        "three bytes": b"\x01\x02\x03",
        "empty": b"",
        "truncated": data[: len(data) // 2],
        "wrong hash": tampered(sound, other),
        "not finite": tampered(sound, other * np.nan),
        "huge": data + bytes(SIZE_LIMIT),
    }


def version_of(name: str) -> str:
    """The version of a good policy."""
    return decode(good()[name]).version


def write_all(folder: Path) -> None:
    """Good and bad ones as files by their names."""
    folder.mkdir()
    for name, data in {**good(), **bad()}.items():
        (folder / name).write_bytes(data)


@cache
def torques_of(version: str, seed: int, sigma: float) -> list[bytes]:
    """The torques of a walk in process, tick by tick; it must walk, or the pool is wrong."""
    versions = {version_of(name): name for name in good()}
    actor = ZeroPolicy(PARAMETERS.problem) if version == ZERO else ActorPolicy(decode(good()[versions[version]]))
    gait, torques = load_gait(PARAMETERS.gait), []
    simulation = Simulation(PLANT, gait)
    controller = Controller(PARAMETERS.model_copy(update={"sigma": sigma}), gait, actor)
    rollout(simulation, controller, seed, lambda record: torques.append(record.output.torque.tobytes()))
    outcome = simulation.outcome.value
    simulation.close()
    assert outcome == "walked", f"policy {version}, seed {seed}, sigma {sigma}: {outcome}"
    return torques


def digest(torques: list[bytes]) -> str:
    """Short enough for a message."""
    return f"{len(torques)} ticks, {hashlib.sha256(b''.join(torques)).hexdigest()[:8]}"

"""Policies that change while the robot walks: no tick is lost, every torque says which one made it."""

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from rabbit_bringup.recording.reader import read_episodes
from rabbit_bringup.recording.replay import differing_ticks
from rabbit_msgs.msg import Episode, PolicyWeights
from rabbit_msgs.srv import LoadPolicy, ResetEpisode
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.uncertainty import Problem
from rl_cbf_clf_controller.weights import PolicyFile, PolicyMetadata, probe_inputs

PLANT = {"motor_lag": 0.004, "stones": 5}
LAW = ControllerParameters(controller="rl-cbf-clf-qp")
HIDDEN = (8, 8)


def policy(number: int, bias: float = 0.0, problem: Problem = Problem.RL_CBF_CLF_QP) -> PolicyFile:
    """A policy whose outputs are all tanh(bias), whatever it sees; another one for each number."""
    n = len(problem.quantities)
    metadata = PolicyMetadata(
        problem=problem,
        observation=problem.observation,
        observation_center=(0.0,) * len(problem.observation),
        observation_scale=(1.0,) * len(problem.observation),
        hidden=HIDDEN,
        structured=False,
        alpha_scale=(0.1,) * n,
        beta_scale=(1.0,) * n,
        learner="test",
        plant={},
        training_seed=number,
        episodes=0,
        transitions=0,
        commit="",
        command="",
    )
    sizes = (len(problem.observation), *HIDDEN, metadata.outputs)
    arrays: dict[str, NDArray[np.float32]] = {}
    for i, (before, after) in enumerate(itertools.pairwise(sizes)):
        arrays[f"{i}.weight"] = np.zeros((after, before), dtype=np.float32)
        arrays[f"{i}.bias"] = np.full(after, bias if i == 2 else number, dtype=np.float32)
    rows = len(probe_inputs(1))
    arrays["probe.outputs"] = np.full((rows, metadata.outputs), math.tanh(bias), dtype=np.float32)
    return PolicyFile(metadata, arrays)


def weights(file: PolicyFile) -> PolicyWeights:
    """As the trainer sends them."""
    return PolicyWeights(version=file.version, source="test", data=file.encode())


def over(episodes: list[Episode], number: int = 1) -> bool:
    """Whether episode `number` has ended."""
    return any(e.episode >= number and e.phase == Episode.ENDED for e in episodes)


def test_many_swaps_in_one_walk(world: Any) -> None:
    """Policies without an effect: the torques are those of a walk without them; with one, a replay gives them again."""
    commands, swaps, episodes = world.hear("torque"), world.hear("policy_swap"), world.hear("episode")
    world.start("simulator", pace=1.0, stop_at_miss=False, **PLANT)
    world.start("controller", **LAW.model_dump())
    world.start("recorder", path=str(world.folder / "recording"))
    world.say("policy", weights(policy(0)))
    world.go()
    sent = 1
    while not over(episodes):
        world.say("policy", weights(policy(sent, bias=0.01 * (sent % 3))))
        world.spin(0.02)
        sent += 1
    world.spin(0.5)
    world.processes.stop(("simulator", "controller"))
    world.processes.stop()
    assert episodes[-1].outcome == "walked"
    assert [command.tick for command in commands] == list(range(episodes[-1].tick))
    accepted = [swap for swap in swaps if swap.accepted and swap.episode == 1]
    assert len(accepted) > 50
    by_tick = {swap.tick: swap.version for swap in accepted}
    version = by_tick.get(0, [swap.version for swap in swaps if swap.episode == 0][-1])
    for command in commands:
        version = by_tick.get(command.tick, version)
        assert command.policy_version == version
    recorded = read_episodes(world.folder / "recording")[1]
    assert len(recorded.records) == len(commands)
    assert differing_ticks(recorded, LAW) == []


def test_bad_policies_are_refused_with_a_reason(world: Any, tmp_path: Path) -> None:
    swaps = world.hear("policy_swap")
    world.start("controller", **LAW.model_dump())
    world.wait(lambda: bool(swaps))
    assert (swaps[0].version, swaps[0].accepted) == ("zero", True)
    good = policy(1)
    wrong = {
        "not a policy file": PolicyWeights(version="x", data=b"\x00" * 100),
        "": PolicyWeights(version=good.version, data=good.encode()[:-1] + b"\x01"),
        "the message says version": PolicyWeights(version="other", data=good.encode()),
        "trained for": weights(policy(1, problem=Problem.RL_CLF_QP)),
    }
    for number, (reason, message) in enumerate(wrong.items(), 1):
        world.say("policy", message)
        world.wait(lambda number=number: len(swaps) > number)
        assert not swaps[-1].accepted
        assert reason in swaps[-1].reason
    files = {"No such file": tmp_path / "none", "directory": tmp_path, "not a policy": Path(__file__)}
    for reason, path in files.items():
        answer = world.ask(LoadPolicy, "load_policy", path=str(path))
        assert not answer.accepted
        assert reason in answer.message
    assert all(not swap.accepted for swap in swaps[1:])


@pytest.mark.parametrize("swap_at", ["tick", "episode", "never"])
def test_when_policies_take_effect(world: Any, tmp_path: Path, swap_at: str) -> None:
    commands, episodes = world.hear("torque"), world.hear("episode")
    world.start("simulator", pace=2.0, episodes=0, **PLANT)
    world.start("controller", swap_at=swap_at, **LAW.model_dump())
    world.go()
    assert world.ask(ResetEpisode, "reset_episode", seed=1).accepted
    world.wait(lambda: len(commands) > 10)
    world.say("policy", weights(policy(1)))
    world.wait(lambda: over(episodes))
    first, published = {command.policy_version for command in commands}, policy(1).version
    assert first == ({"zero", published} if swap_at == "tick" else {"zero"})
    assert world.ask(ResetEpisode, "reset_episode", seed=1).accepted
    world.wait(lambda: commands[-1].episode == 2)
    assert commands[-1].policy_version == ("zero" if swap_at == "never" else published)
    policy(2).write(tmp_path / "two.safetensors")
    answer = world.ask(LoadPolicy, "load_policy", path=str(tmp_path / "two.safetensors"))
    assert (answer.accepted, answer.version) == (True, policy(2).version)
    world.wait(lambda: commands[-1].policy_version == answer.version)
    assert commands[-1].episode == 2

"""Policies that change while the robot walks: no tick is lost, every torque says which one made it."""

import dataclasses
import itertools
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from rabbit_campaigns.soak_operations import near_policy
from rabbit_command import rabbit
from rabbit_msgs.msg import Episode, EpisodePlan, PolicyWeights
from rabbit_msgs.srv import LoadPolicy, ResetEpisode
from rabbit_recording.checking import check_episodes
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP, RL_CLF_QP
from rl_cbf_clf_controller.weights import PROBE, PolicyFile, policy_path
from safetensors.numpy import save
from untrained_policy import policy_file, policy_metadata

PLANT = {"motor_lag": 0.004, "stones": 5}
SHORT = {"motor_lag": 0.004, "stones": 2}
PARAMETERS = ControllerParameters(controller="rl-cbf-clf-qp")
SHIPPED = policy_path("rl-cbf-clf-qp")


def policy(number: int, problem: Problem = RL_CBF_CLF_QP) -> PolicyFile:
    """A policy whose outputs are all zero; another one for each number."""
    return policy_file(policy_metadata(problem, hidden=(8, 8), training_seed=number), np.zeros)


UNFIT = policy(1, problem=RL_CLF_QP)


def weights(file: PolicyFile) -> PolicyWeights:
    """As the trainer sends them."""
    return PolicyWeights(version=file.version, source="test", data=file.encode())


def tampered(file: PolicyFile, bias: NDArray[np.float32]) -> bytes:
    """A policy file in which one array is replaced and the header says nothing of it."""
    head = {"content_hash": file.content_hash, "metadata": file.metadata.model_dump(mode="json")}
    return bytes(save({**file.arrays, "0.bias": bias}, metadata={"rabbit_policy": json.dumps(head)}))


def test_a_hundred_swaps_in_one_walk(world: Any) -> None:
    """At twice the mass, from messages and files: no tick lost, no stone missed, a replay gives the torques."""
    commands, swaps, episodes = world.hear("torque"), world.hear("policy_swap"), world.hear("episode")
    world.start("simulator", pace=0.8, **{**PLANT, "stones": 20, "mass_scale": 2.0})
    world.start("controller", **PARAMETERS.model_dump())
    world.start("recorder", path=str(world.folder / "recording"))
    world.say("policy", weights(near_policy(SHIPPED, 0)))
    world.go()
    loaded: set[str] = set()
    for sent in itertools.takewhile(lambda _: not world.ends(), itertools.count(1)):
        file = near_policy(SHIPPED, sent)
        if sent % 10:
            world.say("policy", weights(file))
        else:
            file.write(world.folder / "policy.safetensors")
            loaded.add(world.ask(LoadPolicy, "load_policy", policy=str(world.folder / "policy.safetensors")).version)
        world.spin(0.04)
    world.spin(0.5)
    world.processes.stop(("simulator", "controller"))
    world.processes.stop()
    assert (episodes[-1].outcome, episodes[-1].touchdowns) == ("walked", 20)
    answered = list(dict.fromkeys(command.tick for command in commands))  # an answer may be repeated when asked again
    assert answered == list(range(episodes[-1].tick))
    accepted = [swap for swap in swaps if swap.accepted and swap.episode == 1]
    assert len(accepted) >= 100
    assert loaded & {swap.version for swap in accepted}
    by_tick = {swap.tick: swap.version for swap in accepted}
    version = by_tick.get(0, [swap.version for swap in swaps if swap.episode == 0][-1])
    for command in commands:
        version = by_tick.get(command.tick, version)
        assert command.policy_version == version
    (checked,) = check_episodes(world.folder / "recording")
    assert checked.replayed == len(checked.episode.records) == len(answered)
    assert checked.differing == []


def test_bad_policies_are_refused_with_a_reason_and_the_old_one_goes_on(world: Any, tmp_path: Path) -> None:
    commands, swaps = world.hear("torque"), world.hear("policy_swap")
    good = policy(1)
    other, long, nan = (np.full(n, value, dtype=np.float32) for n, value in ((8, 0.3), (9, 1.0), (8, np.nan)))
    bad = {
        "not a policy file": b"\x00" * 100,
        "content hash": tampered(good, other),
        "expected float32 (8,)": tampered(good, long),
        "not finite": tampered(good, nan),
        "trained for": policy(1, problem=RL_CLF_QP).encode(),
        "fixed observations": dataclasses.replace(good, arrays={**good.arrays, PROBE: good.arrays[PROBE] + 1}).encode(),
    }
    good.write(tmp_path / "good")
    world.walk({**PARAMETERS.model_dump(), "policy": str(tmp_path / "good")}, pace=1.0, **{**PLANT, "stones": 200})
    world.wait(lambda: bool(commands and swaps))
    messages = {**bad, "the message says version": policy(2).encode()}
    for number, (reason, data) in enumerate(messages.items(), 2):
        world.say("policy", PolicyWeights(version="x", data=data))
        world.wait(lambda number=number: len(swaps) >= number)
        assert reason in swaps[-1].reason
    for number, (reason, data) in enumerate(bad.items()):
        (tmp_path / f"{number}").write_bytes(data)
        answer = world.ask(LoadPolicy, "load_policy", policy=str(tmp_path / f"{number}"))
        assert (answer.success, reason in answer.message) == (False, True), answer.message
    world.wait(lambda: len(swaps) == 1 + len(messages) + len(bad))
    world.wait(lambda: commands[-1].tick > swaps[-1].tick + 10)
    assert not world.ends()
    assert [swap.version for swap in swaps if swap.accepted] == [good.version]
    assert {command.policy_version for command in commands} == {good.version}


@pytest.mark.parametrize("swap_at", ["tick", "episode"])
def test_when_policies_take_effect(world: Any, tmp_path: Path, swap_at: str) -> None:
    commands = world.hear("torque")
    world.walk({**PARAMETERS.model_dump(), "swap_at": swap_at}, pace=2.0, episodes=0, **PLANT)
    assert world.ask(ResetEpisode, "reset_episode", seed=1).success
    world.wait(lambda: len(commands) > 10)
    world.say("policy", weights(policy(1)))
    world.ended()
    first, published = {command.policy_version for command in commands}, policy(1).version
    assert first == ({"zero", published} if swap_at == "tick" else {"zero"})
    assert world.ask(ResetEpisode, "reset_episode", seed=1).success
    world.wait(lambda: commands[-1].episode == 2)
    assert commands[-1].policy_version == published
    policy(2).write(tmp_path / "two.safetensors")
    answer = world.ask(LoadPolicy, "load_policy", policy=str(tmp_path / "two.safetensors"))
    assert (answer.success, answer.version) == (True, policy(2).version)
    world.wait(lambda: commands[-1].policy_version == answer.version)
    assert commands[-1].episode == 2
    log = world.log("controller")
    assert f"policy {answer.version} of {tmp_path}/two.safetensors in force from tick " in log


def planned(world: Any, version: str) -> None:
    """A simulator that follows plans, a controller, and a plan of episode 1 with this policy."""
    world.start("simulator", trainer="follow", **SHORT)
    world.start("controller", swap_at="episode", **PARAMETERS.model_dump())
    world.say("episode_plan", EpisodePlan(seed=1, policy_version=version))


def test_an_unfit_policy_ends_the_episode_that_names_it(world: Any) -> None:
    episodes, swaps = world.hear("episode"), world.hear("policy_swap")
    planned(world, UNFIT.version)
    world.say("policy", weights(UNFIT))
    for number in range(2):  # others that are refused do not hide the reason
        world.say("policy", weights(policy(number, problem=RL_CLF_QP)))
        world.say("policy", PolicyWeights(version=UNFIT.version, data=[1, 2, 3]))
    world.wait(lambda: len(swaps) == 6)
    world.go()
    world.ended()
    assert episodes[-1].outcome == "fault"
    assert episodes[-1].reason.startswith(f"policy {UNFIT.version} was refused: policy: it was trained for")


def test_a_planned_policy_is_waited_for_whatever_others_publish_under_its_name(world: Any) -> None:
    commands, episodes, swaps = world.hear("torque"), world.hear("episode"), world.hear("policy_swap")
    real, other = policy(1), policy(2)
    planned(world, real.version)
    world.go()
    world.wait(lambda: any(e.phase == Episode.RUNNING for e in episodes))
    for data in (b"123", UNFIT.encode(), other.encode()):
        world.say("policy", PolicyWeights(version=real.version, data=data))
    world.wait(lambda: len(swaps) == 4)
    world.spin(0.5)
    assert not commands
    world.say("policy", PolicyWeights(version="x", data=real.encode()))  # its bytes, misnamed: no word on it
    world.wait(lambda: len(swaps) == 5)
    world.say("policy", weights(real))
    world.ended()
    assert episodes[-1].outcome == "walked"
    assert {command.policy_version for command in commands} == {real.version}


def test_no_thread_of_a_controller_with_a_priority_is_ordinary(world: Any) -> None:
    """One that checks policies holds the interpreter's lock now and then; a busy machine must not keep it there."""
    world.start("controller", priority=20, **PARAMETERS.model_dump())
    world.wait(lambda: "scheduling" in world.figures("controller"))
    if world.figures("controller")["scheduling"] == "ordinary":
        pytest.skip("this user may not take SCHED_FIFO")
    process = world.processes.pid("controller")
    threads = [int(thread.name) for thread in Path(f"/proc/{process}/task").iterdir()]
    assert {os.sched_getscheduler(thread) for thread in threads} == {os.SCHED_FIFO}
    assert {os.sched_getparam(thread).sched_priority for thread in threads} == {19, 20}


def load(*words: object) -> tuple[int, str]:
    """Exit code and line of `rabbit policy load`."""
    done = rabbit("policy", "load", *words)
    return done.returncode, done.stdout + done.stderr


def test_an_operator_loads_policies_by_command(world: Any, tmp_path: Path) -> None:
    swaps, file = world.hear("policy_swap"), tmp_path / "one.safetensors"
    policy(1).write(file)
    world.start("controller", **PARAMETERS.model_dump())
    world.wait(lambda: bool(swaps))
    there = ("--namespace", world.namespace)
    assert load(file, *there) == (0, f"{file}: loaded, version {policy(1).version}\n")
    code, said = load(tmp_path / "none", *there)
    assert (code, said.count("\n")) == (2, 1)
    assert f"the controller refused {tmp_path}/none: cannot read" in said
    assert load("zero", *there) == (0, "zero: loaded, version zero\n")
    world.wait(lambda: swaps[-1].version == "zero")
    code, said = load("nope", *there)
    assert (code, said.count("\n")) == (2, 1)
    assert "nope: expected a policy file, zero, or one of" in said
    none = "rabbit: no graph in namespace /nobody: start one with `rabbit walk`, or wait for one with --timeout\n"
    assert load("zero", "--namespace", "nobody") == (1, none)

"""End to end on a task: what a network reads, what it is paid, and that a file rides as it was trained."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from own_cart import cart
from rabbit_bringup.cli import app as rabbit
from rabbit_description.task import TaskError
from rabbit_description.task_source import load_task
from rabbit_recording.checking import check_episodes
from rabbit_recording.task_recording import write_ride
from rabbit_rivals import task_policy
from rabbit_rivals.commands.rival import app as rival
from rabbit_rivals.task_policy import BROKEN, PER_TICK, TaskVectorEnv
from rl_cbf_clf_controller.task_controller import TaskController
from rl_trainer.task_episode import ride_of
from typer.testing import CliRunner

__all__ = ["cart"]


def test_robots_side_by_side_are_rides_of_the_true_system(cart: Path) -> None:
    """Each under its own inputs; a twin in process is where it is, and V at its state is paid."""
    task = load_task(str(cart))
    env = TaskVectorEnv(task, 3)
    reads, _ = env.reset(seed=5)
    assert env.about.reads == ("x", "dx", "target", "wall", "eta1", "eta2")
    true, rng = task.parameters_at(task.true, {"target": 1.2}), np.random.default_rng(1)
    x = reads[:, :2] * env.about.scale[:2] + env.about.center[:2]
    for _ in range(40):
        actions = rng.uniform(-1.5, 1.5, (3, 1))
        reads, reward, failed, cut, _ = env.step(actions)
        x = np.array([task.moved(*ride).x for ride in zip(x, [true] * 3, actions.clip(-1, 1) * 20.0, strict=True)])
        np.testing.assert_allclose(reads[:, :2] * env.about.scale[:2] + env.about.center[:2], x, atol=1e-12)
        V = [task.tick.look(state, task.parameters_at({}, {"target": 1.2})).V[0] for state in x]
        np.testing.assert_allclose(reward, PER_TICK / (1 + np.array(V) / env.about.V))
        assert not (failed | cut).any()


def test_a_broken_barrier_ends_an_episode_and_the_next_one_begins(cart: Path) -> None:
    task = load_task(str(cart))
    env = TaskVectorEnv(task, 2)
    env.reset(seed=1)
    for _ in range(400):
        reads, reward, failed, cut, infos = env.step(np.ones((2, 1)))
        if failed.any():
            break
    assert reward[failed] == pytest.approx(BROKEN)
    wall = env.about.reads.index("wall")
    last, now = (
        rows[failed, wall] * env.about.scale[wall] + env.about.center[wall] for rows in (infos["final_obs"], reads)
    )
    assert (last < 0.3).all()  # a tick before
    assert (now > 0.8).all()
    assert not cut[failed].any()


def test_a_task_that_is_not_batched_or_has_nothing_to_follow_is_refused(cart: Path) -> None:
    task = load_task(str(cart))
    with pytest.raises(TaskError, match="plant of its own"):
        TaskVectorEnv(replace(task, plant=lambda x, p, u: x), 1)
    with pytest.raises(TaskError, match="no Clf"):
        TaskVectorEnv(replace(task, quantities=task.barriers), 1)


def test_a_trained_file_rides_in_the_same_evaluation_and_its_recording_replays(cart: Path, tmp_path: Path) -> None:
    out = tmp_path / "cart.safetensors"
    said = CliRunner().invoke(rival, ["task", str(cart), "--out", str(out), "--ticks", "5000"])
    assert said.exit_code == 0, said.output
    names = f"nominal,ppo:{out}"
    words = ["evaluate", "--task", str(cart), "--controller", names, "--rides", "2", "--out", str(tmp_path / "e")]
    said = CliRunner().invoke(rabbit, words)
    assert said.exit_code == 0, said.output
    assert f"ppo:{out}" in json.loads((tmp_path / "e" / "summary.json").read_text())
    task = load_task(str(cart))
    controller = TaskController(task)
    ride = ride_of(controller, controller.controlling(f"ppo:{out}"), 3)
    assert max(abs(m.u[0]) for m in ride.moments) <= 20.0
    write_ride(ride, tmp_path / "bag", None)
    (checked,) = check_episodes(tmp_path / "bag", task)
    assert (checked.replayed, checked.differing) == (len(ride.moments), [])
    with pytest.raises(TaskError, match="trained for cart; this task is other"):
        TaskController(replace(task, name="other")).controlling(f"ppo:{out}")
    for name in ("nosuch:x", "ppo:nosuch"):
        with pytest.raises(TaskError, match="nosuch"):
            controller.controlling(name)
    assert task_policy.read(out, task_policy.TaskAbout).about.ticks >= 5000

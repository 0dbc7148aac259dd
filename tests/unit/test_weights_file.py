"""The policy file: what is read back, and what is refused with which word."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rabbit_description.gait import load_gaits
from rabbit_description.task_source import load_task
from rabbit_experiments.assembly import resolve_policy
from rabbit_rivals import model_file
from rabbit_rivals.gp_controller import GpAbout
from rl_cbf_clf_controller.controller_output import flat
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ActorPolicy, ZeroPolicy, estimate_function
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.uncertainty import PAPER, RL_CBF_CLF_QP, RL_CLF_QP, STEP_LENGTH
from rl_cbf_clf_controller.weights import (
    PROBE,
    SIZE_LIMIT,
    PolicyFile,
    PolicyFileError,
    decode,
    policy_path,
    read,
)
from rl_trainer.parameters import TrainingParameters
from safetensors.numpy import save
from untrained_policy import policy_file, policy_metadata


def make_file(problem: Problem = RL_CBF_CLF_QP, structured: bool = True, **changes: Any) -> PolicyFile:
    m, n = len(problem.observation), len(problem.quantities)
    values = {
        "observation_center": (0.1,) * m,
        "observation_scale": (2.0,) * m,
        "hidden": (8, 6),
        "structured": structured,
        "alpha_scale": tuple(range(1, n + 1)),
        "beta_scale": tuple(range(10, n + 10)),
        "plant": {"mass_scale": 2.0, "plant": "pybullet"},
        "episodes": 3,
        "transitions": 100,
        "commit": "0" * 40,
        "command": "rabbit train",
    }
    return policy_file(policy_metadata(problem, **values | changes), np.random.default_rng(0).standard_normal)


@pytest.mark.parametrize("problem", PAPER)
def test_bytes_come_back_as_they_went(problem: Problem) -> None:
    file = make_file(problem, structured=problem.has_clf)
    again = decode(file.encode())
    assert again.metadata.fits(problem)
    assert again.metadata == file.metadata
    assert again.version == file.version
    assert again.encode() == file.encode()
    assert all((again.arrays[name] == array).all() for name, array in file.arrays.items())


def test_file_is_the_message(tmp_path: Path) -> None:
    file = make_file()
    file.write(tmp_path / "deep" / "policy.safetensors")
    assert (tmp_path / "deep" / "policy.safetensors").read_bytes() == file.encode()
    assert read(tmp_path / "deep" / "policy.safetensors").version == file.version
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["policy.safetensors"]


def test_version_depends_on_weights_and_on_metadata() -> None:
    file = make_file()
    other_weights = {name: array + np.float32(name == "2.bias") for name, array in file.arrays.items()}
    assert PolicyFile(file.metadata, other_weights).version != file.version
    assert make_file(training_seed=2).version != file.version


def tampered(name: str, change: Any) -> bytes:
    """A file whose array is replaced without a word in the header."""
    file = make_file()
    head = {"content_hash": file.content_hash, "metadata": file.metadata.model_dump(mode="json")}
    arrays = dict(file.arrays)
    arrays[name] = change(arrays[name])
    data: bytes = save(arrays, metadata={"rabbit_policy": json.dumps(head)})
    return data


@pytest.mark.parametrize(
    ("data", "word"),
    [
        (b"", "not a policy file"),
        (b"\xff" * 100, "not a policy file"),
        (save({"a": np.zeros(1, np.float32)}), "not a policy file"),
        (b"0" * (SIZE_LIMIT + 1), "at most"),
        (tampered("2.bias", lambda a: a + np.float32(1)), "content hash"),
        (tampered("2.bias", lambda a: a[:-1]), "2.bias"),
        (tampered("0.weight", lambda a: a * np.float32("nan")), "not finite"),
        (tampered("0.weight", lambda a: a.astype(np.float64)), "float64"),
    ],
)
def test_refused(data: bytes, word: str) -> None:
    with pytest.raises(PolicyFileError, match=word):
        decode(data)


def test_outputs_that_differ_from_those_stored_are_refused() -> None:
    file = make_file()
    arrays = file.arrays | {PROBE: file.arrays[PROBE] + np.float32(0.01)}
    with pytest.raises(PolicyFileError, match="fixed observations"):
        decode(PolicyFile(file.metadata, arrays).encode())


@pytest.mark.parametrize(
    "reads", [read, lambda path: model_file.read(path, GpAbout)], ids=["policy", "model of a study"]
)
@pytest.mark.parametrize("header", [b'{"__metadata__":null}', b'{"__metadata__":{}}', b"{}"])
def test_a_header_alone_is_refused(header: bytes, reads: Callable[[Path], Any], tmp_path: Path) -> None:
    """Which `safetensors` takes for a sound file of no arrays."""
    (tmp_path / "file").write_bytes(len(header).to_bytes(8, "little") + header)
    with pytest.raises(PolicyFileError):
        reads(tmp_path / "file")


@pytest.mark.parametrize("name", ["a" * 300, f"{'a' * 300}.yaml", f"{'a' * 300}.py", "a/" * 3000, "\0"])
@pytest.mark.parametrize(
    "reads",
    [
        lambda name: read(policy_path(name)),
        lambda name: resolve_policy(name, ControllerParameters()),
        load_gaits,
        load_task,
    ],
)
def test_what_no_file_can_be_called_is_refused(reads: Callable[[str], Any], name: str) -> None:
    with pytest.raises(ValueError, match=r"expected|no such|No such|cannot read|no file"):
        reads(name)


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(PolicyFileError, match=r"none\.safetensors"):
        read(tmp_path / "none.safetensors")


@pytest.mark.parametrize(
    "changes",
    [
        {"observation": ("y1",)},
        {"observation_scale": (0.0,) * 15},
        {"observation_center": (0.0,) * 14},
        {"alpha_scale": (1.0,)},
        {"hidden": (0, 6)},
        {"format_version": 2},
        {"something": 1},
    ],
)
def test_metadata_that_does_not_fit(changes: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(changes))):
        make_file(**changes)


def test_structured_row_is_LgV_times_the_matrix() -> None:
    rng = np.random.default_rng(1)
    D2, D1, LgV, others = rng.standard_normal((4, 4)), rng.standard_normal(4), rng.standard_normal(4), np.arange(20.0)
    outputs, scales = np.concatenate([np.column_stack([D2, D1]).ravel(), others]), (np.full(5, 2.0), np.full(5, 3.0))
    estimates = estimate_function(5, 4, structured=True, has_clf=True)(outputs, LgV, *scales)
    np.testing.assert_allclose(estimates.alpha[0], 2 * LgV @ D2)
    np.testing.assert_allclose(estimates.beta[0], 3 * LgV @ D1)
    np.testing.assert_array_equal(estimates.alpha[1:].ravel(), 2 * others[:16])
    np.testing.assert_array_equal(estimates.beta[1:], 3 * others[16:])
    np.testing.assert_allclose(estimates.output_error, np.column_stack([2 * D2, 3 * D1]))


def test_structured_clf_vanishes_with_LgV() -> None:
    estimates = ActorPolicy(make_file()).act(np.ones(15), np.zeros(4))
    assert not estimates.alpha[0].any()
    assert estimates.beta[0] == 0


def test_outputs_stay_within_the_scales() -> None:
    policy = ActorPolicy(make_file(structured=False))
    LgV = np.array([3.0, 0.0, 4.0, 0.0])
    estimates = policy.act(1e3 * np.ones(15), LgV)
    assert (np.abs(estimates.alpha) <= np.array([6.0, 2, 3, 4, 5])[:, None]).all()
    assert (np.abs(estimates.beta) <= np.array([60.0, 11, 12, 13, 14])).all()


def test_a_network_without_l_min_reads_the_first_fourteen() -> None:
    observation = RL_CLF_QP.observation
    units = {"observation": observation, "observation_center": (0.1,) * 14, "observation_scale": (2.0,) * 14}
    policy = ActorPolicy(make_file(**units))
    LgV = np.ones(4)
    with_stone = policy.act(np.append(np.linspace(-1, 1, 14), 0.35), LgV)
    without = policy.act(np.linspace(-1, 1, 14), LgV)
    np.testing.assert_array_equal(flat(with_stone), flat(without))


def test_a_network_that_reads_the_step_length_needs_a_library() -> None:
    observation = (*RL_CBF_CLF_QP.observation, STEP_LENGTH)
    units = {"observation": observation, "observation_center": (0.1,) * 16, "observation_scale": (2.0,) * 16}
    policy = ActorPolicy(make_file(**units))
    assert policy.act(np.linspace(-1, 1, 16), np.ones(4)).alpha.shape == (5, 4)
    with pytest.raises(ValueError, match="reads step_length: expected a gait library"):
        policy.act(np.linspace(-1, 1, 15), np.ones(4))


def test_no_network_reads_the_step_length_without_the_stone() -> None:
    observation = (*RL_CLF_QP.observation, STEP_LENGTH)
    units = {"observation": observation, "observation_center": (0.1,) * 15, "observation_scale": (2.0,) * 15}
    with pytest.raises(ValueError, match="observation = "):
        make_file(**units)
    with pytest.raises(ValueError, match="observe_step_length = True"):
        TrainingParameters(observe_step_length=True, observe_l_min=False)
    assert TrainingParameters(observe_step_length=True).observation[-2:] == ("l_min", STEP_LENGTH)


@pytest.mark.parametrize("problem", PAPER)
def test_zero_policy_corrects_nothing(problem: Problem) -> None:
    estimates = ZeroPolicy(problem).act(np.ones(len(problem.observation)), np.ones(4))
    assert not estimates.error(np.ones(4)).any()

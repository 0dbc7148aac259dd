"""The policy file: what is read back, and what is refused with which word."""

from typing import Any

import numpy as np
import pytest
from rl_cbf_clf_controller.policy import ActorPolicy, estimate_function
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.uncertainty import PAPER, RL_CBF_CLF_QP
from rl_cbf_clf_controller.weights import PROBE, PolicyFile, PolicyFileError, decode
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


def test_outputs_that_differ_from_those_stored_are_refused() -> None:
    file = make_file()
    arrays = file.arrays | {PROBE: file.arrays[PROBE] + np.float32(0.01)}
    with pytest.raises(PolicyFileError, match="fixed observations"):
        decode(PolicyFile(file.metadata, arrays).encode())


@pytest.mark.parametrize(
    "changes", [{"observation": ("y1",)}, {"observation_center": (0.0,) * 14}, {"hidden": (0, 6)}, {"something": 1}]
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


def test_outputs_stay_within_the_scales() -> None:
    policy = ActorPolicy(make_file(structured=False))
    LgV = np.array([3.0, 0.0, 4.0, 0.0])
    estimates = policy.act(1e3 * np.ones(15), LgV)
    assert (np.abs(estimates.alpha) <= np.array([6.0, 2, 3, 4, 5])[:, None]).all()
    assert (np.abs(estimates.beta) <= np.array([60.0, 11, 12, 13, 14])).all()

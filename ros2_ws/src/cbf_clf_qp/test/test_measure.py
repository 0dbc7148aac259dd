"""A quantity is measured from two scenes and no model: exactly, where the acceleration is constant."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cbf_clf_qp.clf import Clf
from cbf_clf_qp.ecbf import Barriers, Ecbf
from cbf_clf_qp.res_clf import ResClf
from cbf_clf_qp.tick import measured

SECONDS = 0.01


def scene(y: Any, dy: Any) -> Any:
    """Outputs and a barrier on their sum."""
    eta = np.concatenate([y, dy])
    return SimpleNamespace(outputs=SimpleNamespace(eta=eta))


class Sum(Ecbf):
    """B = 3 - sum(y)."""

    names = ("sum",)

    def barriers(self, scene: Any) -> Barriers:
        y, dy = np.split(scene.outputs.eta, 2)
        return Barriers(np.array([3 - y.sum()]), np.array([-dy.sum()]), -np.ones((1, len(y))), np.zeros(1))


@pytest.mark.parametrize("outputs", [1, 2, 4])
def test_constant_acceleration_is_measured_exactly(outputs: int) -> None:
    rng = np.random.default_rng(outputs)
    y, dy, acceleration = rng.standard_normal((3, outputs))
    before = scene(y, dy)
    after = scene(y + SECONDS * dy + SECONDS**2 / 2 * acceleration, dy + SECONDS * acceleration)
    clf = ResClf(outputs, 0.1, (0.5, 0.866))
    found = measured((Clf(clf, 10.0), Sum((1.0, 2.0), 10.0)), before, after, SECONDS)
    expected = [clf.derivative(before.outputs.eta)(acceleration)[0], -acceleration.sum()]
    np.testing.assert_allclose(found, expected, rtol=1e-9)

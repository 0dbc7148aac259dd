"""Input-output linearisation: an identity."""

import numpy as np
import pytest
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.io_linearization import precontrol


def test_the_outputs_accelerate_by_mu() -> None:
    rng = np.random.default_rng(0)
    output_dynamics, mu = Affine(rng.normal(size=(4, 4)), rng.normal(size=4)), rng.normal(size=4)
    assert output_dynamics(precontrol(output_dynamics)(mu)) == pytest.approx(mu)

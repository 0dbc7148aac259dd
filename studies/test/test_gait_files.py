"""Gait files: every shipped one walks as it says; a bad one is refused with a word about what is wrong."""

import numpy as np
import pytest
from rabbit_description import GAITS, LIBRARIES
from rabbit_description.gait import Gait, GaitError, load_gait, load_gaits, shipped
from rabbit_gait_design import GaitSpecification
from rabbit_gait_design.orbit import Orbit

DESIGNED = [name for name in shipped(GAITS) if "specification" in load_gait(name).metadata]
OF_LIBRARIES = [
    pytest.param(gait, marks=pytest.mark.thorough, id=gait.name)
    for name in shipped(LIBRARIES)
    for gait in load_gaits(name).gaits  # type: ignore[union-attr]
]


@pytest.mark.parametrize("name", shipped(GAITS))
def test_shipped_gait_starts_near_its_own_curve(name: str) -> None:
    """The first author's start is a state of his closed loop, some 0.02 rad beside his curves; ours lie on them."""
    gait, tolerance = load_gait(name), 1e-6 if name in DESIGNED else 0.03
    q, dq = gait.x_start
    assert gait.name == name
    assert q[2] + q[3] + q[4] / 2 == pytest.approx(gait.phase_angle_start, abs=tolerance)
    assert q[3:] == pytest.approx(gait.coeffs[:, 0], abs=tolerance)
    assert np.isfinite(dq).all()


@pytest.mark.parametrize("gait", [*map(load_gait, DESIGNED), *OF_LIBRARIES], ids=lambda gait: gait.name)
def test_shipped_gait_keeps_its_specification_and_its_figures(gait: Gait) -> None:
    spec, orbit = GaitSpecification(**gait.metadata["specification"]), Orbit(gait)
    figures = orbit.figures()
    assert figures.closure_error < 2e-4
    assert figures.speed == pytest.approx(spec.speed, rel=1e-3)
    assert figures.friction_used <= 1.02 * spec.friction_limit
    assert figures.least_normal_force >= 0.97 * spec.min_normal_force
    assert figures.peak_torque <= 1.02 * spec.torque_limit
    assert figures.least_phase_rate < figures.start_phase_rate
    for key, value in gait.metadata["figures"].items():
        assert getattr(figures, key) == pytest.approx(value, rel=1e-3, abs=2e-4), key


def test_no_such_gait_names_those_that_exist() -> None:
    with pytest.raises(GaitError, match=DESIGNED[0]):
        load_gait("moonwalk")

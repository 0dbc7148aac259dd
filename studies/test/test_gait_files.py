"""Gait files: every shipped one walks as it says; a bad one is refused with a word about what is wrong."""

import math
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rabbit_description import GAITS
from rabbit_description.gait import Gait, GaitError, load_gait, shipped
from rabbit_gait_design import GaitSpecification
from rabbit_gait_design.orbit import Orbit

DESIGNED = [name for name in shipped(GAITS) if "specification" in load_gait(name).metadata]
CONTENT = yaml.safe_load((GAITS / f"{DESIGNED[0]}.yaml").read_text(encoding="utf-8"))
NUMBERS = ("step_length", "step_time", "phase_angle_start", "phase_angle_end")


@pytest.mark.parametrize("name", shipped(GAITS))
def test_shipped_gait_starts_near_its_own_curve(name: str) -> None:
    """The first author's start is a state of his closed loop, some 0.02 rad beside his curves; ours lie on them."""
    gait, tolerance = load_gait(name), 1e-6 if name in DESIGNED else 0.03
    q, dq = gait.x_start
    assert gait.name == name
    assert q[2] + q[3] + q[4] / 2 == pytest.approx(gait.phase_angle_start, abs=tolerance)
    assert q[3:] == pytest.approx(gait.coeffs[:, 0], abs=tolerance)
    assert np.isfinite(dq).all()


@pytest.mark.parametrize("name", DESIGNED)
def test_shipped_gait_keeps_its_specification_and_its_figures(name: str) -> None:
    gait = load_gait(name)
    spec, orbit = GaitSpecification(**gait.metadata["specification"]), Orbit(gait)
    figures = orbit.figures()
    assert figures.closure_error < 2e-4
    assert figures.speed == pytest.approx(spec.speed, rel=1e-3)
    assert figures.friction_used <= 1.02 * spec.friction_limit
    assert figures.least_normal_force >= 0.97 * spec.min_normal_force
    assert figures.peak_torque <= 1.02 * spec.torque_limit
    for key, value in gait.metadata["figures"].items():
        assert getattr(figures, key) == pytest.approx(value, rel=1e-3, abs=2e-4), key


def refused(content: Any, tmp_path: Path) -> str:
    path = tmp_path / "bad.yaml"
    path.write_text(yaml.safe_dump(content) if not isinstance(content, str) else content, encoding="utf-8")
    with pytest.raises(GaitError, match=r"bad\.yaml") as caught:
        load_gait(path)
    return str(caught.value)


@pytest.mark.parametrize("field", [*NUMBERS, "bezier_coeffs", "q_start", "dq_start", "name"])
def test_missing_field(field: str, tmp_path: Path) -> None:
    assert field in refused({key: value for key, value in CONTENT.items() if key != field}, tmp_path)


@pytest.mark.parametrize("text", ["", "just text", "[1, 2]", "name: [unclosed", "{a: 1}"])
def test_not_a_gait(text: str, tmp_path: Path) -> None:
    refused(text, tmp_path)


def test_phase_must_grow(tmp_path: Path) -> None:
    message = refused({**CONTENT, "phase_angle_end": CONTENT["phase_angle_start"]}, tmp_path)
    assert "phase_angle_end" in message


def test_no_such_gait_names_those_that_exist() -> None:
    with pytest.raises(GaitError, match=DESIGNED[0]):
        load_gait("moonwalk")


@given(field=st.sampled_from(NUMBERS), value=st.sampled_from([math.nan, math.inf, -math.inf, "x", None, [], {}]))
@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_numbers_must_be_finite_numbers(field: str, value: Any, tmp_path: Path) -> None:
    assert field in refused({**CONTENT, field: value}, tmp_path)


@given(
    field=st.sampled_from(["bezier_coeffs", "q_start", "dq_start"]),
    junk=st.one_of(
        st.lists(st.floats(allow_nan=True), max_size=10).filter(lambda row: len(row) != 7),
        st.lists(st.lists(st.floats(), max_size=5), min_size=1, max_size=5),
        st.text(max_size=5),
    ),
)
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_arrays_must_have_their_shape(field: str, junk: Any, tmp_path: Path) -> None:
    assert field in refused({**CONTENT, field: junk}, tmp_path)


@given(junk=st.binary(max_size=200))
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_arbitrary_bytes_are_refused_or_a_gait(junk: Any, tmp_path: Path) -> None:
    path = tmp_path / "junk.yaml"
    path.write_bytes(junk)
    with suppress(GaitError):
        assert isinstance(load_gait(path), Gait)

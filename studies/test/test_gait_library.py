"""Gait libraries: what lies between two gaits; the model of the speed from step to step."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp.functions import NumpyFunction, packed
from hypothesis import given
from hypothesis import strategies as st
from rabbit_description.gait import GaitLibrary, load_gaits
from rabbit_experiments.assembly import AssemblyError
from rabbit_experiments.cache import Cache
from rabbit_gait_design.library import GaitSearch, design_library, outwards
from rabbit_gait_design.specification import GaitSpecification
from rabbit_gait_design.speed_model.fit import errors, fitted, without_mean
from rabbit_gait_design.speed_model.walks import Steps, exploring_walks
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.step_paths import GaitExpressions, Shape, gait_row
from rl_cbf_clf_controller.virtual_constraints import StepPath

LIBRARY = load_gaits("wide")
assert isinstance(LIBRARY, GaitLibrary)
LENGTHS = st.floats(LIBRARY.lengths[0], LIBRARY.lengths[-1])


class Paths:
    """Paths of a library from a step of `taken` into one of `wanted`, m."""

    def __init__(self, library: GaitLibrary) -> None:
        gaits, self._numbers = GaitExpressions(Shape.of(library)), gait_row(library)
        of = {name: ca.SX.sym(name) for name in ("taken", "wanted")}
        path = gaits.path(of["taken"], of["wanted"], ca.SX(0))
        found = {"coeffs": path.coeffs, "ends": ca.vertcat(path.start, path.end)}
        self._function = NumpyFunction.of("paths", of | {"gaits": packed(gaits.symbols)}, found)

    def __call__(self, taken: float, wanted: float) -> StepPath:
        found = self._function(np.array([taken]), np.array([wanted]), self._numbers)
        return StepPath(found.coeffs, *found.ends)


PATHS = Paths(LIBRARY)


@given(index=st.integers(0, len(LIBRARY.gaits) - 2), share=st.sampled_from([0.0, 1.0]) | st.floats(0, 1))
def test_between_two_gaits_all_is_linear(index: int, share: float) -> None:
    """At its own lengths it has its own gaits."""
    left, right = LIBRARY.gaits[index : index + 2]
    length = (1 - share) * left.step_length + share * right.step_length
    path = PATHS(length, length)
    start = (1 - share) * left.phase_angle_start + share * right.phase_angle_start
    assert path.phase_angle_start == pytest.approx(start, abs=1e-12)
    np.testing.assert_allclose(path.coeffs, (1 - share) * left.coeffs + share * right.coeffs, atol=1e-12)
    ends = (1 - share) * left.phase_angle_end + share * right.phase_angle_end
    assert path.phase_angle_end == pytest.approx(ends, abs=1e-12)


@given(taken=LENGTHS, wanted=LENGTHS)
def test_a_step_begins_as_one_gait_and_ends_as_the_other(taken: float, wanted: float) -> None:
    """Value, slope and curvature of a Bézier curve at an end are those of the three control points there."""
    path, first, last = PATHS(taken, wanted), PATHS(taken, taken), PATHS(wanted, wanted)
    assert path.phase_angle_start == first.phase_angle_start
    assert path.phase_angle_end == pytest.approx(last.phase_angle_end, abs=1e-12)
    for order in range(3):
        begins = (np.diff(curve.coeffs, order)[:, 0] for curve in (path, first))
        ends = (np.diff(curve.coeffs, order)[:, -1] for curve in (path, last))
        np.testing.assert_allclose(*begins, atol=1e-12)
        np.testing.assert_allclose(*ends, atol=1e-12)


SIZES = st.tuples(st.integers(1, 5), st.integers(1, 5))


@given(size=SIZES, data=st.data())
def test_a_library_is_searched_outwards_each_gait_from_one_beside_it(
    size: tuple[int, int], data: st.DataObject
) -> None:
    """Along the first row, then away from it; each place once, after its neighbour."""
    first = data.draw(st.tuples(*(st.integers(0, most - 1) for most in size)))
    start, *rings = outwards(first, size)
    seen = [place for place, _ in start]
    assert seen == [first]
    for ring in rings:
        for place, neighbour in ring:
            assert neighbour in seen
            assert np.abs(np.subtract(place, neighbour)).sum() == 1
            assert place[0] == first[0] or neighbour[1] == place[1]
        seen += [place for place, _ in ring]
    assert sorted(seen) == [*np.ndindex(size)]


@pytest.mark.slow
def test_a_library_goes_on_from_the_gaits_that_are_found_and_is_the_same_over_processes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    base, lengths = GaitSpecification(name="few", intervals=6), (0.34, 0.35, 0.36)
    together = design_library(base, lengths, 0.1, (), Cache(tmp_path / "two"), 2)
    design_library(base, lengths[:2], 0.1, (), Cache(tmp_path / "one"))
    searched, search = list[str](), GaitSearch.do
    monkeypatch.setattr(GaitSearch, "do", lambda job: searched.append(job.specification.name) or search(job))
    assert design_library(base, lengths, 0.1, (), Cache(tmp_path / "one")) == together
    assert searched == ["few_0360"]


TRUTH = np.array([0.6, -0.05, 0.15, -0.03])


def linear_walk(rng: np.random.Generator, constant: float, noise: float, seeming: float, steps: int = 40) -> Steps:
    """Speeds that follow the model but for the noise, and are seen with an error of `seeming`, both m/s."""
    slopes = rng.uniform(-3, 3, steps)
    speeds = [0.0, 0.0, 0.0]
    for k in range(3, steps):
        regressors = np.array([speeds[-1], slopes[k], slopes[k - 1], slopes[k - 2]])
        speeds.append(float(TRUTH @ regressors + constant + noise * rng.standard_normal()))
    seen = np.array(speeds) + seeming * rng.standard_normal(steps)
    return Steps(slopes=slopes.tolist(), speeds=seen.tolist())


def linear_plants(noise: float, seed: int, plants: int = 40, seeming: float = 0.0) -> list[list[Steps]]:
    rng = np.random.default_rng(seed)
    constants = rng.uniform(-0.3, 0.3, plants)
    return [[linear_walk(rng, constant, noise, seeming) for _ in range(4)] for constant in constants]


def test_without_noise_the_coefficients_are_found_exactly() -> None:
    model = fitted(linear_plants(0.0, 1))
    np.testing.assert_allclose(model.coefficients, TRUTH, atol=1e-9)
    assert errors(TRUTH, linear_plants(0.0, 2))[0] == pytest.approx(0.0, abs=1e-9)


def test_with_noise_the_intervals_hold_the_truth_about_as_often_as_they_say() -> None:
    """Of 4 x 25 intervals of 95% some 95; fewer than 85 would be 4.6 standard deviations away."""
    models = [fitted(linear_plants(0.03, seed, seeming=0.05)) for seed in range(25)]
    held = [np.abs(model.coefficients - TRUTH) < model.half_widths for model in models]
    assert np.sum(held) >= 85
    error, spread = errors(TRUTH, linear_plants(0.03, 99))
    assert error == pytest.approx(0.03, rel=0.05)
    assert error < spread


def test_errors_of_the_speeds_do_not_bias_what_is_found() -> None:
    """As large as the noise, they take least squares' A down from 0.6; the instruments know nothing of them."""
    plants = linear_plants(0.05, 3, plants=200, seeming=0.05)
    x, y, _ = (np.concatenate(column) for column in zip(*without_mean(plants), strict=True))
    assert np.linalg.lstsq(x, y, rcond=None)[0][0] < 0.5
    np.testing.assert_allclose(fitted(plants).coefficients, TRUTH, atol=0.03)


def test_a_walk_explores_and_a_gait_without_slopes_is_refused() -> None:
    tuning = load_parameters("best")
    walks = exploring_walks(2, 5, tuning)
    assert [of_plant[0].assembly.simulation.terrain for of_plant in walks] == ["flat", "stones"]
    assert {walk.assembly.simulation.push for of_plant in walks for walk in of_plant} == {0.0}
    steps = walks[0][0].do()
    assert len(steps.slopes) == len(steps.speeds) >= 1
    assert walks[0][0].do() == steps, "the same seed, the same walk"
    with pytest.raises(AssemblyError, match="expected a library with slopes"):
        exploring_walks(1, 5, tuning.model_copy(update={"gait": "stones_0350_080"}))[0][0].do()

"""A traced function says what the function says, or the function is asked."""

from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np
import pytest
from cbf_clf_qp import tracing
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.objective import pd_centred
from cbf_clf_qp.qp import build_qp
from cbf_clf_qp.rows import Rows
from cbf_clf_qp.symbols import at_least
from cbf_clf_qp.tracing import Traced

pytest.importorskip("casadi")
RNG = np.random.default_rng(0)


@pytest.fixture(autouse=True)
def _this_module_is_trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracing, "TRUSTED", {*tracing.TRUSTED, __name__.partition(".")[0]})


@dataclass(frozen=True)
class Body:
    """A state with parts of all kinds."""

    position: np.ndarray
    mass: float
    number: int
    name: str = "body"
    parent: Any = None


def body(**changes: Any) -> Body:
    return replace(Body(RNG.normal(size=3), float(RNG.uniform(1, 2)), int(RNG.integers(5))), **changes)


def moved(each: Body, force: np.ndarray) -> tuple[np.ndarray, ...]:
    """Elementwise, products of matrices, slices, constants, numbers."""
    grown = np.outer(each.position, force)
    return (
        np.sqrt(each.position**2 + 1) / each.mass - force * each.number,
        grown @ np.eye(3)[:, :2] + np.array([1.0, -np.inf]),
        np.concatenate([grown[0], np.array([each.mass, each.position @ force]), [np.hypot(force[0], 1.0)]]),
        np.full(2, 7.0),
    )


def test_results_are_the_functions():
    traced = Traced(moved)
    for _ in range(20):
        arguments = body(), RNG.normal(size=3)
        for found, expected in zip(traced(*arguments), moved(*arguments), strict=True):
            np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13)
    assert traced.reason == ""


def test_results_stay_when_the_function_is_called_again():
    traced = Traced(lambda x: [2 * x])
    traced(np.ones(2))
    (first,), (second,) = traced(np.ones(2)), traced(np.zeros(2))
    assert (first.tolist(), second.tolist()) == ([2, 2], [0, 0])


def test_a_twin_has_the_trace_and_its_own_memory():
    calls = []
    traced = Traced(lambda x: (calls.append(1), [2 * x])[1])
    traced(np.ones(2))
    twin = traced.twin()
    assert twin(np.ones(2))[0].tolist() == [2, 2]
    before = len(calls)
    assert twin(np.full(2, 4.0))[0].tolist() == [8, 8]
    assert len(calls) == before


def branching(x: np.ndarray) -> list[np.ndarray]:
    return [x if x[0] > 0 else -x]


def as_number(x: np.ndarray) -> list[np.ndarray]:
    return [np.array([float(x[0])])]


def with_memory(x: np.ndarray) -> list[Any]:
    return [2 * x, object()]


@pytest.mark.parametrize("function", [branching, as_number, with_memory])
def test_what_cannot_be_traced_is_computed_as_before(function):
    traced = Traced(function)
    for x in (np.array([1.0, 2.0]), np.array([-3.0, 1.0])):
        np.testing.assert_array_equal(traced(x)[0], function(x)[0])
    assert traced.reason


def test_a_result_that_cancels_is_traced():
    """0 but for rounding, which the trace need not repeat."""

    def cancelling(x: np.ndarray) -> list[np.ndarray]:
        return [x, np.array([(x @ x - x[0] * x[0]) - x[1] * x[1]])]

    traced = Traced(cancelling)
    for x in RNG.normal(size=(50, 2)) * 1e3:
        traced(x)
    assert traced.reason == ""


def test_a_class_that_says_nothing_of_its_parts_cannot_be_traced():
    class Hidden:
        value = np.ones(2)

    traced = Traced(lambda hidden: [2 * hidden.value])
    assert traced(Hidden())[0].tolist() == [2, 2]
    assert "Hidden" in traced.reason


class Side(Enum):
    """Of a body."""

    NEAR = 1
    FAR = 2


@pytest.mark.parametrize(
    "change",
    [{"name": "other"}, {"parent": Side.FAR}, {"parent": None}, {"position": None}, {"mass": None}],
)
def test_other_arguments_than_those_traced_go_to_the_function(change):
    def described(each: Body) -> list[np.ndarray]:
        mass = 0.0 if each.mass is None else each.mass
        named = len(each.name) + (each.parent is Side.FAR) + 10 * (each.parent is None)
        return [np.array([mass + named]) if each.position is None else each.position + mass + named]

    traced = Traced(described)
    first = body(parent=Side.NEAR)
    traced(first)
    changed = replace(first, **change)
    np.testing.assert_array_equal(traced(changed)[0], described(changed)[0])
    assert traced.reason == ""


def test_the_digits_do_not_depend_on_what_was_computed_before():
    """One that met other structures first gives the same, bit for bit."""

    def weighted(each: Body, *offsets: float) -> list[np.ndarray]:
        size = 1.0 if each.parent is None else 3.0
        return [np.sqrt(each.position**2 / (size + each.mass)) * each.mass / 3.0 + sum(offsets)]

    fresh, met_others = Traced(weighted), Traced(weighted)
    for first in ((body(parent="it"),), (body(), 1.0), (body(parent="it"), 1.0, 2.0)):
        met_others(*first)
    for _ in range(20):
        each = body()
        assert fresh(each)[0].tolist() == met_others(each)[0].tolist()
        np.testing.assert_allclose(met_others(each, 2.0)[0], weighted(each, 2.0)[0], rtol=1e-14)
    assert fresh.reason == met_others.reason == ""


def test_an_error_of_the_function_is_raised_at_every_call():
    def refusing(each: Body) -> list[np.ndarray]:
        if each.parent is None:
            raise ValueError("expected a parent")
        return [each.position]

    traced = Traced(refusing)
    for _ in range(2):
        with pytest.raises(ValueError, match="expected a parent"):
            traced(body())
    assert traced(body(parent="it"))[0].shape == (3,)


def halves(x: np.ndarray, of: Body) -> list[Any]:
    return [Body(x / 2, x[0] + 1, of.number, parent=of), Affine(np.outer(x, x), x - 1), "word"]


def joined(first: Body, second: Affine, scale: float) -> list[np.ndarray]:
    return [scale * second(first.position) * first.mass + first.number, first.parent.position + second.b]


def test_results_are_made_of_arrays_numbers_and_parts_of_the_arguments():
    traced, given = Traced(halves), body()
    for x in RNG.normal(size=(5, 3)):
        first, second, word = traced(x, given)
        assert first.position.tolist() == (x / 2).tolist()
        assert (first.mass, first.number, word) == (x[0] + 1, given.number, "word")
        assert first.parent is given
        assert isinstance(first.mass, float)
        np.testing.assert_allclose(second.a, np.outer(x, x), rtol=1e-15)
    assert traced.reason == ""


def test_results_of_a_trace_go_into_another_whole_changed_or_mixed():
    makes, takes, given = Traced(halves), Traced(joined), body()
    before = makes(RNG.normal(size=3), given)
    for x in RNG.normal(size=(5, 3)):
        first, second, _ = makes(x, given)
        for pair in (
            (first, second),
            (replace(first, position=np.ones(3)), second),
            (first, before[1]),
            (before[0], Affine(second.a, second.b)),
        ):
            for found, expected in zip(takes(*pair, 2.0), joined(*pair, 2.0), strict=True):
                np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13)
    assert makes.reason == takes.reason == ""


def test_a_programme_is_traced_with_inverse_and_root():
    """Rows hard and soft, in both units, and an objective with a root."""

    def programme(a: np.ndarray, error: Affine) -> list[Any]:
        rows = [
            Rows.at_most(("soft",), a[:1], np.ones(1), 5.0).normalised(),
            Rows.at_least(("raw",), a[1:2], np.zeros(1), 100.0),
            Rows.between(("u1", "u2"), a[2:], -np.ones(2), np.ones(2)),
        ]
        qp = build_qp(rows, pd_centred(np.array([1.0, -2.0]), error, 0.1))
        return [qp.q, qp.A, qp.lower, qp.upper, qp.layout, qp.unroot]

    traced = Traced(programme)
    for _ in range(5):
        arguments = RNG.normal(size=(4, 2)), Affine(0.1 * RNG.normal(size=(2, 2)), RNG.normal(size=2))
        for found, expected in zip(traced(*arguments), programme(*arguments), strict=True):
            if isinstance(expected, np.ndarray):
                np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11)
            else:
                assert found is expected
    assert traced.reason == ""


def test_a_number_that_is_asked_only_whether_it_is_there():
    def described(each: Body) -> list[np.ndarray]:
        return [each.position + (1.0 if each.mass is None else 2.0)]

    traced, first = Traced(described), body()
    for each in (first, replace(first, mass=None), first, replace(first, mass=True)):
        np.testing.assert_array_equal(traced(each)[0], described(each)[0])


def test_the_larger_of_nan_and_a_bound_is_nan():
    traced = Traced(lambda x: [at_least(x, 1.0)])
    for _ in range(2):
        assert traced(np.array([0.0, 2.0]))[0].tolist() == [1.0, 2.0]
        found = traced(np.array([np.nan, -np.inf]))[0]
        assert np.isnan(found[0])
        assert found[1] == 1.0
    assert traced.reason == ""

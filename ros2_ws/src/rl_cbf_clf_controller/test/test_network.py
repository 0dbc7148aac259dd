"""The actor's network, and N systems at once: the same bits in C and in numpy, alone and among others."""

import pickle
from itertools import pairwise
from math import tanh
from typing import Any

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp import compiled
from cbf_clf_qp.batch_functions import BatchFunction
from cbf_clf_qp.compiled import Library
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import NumpyFunction
from rl_cbf_clf_controller import network
from rl_cbf_clf_controller.network import SOURCE, Actor, CompiledNetwork, forward_of

SIZES = [(1, 1, 1, 1), (2, 3, 5, 1), (14, 8, 7, 2), (5, 33, 9, 3), (18, 400, 300, 25), (86, 400, 300, 4)]


def arrays(*sizes: int) -> dict[str, Any]:
    rng, found = np.random.default_rng(sizes), {}
    for i, (before, after) in enumerate(pairwise(sizes)):
        found[f"{i}.weight"] = (rng.normal(size=(after, before)) / np.sqrt(before)).astype(np.float32)
        found[f"{i}.bias"] = rng.normal(size=after).astype(np.float32)
        found[f"{i}.bias"][::3] = -0.0
    return found


def observations(n: int, size: int) -> Any:
    """Some of them zero, and some no numbers."""
    rng = np.random.default_rng(size)
    rows = rng.normal(size=(n, size)) * 10 ** rng.uniform(-3, 3, (n, 1))
    rows[rng.uniform(size=rows.shape) < 0.2] = 0.0
    rows[rng.uniform(size=rows.shape) < 0.1] = -0.0
    rows[0], rows[1, 0], rows[2, -1] = -0.0, np.nan, np.inf
    return rows


@pytest.fixture(params=["C", "numpy"])
def made(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """A network that is compiled, or cannot be."""
    if request.param == "numpy":
        monkeypatch.setenv(compiled.COMPILE, "0")
    else:
        monkeypatch.delenv(compiled.COMPILE, raising=False)
    monkeypatch.setattr(network, "NETWORK", CompiledNetwork())
    network.NETWORK.compile(wait=True)
    assert (network.NETWORK.forward is None) == (request.param == "numpy")


@pytest.mark.usefixtures("made")
def test_layers_by_hand() -> None:
    """max(x1 - x2, 0) and max(x2 - 1, 0), their sum minus 1/2, and -2 of it."""
    layers: dict[str, Any] = {"0.weight": [[1, -1], [0, 1]], "0.bias": [0, -1], "1.weight": [[1, 1]], "1.bias": [-0.5]}
    layers |= {"2.weight": [[-2]], "2.bias": [0]}
    actor = Actor({name: np.array(value, dtype=np.float32) for name, value in layers.items()})
    expected = {(3, 1): -3.0, (0, 0): 0.0, (0, 3): -3.0, (4, 2): -5.0}
    for x, before_tanh in expected.items():
        assert actor(np.array(x)).tolist() == [tanh(before_tanh)]
    assert actor(np.array([*expected])).tolist() == [[tanh(value)] for value in expected.values()]


@pytest.mark.usefixtures("made")
@pytest.mark.parametrize("sizes", SIZES)
def test_a_row_has_its_bits_among_others(sizes: tuple[int, ...]) -> None:
    actor, rows = Actor(arrays(*sizes)), observations(33, sizes[0])
    for n in (33, 3, 0):
        assert actor(rows[:n]).shape == (n, sizes[-1])
        for found, row in zip(actor(rows[:n]), rows, strict=False):
            np.testing.assert_array_equal(found, actor(row))
    np.testing.assert_array_equal(actor(np.asfortranarray(rows)), actor(rows))
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(actor))(rows), actor(rows))


@pytest.mark.usefixtures("made")
@pytest.mark.parametrize("sizes", SIZES)
def test_it_is_the_product_of_matrices(sizes: tuple[int, ...]) -> None:
    given, values = arrays(*sizes), observations(33, sizes[0])[3:]
    found = Actor(given)(values)
    for i in range(3):
        values = (np.maximum(values, 0) if i else values) @ given[f"{i}.weight"].T.astype(float) + given[f"{i}.bias"]
    assert found == pytest.approx(np.tanh(values), abs=1e-9)


@pytest.mark.parametrize("sizes", SIZES)
def test_c_and_numpy_have_the_same_bits(sizes: tuple[int, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the compiler does nothing to be faster, and on any processor."""
    monkeypatch.delenv(compiled.COMPILE, raising=False)
    actor, rows, found = Actor(arrays(*sizes)), observations(200, sizes[0]), []
    text = SOURCE.read_text()
    plain = text.replace('target_clones("avx512f", "avx2", "default")', "")
    assert plain != text
    for library in (None, Library(text, "-O1"), Library(text, "-O3"), Library(plain, "-O1"), Library(plain, "-O3")):
        chosen = CompiledNetwork()
        chosen._rest = np.inf
        chosen.forward = library and library.loaded(forward_of, wait=True)
        assert bool(chosen.forward) == bool(library)
        monkeypatch.setattr(network, "NETWORK", chosen)
        found.append(np.nan_to_num(actor(rows), nan=2.0))
    assert [answer.tobytes() for answer in found[1:]] == [found[0].tobytes()] * 4


def test_estimates_add_up_robot_by_robot() -> None:
    one = Estimates(np.ones((2, 3)), np.arange(2.0), np.ones((3, 4)))
    unknown = Estimates(np.zeros((2, 3)), np.zeros(2))
    both = Estimates.of_many([one, one]) + Estimates.of_many([one, Estimates.zero(2, 3)])
    assert both[0].beta == pytest.approx([0.0, 2.0])
    assert both[1].output_error == pytest.approx(np.ones((3, 4)))
    assert (both + Estimates.of_many([unknown, one])).output_error is None


def test_any_number_of_calls_has_the_bits_of_each_alone() -> None:
    """Every kind of operation, constants as outputs, inputs that are left out, and no trace of the call before."""
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y")
    found = {"a": ca.vertcat(ca.sin(x[0]) / x[1], ca.exp(-(x[2] ** 2)), x[0] ** 3, 2 * x[1], ca.tanh(x[2]) + y)}
    found |= {"b": ca.vertcat(ca.fmax(x[0], y), ca.if_else(x[0] > x[1], x[2], -x[2]), ca.fabs(x[1]), 7, y)}
    found |= {"c": ca.vertcat(ca.logic_or(x[0] > 0, x[1] > 0), ca.sign(x[2]), ca.sqrt(ca.fabs(x[0])), 1 / x[1])}
    alone = NumpyFunction.of("f", {"x": x, "y": y}, found)
    at_once, rng = BatchFunction(alone), np.random.default_rng(0)
    for n in (1, 2, 3, 5, 8, 64, 7):
        xs, ys = rng.normal(size=(n, 3)), rng.normal(size=(n, 1))
        for given in ((xs, ys), (xs,)):
            rows = at_once(*given).row
            assert np.array_equal(rows, [alone(*call).row for call in zip(*given, strict=True)])

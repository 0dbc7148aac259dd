"""The actor's network, and N systems at once: the same bits in C and in numpy, alone and among others."""

import pickle
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from cbf_clf_qp import compiled
from cbf_clf_qp.compiled import Library
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

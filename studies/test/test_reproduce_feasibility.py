"""The linear programme against answers known beforehand."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rabbit_description.state import Array
from rabbit_reproduce.controllers import CBF_CLF, CBF_CLF_ORACLE, CLF, IO_RL
from rabbit_reproduce.feasibility import infeasible, measure

Rows = tuple[Array, Array, Array]  # A, lower, upper


def rows(seed: int, slack: Callable[[np.random.Generator], float]) -> Rows:
    """Twelve random rows, each `slack` beyond a random point."""
    rng = np.random.default_rng(seed)
    point, A = rng.uniform(-50, 50, 4), rng.standard_normal((12, 4)) * 10 ** rng.uniform(-3, 3, (12, 1))
    upper = A @ point + np.linalg.norm(A, axis=1) * slack(rng)
    return A, np.full(12, -np.inf), upper


@given(st.integers(0, 2**32 - 1))
def test_rows_that_a_point_meets_are_feasible(seed: int) -> None:
    assert not infeasible(*rows(seed, lambda rng: float(rng.uniform(0.01, 10))))


@given(st.integers(0, 2**32 - 1), st.floats(0.01, 100))
def test_two_half_spaces_that_do_not_meet_are_infeasible(seed: int, gap: float) -> None:
    """a mu <= c and a mu >= c + gap |a|, whatever else there is."""
    a = np.random.default_rng(seed).standard_normal((1, 4))
    A, lower, upper = rows(seed, lambda _: 1.0)
    lower, upper = np.append(lower, [-np.inf, gap * np.linalg.norm(a)]), np.append(upper, [0.0, np.inf])
    assert infeasible(np.vstack([A, a, a]), lower, upper)


def test_fewer_rows_are_not_less_feasible_and_all_judges_see_all_ticks() -> None:
    walker, oracle = CBF_CLF.assembly(stones=1), CBF_CLF_ORACLE.assembly(stones=1)
    found = measure(walker, (walker, walker, oracle), 1)
    assert found.outcome == "walked"
    assert found.safety[0] == found.safety[1]
    assert all(0 <= safety <= every <= found.ticks for safety, every in zip(found.safety, found.all, strict=True))
    assert found.safety[0] == found.safety[2]  # at scale 1 there is nothing to correct


def test_a_judge_whose_rows_are_not_in_mu_alone_is_refused() -> None:
    with pytest.raises(ValueError, match="io-rl-clf-qp: expected"):
        measure(CLF.assembly(stones=1), (IO_RL.assembly(stones=1),), 1)

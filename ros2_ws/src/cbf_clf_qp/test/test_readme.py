"""The README's example runs as it stands there, and what it says is so."""

import re
from pathlib import Path
from typing import Any

import pytest

README = Path(__file__).resolve().parents[1] / "README.md"
(EXAMPLE,) = re.findall(r"```python\n(.+?)```", README.read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture(scope="module")
def names() -> dict[str, Any]:
    """The example's names when it has ended."""
    found: dict[str, Any] = {"__name__": "readme"}
    exec(compile(EXAMPLE, str(README), "exec"), found)  # our own text
    return found


def test_by_the_model_alone_the_cart_hits_the_wall_and_as_it_learned_it_does_not(names: dict[str, Any]) -> None:
    """B-ddot = -(2 mu + WIND) / 3, and -mu by the model. The force is held for a tick."""
    assert names["nominal"] < -0.02
    assert names["learned"] > -1e-3
    assert (names["alpha"], names["beta"]) == pytest.approx((1 / 3, -2 / 3), rel=1e-6)


def test_a_rate_that_is_not_declared_costs_what_is_said(names: dict[str, Any]) -> None:
    tick, np, x, speed = names["tick"], names["np"], names["np"].zeros(2), names["SPEED"]
    for k in range(3000):  # a cart as its model
        acceleration = tick(x, wall=1.2 + speed * 1e-3 * k, speed=0.0).u[0] / names["NOMINAL"]
        x = x + 1e-3 * np.array([x[1] + 5e-4 * acceleration, acceleration])
    assert 1.2 + speed * 3 - x[0] == pytest.approx(-0.05, abs=1e-3)

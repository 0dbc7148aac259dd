"""A cart before a wall, half as heavy in its model; the fixture that writes its file."""

from pathlib import Path

import pytest

POLE, LIMIT = 4.0, 20.0  # 1/s, N
CART = """
import casadi as ca
from cbf_clf_qp import Barrier, Clf, System
from rabbit_description.task import ControlTask, Disc
x, v, u, mass, target = (ca.SX.sym(name) for name in ("x", "v", "u", "mass", "target"))
TASK = ControlTask(
    "cart", System(ca.vertcat(x, v), u, ca.vertcat(v, u / mass), parameters=[mass, target]),
    [Clf(x - target), Barrier("wall", 1 - x, poles=(4.0, 4.0))], limit=20.0,
    nominal={"mass": 1.0}, true={"mass": 2.0}, start=((-0.1, 0.0), (0.1, 0.0)),
    commands=lambda rng: lambda t: {"target": 1.2}, duration=3.0, tolerance=1e-3,
    coordinates=("x",), draw=lambda x, p: [Disc((x[0], p["target"]), 0.1)],
)
"""


@pytest.fixture
def cart(tmp_path: Path) -> Path:
    """The task's file."""
    path = tmp_path / "cart.py"
    path.write_text(CART)
    return path

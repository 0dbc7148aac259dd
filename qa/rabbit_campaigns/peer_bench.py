"""A call over cbfpy's, on two of its published examples: calls in turn, the fastest of each.

pip install --no-deps 'cbfpy==0.1.0' elastiqp qpax jax jaxlib ml_dtypes opt_einsum
"""

import importlib
import os
import sys
import time
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest.mock import patch

import cbf_clf_qp
import numpy as np

TESTS = Path(cbf_clf_qp.__file__).resolve().parents[1] / "test"
ENVIRONMENT = {"XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false", "JAX_ENABLE_X64": "True", "JAX_PLATFORMS": "cpu"}
ROUNDS, CALLS = 300, 50


def cbfpy_ratios() -> dict[str, float]:
    """Ratios for cruise control and the point robot; says so and gives none where cbfpy is not installed."""
    try:
        with patch.dict(os.environ, ENVIRONMENT), patch.object(sys, "path", [*sys.path, str(TESTS)]):
            calls = both()
    except ImportError as error:
        print(f"cbfpy_ratio: skipped, {error}")
        return {}
    figures = {}
    for name, pair in calls.items():
        theirs, ours = (np.asarray(call()) for call in pair)
        np.testing.assert_allclose(ours, theirs, rtol=1e-6)
        fastest = [np.inf, np.inf]
        for _ in range(ROUNDS):
            for i, call in enumerate(pair):
                start = time.perf_counter()
                for _ in range(CALLS):
                    call()
                fastest[i] = min(fastest[i], time.perf_counter() - start)
        figures[f"cbfpy_ratio.{name}"] = fastest[1] / fastest[0]
    return figures


def both() -> dict[str, tuple[Any, Any]]:
    """cbfpy's call and ours, of the same input."""
    for name, drawn in (("car_env", "VehicleEnv"), ("point_robot_envs", "PointRobotObstacleEnv")):
        module = sys.modules[f"cbfpy.envs.{name}"] = ModuleType(name)  # it draws, and needs pygame or pybullet for it
        setattr(module, drawn, None)
    cbfpy, jax, peers = map(importlib.import_module, ("cbfpy", "jax", "test_peers"))
    examples = "adaptive_cruise_control", "point_robot_obstacle"
    cars, balls = (importlib.import_module(f"cbfpy.examples.{name}_demo") for name in examples)
    clf_cbf, cbf = cbfpy.CLFCBF.from_config(cars.ACCConfig()), cbfpy.CBF.from_config(balls.PointRobotObstacleConfig())
    filtered = jax.jit(lambda z, goal, other: cbf.safety_filter(z, balls.nominal_controller(z, goal), other))
    z, point, goal = np.array(peers.CBFPY_CRUISE[5][:3]), np.array(peers.CBFPY_POINT[1]), np.zeros(6)
    x, robot, other = z[[0, 2]], point[:6], point[6:12]
    car, ball = peers.cruise(1.0, 5.0, "daqp"), peers.point_robot("daqp")
    car_p, ball_p = car.p(leader=z[1]), ball.p(obstacle=other[:3], speed=other[3:])
    return {
        "cruise_control": (lambda: np.asarray(clf_cbf.controller(z, z)), lambda: car.decide(x, car_p).u),
        "point_robot": (lambda: np.asarray(filtered(robot, goal, other)), lambda: ball.decide(robot, ball_p).u),
    }

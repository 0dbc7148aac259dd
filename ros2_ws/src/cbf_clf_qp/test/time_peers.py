"""Microseconds a call, here and in cbfpy, on two of its published examples: calls in turn, the fastest of each.

pip install 'cbfpy[elastiqp]==0.1.0' pytest ./ros2_ws/src/cbf_clf_qp
OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python ros2_ws/src/cbf_clf_qp/test/time_peers.py
"""

import importlib
import os
import sys
import time
from collections.abc import Callable
from types import ModuleType
from typing import Any

os.environ |= {"XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false", "JAX_ENABLE_X64": "True", "JAX_PLATFORMS": "cpu"}
import numpy as np
from test_peers import CBFPY_CRUISE, CBFPY_POINT, cruise, point_robot  # type: ignore[import-not-found]

for name, drawn in (("car_env", "VehicleEnv"), ("point_robot_envs", "PointRobotObstacleEnv")):
    module = sys.modules[f"cbfpy.envs.{name}"] = ModuleType(name)  # it draws, and needs pygame or pybullet for it
    setattr(module, drawn, None)
cbfpy, jax = importlib.import_module("cbfpy"), importlib.import_module("jax")
cars, balls = (
    importlib.import_module(f"cbfpy.examples.{name}_demo")
    for name in ("adaptive_cruise_control", "point_robot_obstacle")
)
clf_cbf, cbf = cbfpy.CLFCBF.from_config(cars.ACCConfig()), cbfpy.CBF.from_config(balls.PointRobotObstacleConfig())
filtered = jax.jit(lambda z, goal, other: cbf.safety_filter(z, balls.nominal_controller(z, goal), other))
z, point, goal = np.array(CBFPY_CRUISE[5][:3]), np.array(CBFPY_POINT[1]), np.zeros(6)
x, robot, other = z[[0, 2]], point[:6], point[6:12]
obstacle, speed = np.split(other, 2)
car, ball = cruise(1.0, 5.0, "daqp"), point_robot("daqp")
car_none, ball_none, car_p, ball_p = (
    car.no_error(),
    ball.no_error(),
    car.p(leader=z[1]),
    ball.p(obstacle=obstacle, speed=speed),
)
calls: dict[str, list[Callable[[], Any]]] = {
    "cruise control: cbfpy, here, here with parameters by name": [
        lambda: np.asarray(clf_cbf.controller(z, z)),
        lambda: car.decide(x, car_p).u,
        lambda: car(x, leader=14.0).u,
    ],
    "point robot: cbfpy, here, here with parameters by name": [
        lambda: np.asarray(filtered(robot, goal, other)),
        lambda: ball.decide(robot, ball_p).u,
        lambda: ball(robot, obstacle=obstacle, speed=speed).u,
    ],
}
for what, each in calls.items():
    answers, fastest = [call().tolist() for call in each], np.full(len(each), np.inf)
    for _ in range(300):
        for i, call in enumerate(each):
            start = time.perf_counter()
            for _ in range(50):
                call()
            fastest[i] = min(fastest[i], (time.perf_counter() - start) / 50 * 1e6)
    print(f"{what}: {fastest.round(1)} us, u = {answers}")

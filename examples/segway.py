"""A wheeled pendulum learns to keep a speed limit, the task of Taylor et al. 2020: heavier and weaker than its model.

    state x = (v, theta, omega): the wheels' speed, the lean (forward positive), its rate;  input: the motor's torque
    CLF:      y = theta - the lean that the rider asks for, relative degree 2; a soft row
    barrier:  B = LIMIT - look-ahead speed >= 0, relative degree 1; a row with a slack of last resort

To brake, the wheels must first run forward, so that the body leans back; a limit on v alone would make the body fall.
The barrier therefore limits the speed of the body at HEIGHT plus what the lean will add to it.
"""

from collections.abc import Mapping

import casadi as ca
import numpy as np
from cbf_clf_qp import Barrier, Clf, System
from rabbit_description.task import Commands, ControlTask, Disc, Line, Shape

LIMIT, HEIGHT, AHEAD, RATE, GRAVITY = 3.0, 1.2, 4.0, 4.0, 9.81  # m/s; m; m/s a radian of lean; 1/s; m/s^2
RADIUS, WHEELS = 0.2, 12.0  # m, kg

body, center, inertia, motor, drag, lean = p = [ca.SX.sym(s) for s in ("body", "center", "I", "motor", "drag", "lean")]
v, theta, omega, torque = (ca.SX.sym(name) for name in ("v", "theta", "omega", "torque"))
lever, coupling = ca.vertcat(1 / RADIUS, -1), body * center * ca.cos(theta)  # drag acts between body and wheels
mass = ca.blockcat([[body + WHEELS, coupling], [coupling, inertia + body * center**2]])
forces = body * center * ca.sin(theta) * ca.vertcat(omega**2, GRAVITY) - lever * drag * (v / RADIUS - omega)
v_dot, omega_dot = ca.vertsplit(ca.inv_minor(mass) @ (forces + lever * motor * torque))
look_ahead = v + HEIGHT * ca.cos(theta) * omega + AHEAD * ca.sin(theta)


def commands(rng: np.random.Generator) -> Commands:
    """The rider leans forward, back for a second, and forward again."""
    lean, turn = rng.uniform(0.1, 0.2), rng.uniform(3, 4.5)
    return lambda t: {"lean": -lean if turn < t < turn + 1 else lean}


def draw(x: np.ndarray, p: Mapping[str, float]) -> list[Shape]:
    """The wheel and the body, where the wheel stands still."""
    axle, top = np.array([0, RADIUS]), np.array([HEIGHT * np.sin(x[1]), RADIUS + HEIGHT * np.cos(x[1])])
    return [Disc(axle, RADIUS, "gray"), Line(np.array([axle, top]), "tab:blue", 6)]


TASK = ControlTask(
    "segway",
    System(ca.vertcat(v, theta, omega), torque, ca.vertcat(v_dot, omega, omega_dot), p),
    [Clf(theta - lean, eps=0.3), Barrier("speed", LIMIT - look_ahead, poles=(RATE,))],
    nominal={"body": 60, "center": 0.8, "I": 5.0, "motor": 1.0, "drag": 0.5},
    true={"body": 70, "center": 0.85, "I": 6.5, "motor": 0.8, "drag": 1.0},
    start=((0, -0.05, 0), (1.5, 0.05, 0)),
    commands=commands,
    duration=8.0,
    failed=ca.fabs(theta) - 1.0,
    observation={"v": v, "theta": theta, "omega": omega},
    inputs=("torque",),
    draw=draw,
)

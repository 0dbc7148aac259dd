"""An uncertain cruise control whose answer is known in closed form: CLF, CBF, QP and estimates without a robot.

    car:      m dv/dt = u - m drag v,   true mass `scale` times the nominal one
    output:   y = v - v_desired,        relative degree 1;  CLF V = P y^2, CBF B = v_limit - v
    nominal:  u = m (mu + drag v)  gives  dy/dt = mu;  on the true car  dy/dt = mu + alpha mu + beta
              with alpha = 1/scale - 1 and beta = alpha drag v

While the CLF row alone is active, mu = (-rate/2 y - beta) / (1 + alpha), but for its slack.
"""

import casadi as ca
import numpy as np
from cbf_clf_qp import HARD, Barrier, Clf, System, Tick, model_error

MASS, DRAG, V_DESIRED, V_LIMIT, DT = 1650.0, 0.05, 24.0, 22.0, 0.01  # kg, 1/s, m/s, m/s, s

v, u, mass = (ca.SX.sym(name) for name in ("v", "u", "mass"))
ROWS = Clf(v - V_DESIRED, eps=0.5, gains=(1.0,)), Barrier("CBF", V_LIMIT - v, poles=(5.0,), rescue_weight=HARD)
TICK = Tick(System(v, u, u / mass - DRAG * v, parameters=[mass]), ROWS, solver="osqp")
ERROR = model_error(TICK.terms)  # what a perfect learner would say: of the quantities V and CBF


def drive(scale: float, perfect: bool, seconds: float = 8.0) -> list[float]:
    """Speeds from 10 m/s under the true car, with a perfect estimate or none, m/s."""
    speeds = [10.0]
    for _ in range(round(seconds / DT)):
        error = ERROR(np.array(speeds[-1:]), np.array([MASS]), np.array([scale * MASS if perfect else MASS]))
        u = TICK(speeds[-1:], error.alpha, error.beta, mass=MASS).u[0]
        speeds.append(speeds[-1] + DT * (u / (scale * MASS) - DRAG * speeds[-1]))
    return speeds


if __name__ == "__main__":
    for scale, perfect in ((s, p) for s in (0.5, 1.0, 2.0) for p in (False, True)):
        top = max(drive(scale, perfect))
        print(f"mass x{scale}: {'perfect' if perfect else 'no':>7} estimate: top speed {top:5.2f} m/s, limit {V_LIMIT}")

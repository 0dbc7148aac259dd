"""The slope that the next step is made for, chosen at each touchdown by a learned model of the speed from step to step.

The problem. A robot that climbs, is held back by its joints, or carries a load behind its hip walks slower than its
gait. Before it knows why, it can take the next step from a gait for steeper ground: that leans the torso forward, and
the robot falls faster into its step. But a push makes it slower or faster too, and is gone with the next step. A robot
that answers to a push as to a hill walks on with the wrong gait, and falls.

So two questions are asked at a touchdown. First: on which slope would the speed be what it is? Let v_k be the mean
speed of step k less that of its periodic gait, gamma_k the slope, degrees, that step k was made for, and Gamma the
slope on which the robot would keep its gait's speed. In walks with random changes of gamma the speed follows

    v_k = A v_{k-1} + B_0 gamma_k + B_1 gamma_{k-1} + B_2 gamma_{k-2} - (B_0 + B_1 + B_2) Gamma + noise,

whose coefficients `rabbit speed` finds. Each touchdown gives one Gamma. The estimate is the
median of the last REMEMBERED ones, of which the first is 0: what a push does to one or two of them is left out.

Second: what does the rate of the phase angle omega after the impact ask for? It is the state on the Poincare section,
and answers to the step's gait at once. With omega_d the periodic gait's,

    gamma_{k+1} = clip(clip(Gamma) + K_P (omega_d - omega)),    abs(gamma_{k+1} - gamma_k) <= MOST,

where clip is to the slopes that the library has gaits for.

The `integral` regulation is the rule without a model, to compare with. It takes for Gamma

    I_k = clip(I_{k-1} - K_I v_k).
"""

from collections.abc import Mapping

import casadi as ca
from cbf_clf_qp.qp import is_bounded

RETAINED = 0.695  # A
PER_SLOPE = (-0.046, 0.148, -0.037)  # B_0, B_1, B_2, (m/s) / degree
REMEMBERED = 6
K_P, MOST = 1.5, 1.5  # degrees / (rad/s), degrees
INTEGRAL_K_P, INTEGRAL_MOST = 2.0, 3.0  # the same without the model
K_I = 2.0  # degrees / (m/s), once a step

Expressions = Mapping[str, ca.SX]


def level(least: ca.SX, most: ca.SX) -> dict[str, ca.SX]:
    """What is kept from step to step, by name, as an episode begins; between the slopes `least` and `most`, degrees.

    `slopes` (3,): that the present step and those before it were made for, degrees, the latest first; at first level
    ground, or the slope nearest to it. `speed`: v of the last step, m/s. `found` (REMEMBERED,): Gamma of the last ones,
    degrees, the latest first. `integral`: I, degrees. NaN where there is none yet.
    """
    slope, nothing = clipped(ca.SX(0), least, most), ca.SX.nan()
    gammas = ca.vertcat(0, ca.repmat(nothing, REMEMBERED - 1))
    return {"slopes": ca.repmat(slope, len(PER_SLOPE)), "speed": nothing, "found": gammas, "integral": slope}


def regulated(
    kept: Expressions, least: ca.SX, most: ca.SX, missing: ca.SX, speed: ca.SX, kind: str
) -> dict[str, ca.SX]:
    """What is kept after a touchdown that lacks the rate `missing` = omega_d - omega, rad/s, and ends a step with the
    `speed` v, m/s; `kind`: learned or integral."""
    slopes, before = kept["slopes"], kept["speed"]
    if kind == "integral":
        integral = clipped(kept["integral"] - K_I * speed, least, most)
        aim, change, new = integral + INTEGRAL_K_P * missing, INTEGRAL_MOST, {"integral": integral}
    else:
        unexplained = RETAINED * before + ca.dot(ca.DM(PER_SLOPE), slopes) - speed
        gammas = ca.vertcat(unexplained / sum(PER_SLOPE), kept["found"][:-1])
        gammas = ca.if_else(is_bounded(before), gammas, kept["found"])
        aim, change, new = clipped(median(gammas), least, most) + K_P * missing, MOST, {"speed": speed, "found": gammas}
    slope = clipped(clipped(aim, least, most), slopes[0] - change, slopes[0] + change)
    return {**kept, **new, "slopes": ca.vertcat(slope, slopes[:-1])}


def clipped(value: ca.SX, least: ca.SX | float, most: ca.SX | float) -> ca.SX:
    """The nearest between these."""
    return ca.fmin(ca.fmax(value, least), most)


def median(values: ca.SX) -> ca.SX:
    """The median of those `values` (n,) that are not NaN: at least one."""
    n = values.numel()
    known = [ca.fabs(value) <= ca.inf for value in ca.vertsplit(values)]
    ordered = [ca.if_else(is_known, value, ca.inf) for is_known, value in zip(known, ca.vertsplit(values), strict=True)]
    for round_ in range(n):  # odd-even transposition sort
        for i in range(round_ % 2, n - 1, 2):
            ordered[i : i + 2] = ca.fmin(*ordered[i : i + 2]), ca.fmax(*ordered[i : i + 2])
    count, middle = ca.sum1(ca.vertcat(*known)), ca.SX(0)
    for k in range(1, n + 1):
        middle += ca.if_else(count == k, (ordered[(k - 1) // 2] + ordered[k // 2]) / 2, 0)
    return middle

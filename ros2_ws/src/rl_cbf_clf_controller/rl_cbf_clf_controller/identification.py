"""The true robot's parameters, identified from its walk, a window at a time.

The problem. Over a window with the stance foot on the ground, in all coordinates q (7,), with the mean torque command u
in the window and `before` that in the window before,

    Y(q, q', q'') theta + d D - kappa S u - lag S (before - u) = J' F

theta (12,) are the links' inertial parameters: m, m c_x, m c_z, I_yy of torso, thighs, shins, in the frames of their
joints, d the joints' damping with D_j = M_jj q_j' at
the joints, kappa the share of the torque that arrives, lag that of a change of torque that arrives a window late, and F
the measured force on both feet. All is linear in x = (theta, d, kappa, lag), which is found by least squares
(`least_squares.py`). q and q' are the mean of the window's ends, q'' their difference, F the mean over it.

A window is a tick of 10 ms, or as many shorter ones: so all that is said below of noise and of doubts holds at every
rate. (Noise of rates is as large in q'' as the time between them is short, so at 1 kHz q'' over a tick has ten times
the noise, and the regressors have it too, where no average mends it.)

A difference of noisy rates is noisier still, and as it is part of the regressors too, it would pull the answer
towards none. So both sides go through the same low-pass (FILTER_TIME) first, which leaves the equation true. Of M q''
the noise is M times that of q''. R has it with many times the rates' variance, because the regressors are noisy too,
and no average mends that. The other entries of R are for what the means over a window leave out.

What such a robot does not explain is seen in the innovations. Their normalised square is below 0.1 in the mean for any
masses, and about 1 for motors that saturate unseen or joints whose friction remembers. A doubt (0 to 1) follows it,
fast when it rises and slowly when it falls.

No motor, gear or joint acts in the first three rows, those of the base (two slides and the pitch). So theta is found a
second time, from these rows alone. It is less exact and no motor can mislead it. Their own doubt is 0 whatever the
motors do, and rises where a sensor is wrong. `shares` says which robot is then used.

The prior: the nominal robot, and around it a mass scale, a point mass at the torso's centre of mass
and, much less, any change of any link. M_jj is that of the last x. d, kappa, theta are told apart because F is
measured in newtons and not in torques.
"""

from collections.abc import Mapping

import casadi as ca
import numpy as np
from rabbit_description.planar_urdf import BASE, SLIDES
from rabbit_description.state import DOF, TICK_SECONDS, Array
from rabbit_description.tick import ticks_in

from rl_cbf_clf_controller.least_squares import from_upper, updated, upper, within
from rl_cbf_clf_controller.planar_robot import INERTIAL, PinnedRobot, robot_parameters
from rl_cbf_clf_controller.robot_numbers import GRAVITY, RobotNumbers

LINKS = ("torso", "thigh", "shin")
IDENTIFIED = (
    *(f"{link}_{name}" for link in LINKS for name in INERTIAL),
    "joint_damping",  # d, 1/s
    "motor_gain",  # kappa
    "late_torque",  # lag
)
SIZE = len(IDENTIFIED)
THETA = slice(len(LINKS) * len(INERTIAL))
DAMPING, MOTOR_GAIN, LATE_TORQUE = range(THETA.stop, SIZE)

WINDOW = TICK_SECONDS  # s, of ticks that long or shorter
FILTER_TIME = 0.03  # s
FORCE_NOISE = 30.0  # N, rows of the base's slides
MOMENT_NOISE = 5.0  # N m, rows of pitch and joints
RATE_NOISE = 0.1  # m/s and rad/s, of rates that are measured without noise
SCALE_SPREAD = 1.0  # standard deviations of the prior: of the mass scale about 1
PAYLOAD_SPREAD = 40.0  # of a point mass on the torso, kg
LINK_SPREAD = 0.1  # of each parameter of a link, relative
DAMPING_SPREAD = 1.0  # 1/s
GAIN_SPREAD = 0.1
LATE_SPREAD = 0.3
WALK = 1e-6  # of the first covariance, gained each window

NOISE = np.diag([FORCE_NOISE**2] * SLIDES + [MOMENT_NOISE**2] * (DOF - SLIDES))
USUAL_LATE, LATE_RANGE = 0.42, 0.1  # a motor lag of 4 ms has 0.37; 8 kN m/s at twice the mass 0.5 to 0.8
EXPLAINED, UNEXPLAINED = 0.5, 2.0  # normalised squares of an innovation; the doubt goes towards 0 and 1 there
DOUBT_RISES, DOUBT_FALLS = 0.05, 0.005  # of the way, each window
TO_BASE, TO_NOMINAL = (0.15, 0.3), (0.3, 0.6)  # the doubts from which on another robot counts, and it alone
BASE_DOUBT = 0.05  # of the base's rows, from which on they are not used


def unknown(robot: RobotNumbers) -> dict[str, Array]:
    """What is known of a `robot` before it moves: nominal links, ideal motors, and the prior.

    `value` (15,), as in `IDENTIFIED`; `base` (12,), theta as the base's rows say; `doubts` (2,), how much all rows and
    the base's leave unexplained. `fit`, `base_fit`: what the least squares say; of their `covariance` the upper
    triangle. `regressor`, `measured`: both sides, filtered; `share`: of the next tick in them.
    """
    value, prior = np.concatenate([robot.theta, [0.0, 1.0, 0.0]]), prior_covariance(robot.theta)
    half, of_theta = (matrix[np.tril_indices(len(matrix))] for matrix in (prior, prior[THETA, THETA]))
    of_base = {"base": robot.theta, "base_fit": robot.theta, "base_covariance": of_theta}
    known = {"value": value, "fit": value, "covariance": half, **of_base, "doubts": np.zeros(2)}
    return known | {"regressor": np.zeros((DOF, SIZE)), "measured": np.zeros(DOF), "share": np.ones(1)}


def window(tick_seconds: float) -> float:
    """Length of a window, s: so many whole ticks as come nearest to `WINDOW`."""
    return ticks_in(WINDOW, tick_seconds) * tick_seconds


def learned(
    robot: RobotNumbers, known: Mapping[str, ca.SX], tick: Mapping[str, ca.SX], seconds: float = WINDOW
) -> dict[str, ca.SX]:
    """What is `known` after a window of so many `seconds`, by the names of `unknown`, as expressions.

    `tick`, of the window: its `start` and `end` (14,), torque `before` and `now` (4,), `force` (2, 2) on the feet, all
    in stance/swing order, rows of the force stance, swing, columns tangential, normal, N; `rate_variance` of the errors
    of dq, (m/s)^2 and (rad/s)^2; `joints` and `feet` of the robot; whether it `learns`, else the least squares say what
    they said before. What they say is taken over as long as it is a robot that can be.
    """
    regressor, measured, mass = equation({**tick, "theta": known["value"][THETA]}, seconds)
    share = float(1 - np.exp(-seconds / FILTER_TIME))
    per_rate_variance = 2 * (share / seconds) ** 2 / (2 - share)  # of a low-passed difference of white noise
    filtered = ca.project(known["regressor"], regressor.sparsity())  # without the entries that are always zero
    regressor = filtered + known["share"] * (regressor - filtered)
    measured = known["measured"] + known["share"] * (measured - known["measured"])
    noise = ca.DM(NOISE) + per_rate_variance * tick["rate_variance"] * mass @ mass
    walk = WALK * prior_covariance(robot.theta)
    before = known["fit"], from_upper(known["covariance"], SIZE), walk
    fit, covariance, square = updated(*before, regressor, measured, noise, tick["learns"])
    of_base = regressor[:BASE, THETA], measured[:BASE], noise[:BASE, :BASE]
    base_before = known["base_fit"], from_upper(known["base_covariance"], THETA.stop), walk[THETA, THETA]
    base_fit, base_covariance, base_square = updated(*base_before, *of_base, tick["learns"])
    is_robot = ca.logic_and(is_physical(fit[THETA]), fit[MOTOR_GAIN] > 0)
    doubts = doubt_after(known["doubts"][0], square), doubt_after(known["doubts"][1], base_square)
    return {
        **{"value": ca.if_else(is_robot, fit, known["value"]), "fit": fit, "covariance": upper(covariance)},
        **{"base": ca.if_else(is_physical(base_fit), base_fit, known["base"]), "base_fit": base_fit},
        **{"base_covariance": upper(base_covariance), "doubts": ca.vertcat(*doubts)},
        **{"regressor": regressor, "measured": measured, "share": ca.SX(share)},
    }


def equation(s: dict[str, ca.SX], seconds: float) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Regressor (7, 15), measured side (7,) and mass matrix (7, 7) of one window, as expressions of its symbols."""
    torso, thigh, shin = (link.T for link in ca.vertsplit(s["theta"], len(INERTIAL)))
    lengths = {"joints": s["joints"], "feet": s["feet"], "links": ca.vertcat(torso, thigh, shin, thigh, shin)}
    robot = PinnedRobot(parameters={**robot_parameters(), **lengths, "gravity": ca.SX(GRAVITY)})
    ddq = ca.SX.sym("ddq", DOF)
    tau, points = robot.inverse_dynamics(ddq), ca.vertcat(*robot.feet)
    middle, change = (s["start"] + s["end"]) / 2, (s["end"][DOF:] - s["start"][DOF:]) / seconds
    terms = [ca.jacobian(tau, s["theta"]), ca.jacobian(tau, ddq), ca.jacobian(points, robot.q)]
    at_tick = [middle[:DOF], middle[DOF:], change]
    moved, mass, jacobians = ca.substitute(terms, [robot.q, robot.dq, ddq], at_tick)
    base = ca.SX.zeros(BASE)
    damping = ca.vertcat(base, (ca.diag(mass) * middle[DOF:])[BASE:])
    of_joints = damping, ca.vertcat(base, -s["now"]), ca.vertcat(base, -(s["before"] - s["now"]))
    return ca.horzcat(moved, *of_joints), jacobians.T @ ca.vec(s["force"].T), mass


def doubt_after(doubt: ca.SX, square: ca.SX) -> ca.SX:
    """The doubt after an innovation with this normalised square."""
    aim = within((square - EXPLAINED) / (UNEXPLAINED - EXPLAINED))
    return doubt + ca.if_else(aim > doubt, DOUBT_RISES, DOUBT_FALLS) * (aim - doubt)


def shares(doubts: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The shares of the base's and of the nominal robot in the one that is used, by the `doubts` (2,).

    Where only the motors are wrong, the base's takes over; where the base's rows are not explained either, the nominal.
    """
    sensors = within(doubts[1] / BASE_DOUBT)
    to_base, to_nominal = (within((doubts[0] - begin) / (end - begin)) for begin, end in (TO_BASE, TO_NOMINAL))
    return to_base * (1 - sensors), to_nominal * sensors


def in_use(value: ca.SX, base: ca.SX, nominal: Array, doubts: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The robot that is used, (15,), by the `doubts` (2,) of the one found; how little that one counts, from 0 to 1.

    Beside the masses that the base's rows say, motors are ideal, and late as found: a share of torque, so below one.
    """
    of_base, of_nominal = shares(doubts)
    late = value[LATE_TORQUE]
    ideal = ca.vertcat(base, 0, 1, ca.if_else(late < 1, late, USUAL_LATE))
    used = (1 - of_base - of_nominal) * value + of_base * ideal + of_nominal * ca.DM(nominal)
    return used, of_base + of_nominal


def lateness(late_torque: ca.SX) -> ca.SX:
    """How slow the motors are, from 0 (a lag of 4 ms) to 1, by the identified `late_torque`."""
    return within((late_torque - USUAL_LATE) / LATE_RANGE)


def is_physical(theta: ca.SX) -> ca.SX:
    """1 where every link has a mass and, about its centre of mass, an inertia, else 0."""
    links = ca.reshape(theta, len(INERTIAL), len(LINKS))
    mass, mc_x, mc_z, inertia = (links[i, :] for i in range(len(INERTIAL)))
    return ca.mmin(ca.logic_and(mass > 0, inertia * mass > mc_x**2 + mc_z**2))


def prior_covariance(theta: Array) -> Array:
    """The covariance of x (15, 15) about the robot theta (12,)."""
    torso_mass, _, torso_moment, _ = theta[: len(INERTIAL)]
    height = torso_moment / torso_mass
    point_mass = np.zeros(len(theta))
    point_mass[: len(INERTIAL)] = 1.0, 0.0, height, height**2
    sizes = np.abs(theta)
    sizes[1 :: len(INERTIAL)] = sizes[2 :: len(INERTIAL)]  # the CoM may turn about the joint
    covariance = np.zeros((SIZE, SIZE))
    covariance[THETA, THETA] = (
        SCALE_SPREAD**2 * np.outer(theta, theta)
        + PAYLOAD_SPREAD**2 * np.outer(point_mass, point_mass)
        + np.diag((LINK_SPREAD * sizes) ** 2)
    )
    covariance[DAMPING:, DAMPING:] = np.diag([DAMPING_SPREAD**2, GAIN_SPREAD**2, LATE_SPREAD**2])
    return covariance

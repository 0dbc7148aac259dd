"""The true robot's parameters, identified from its walk, a tick at a time.

The problem. Over a tick with the stance foot on the ground, in all coordinates q (7,), with a torque command u held
for the tick and `before` the one held for the tick before,

    Y(q, q', q'') theta + d D - kappa S u - lag S (before - u) = J' F

theta (12,) are the links' inertial parameters: m, m c_x, m c_z, I_yy of torso, thighs, shins, in the frames of their
joints, d the joints' damping with D_j = M_jj q_j' at
the joints, kappa the share of the torque that arrives, lag that of a change of torque that arrives a tick late, and F
the measured force on both feet. All is linear in x = (theta, d, kappa, lag), which is found by least squares
(`least_squares.py`). q and q' are the mean of the tick's ends, q'' their difference, F the mean over the tick.

A difference of noisy rates is noisier still, and as it is part of the regressors too, it would pull the answer
towards none. So both sides go through the same low-pass (FILTER_TIME) first, which leaves the equation true. Of M q''
the noise is M times that of q'', which is in R with the rates' variance; the other entries of R are for what the means
over a tick leave out.

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

import casadi as ca
import numpy as np
from cbf_clf_qp.functions import NumpyFunction
from rabbit_description.planar_urdf import BASE, SLIDES
from rabbit_description.state import DOF, JOINTS, TICK_SECONDS, Array

from rl_cbf_clf_controller.least_squares import LeastSquares, updated
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
WALK = 1e-6  # of the first covariance, gained each tick

NOISE = np.diag([FORCE_NOISE**2] * SLIDES + [MOMENT_NOISE**2] * (DOF - SLIDES))
USUAL_LATE, LATE_RANGE = 0.42, 0.1  # a motor lag of 4 ms has 0.37; 8 kN m/s at twice the mass 0.5 to 0.8
SHARE = float(1 - np.exp(-TICK_SECONDS / FILTER_TIME))
PER_RATE_VARIANCE = 2 * (SHARE / TICK_SECONDS) ** 2 / (2 - SHARE)  # of a low-passed difference of white noise
EXPLAINED, UNEXPLAINED = 0.5, 2.0  # normalised squares of an innovation; the doubt goes towards 0 and 1 there
DOUBT_RISES, DOUBT_FALLS = 0.05, 0.005  # of the way, each tick
TO_BASE, TO_NOMINAL = (0.15, 0.3), (0.3, 0.6)  # the doubts from which on another robot counts, and it alone
BASE_DOUBT = 0.05  # of the base's rows, from which on they are not used
NOTHING_FILTERED = np.zeros((DOF, SIZE)), np.zeros(DOF)


class Identification:
    """`value` (15,), as in `IDENTIFIED`, of a robot with the lengths of `robot`; starts from its links.

    `base` (12,) is theta as the base's rows say, `doubts` (2,) how much all rows and the base's leave unexplained. What
    the least squares say is taken over as long as it is a robot that can be. One object serves one thread.
    """

    def __init__(self, robot: RobotNumbers) -> None:
        self._joints, self._feet = robot.joints, robot.feet
        self.nominal = np.concatenate([robot.theta, [0.0, 1.0, 0.0]])
        self._prior = prior_covariance(robot.theta)
        self._learned = identification_function()
        self.reset()

    def reset(self) -> None:
        """Return to the prior: the nominal robot."""
        theta, of_theta = self.nominal[THETA], self._prior[THETA, THETA]
        self._fit = LeastSquares(self.nominal, self._prior, WALK * self._prior)
        self._base_fit = LeastSquares(theta, of_theta, WALK * of_theta)
        self.value, self.base, self.doubts = self.nominal, theta, np.zeros(2)
        self.interrupt()

    def interrupt(self) -> None:
        """The next tick does not follow the last one that was learned from."""
        self._filtered, self._share = NOTHING_FILTERED, np.ones(1)

    def learn(
        self,
        start: Array,
        end: Array,
        torques: tuple[Array, Array],
        force: Array,
        rate_variance: float = RATE_NOISE**2,
    ) -> None:
        """From a tick's `start` and `end` (14,), `torques` (before, now), (4,) each, and `force` (2, 2) on the feet.

        All in stance/swing order; `force` has rows stance, swing and columns tangential, normal, N; `rate_variance`
        is that of the errors of dq, (m/s)^2 and (rad/s)^2.
        """
        fit, base, of_robot = self._fit, self._base_fit, (self._joints, self._feet, self.value[THETA])
        of_fit = fit.value, fit.covariance, fit.walk, base.value, base.covariance
        of_tick = start, end, *torques, force, *self._filtered, self._share, np.array([rate_variance]), self.doubts
        found = self._learned(*of_robot, *of_fit, *of_tick)
        self._filtered, self._share = (found.regressor, found.measured), np.array([SHARE])
        fit.take(found.value, found.covariance)
        base.take(found.base, found.base_covariance)
        self.doubts = found.doubts
        if is_physical(fit.value[THETA]) and fit.value[MOTOR_GAIN] > 0:
            self.value = fit.value
        if is_physical(base.value):
            self.base = base.value


def identification_function() -> NumpyFunction:
    """x `value` and its `covariance` a tick later, the same of theta from the `base`'s rows, the `doubts`, then the
    filtered `regressor` and `measured` side.

    Its inputs are those of `Identification.learn`, in this order: joints, feet, theta; value, covariance, walk, base
    and its covariance; start, end, torque before and now, force, filtered regressor and measured side, share,
    rate_variance, doubts.
    """
    sizes = {"joints": (JOINTS, 2), "feet": (2, 2), "theta": (THETA.stop, 1)}
    sizes |= {"value": (SIZE, 1), "covariance": (SIZE, SIZE), "walk": (SIZE, SIZE)}
    sizes |= {"base": (THETA.stop, 1), "base_covariance": (THETA.stop, THETA.stop)}
    sizes |= {"start": (2 * DOF, 1), "end": (2 * DOF, 1), "before": (JOINTS, 1), "now": (JOINTS, 1), "force": (2, 2)}
    sizes |= {"regressor": (DOF, SIZE), "measured": (DOF, 1), "share": (1, 1), "rate_variance": (1, 1)}
    sizes |= {"doubts": (2, 1)}
    s = {name: ca.SX.sym(name, *size) for name, size in sizes.items()}
    regressor, measured, mass = equation(s)
    regressor = s["regressor"] + s["share"] * (regressor - s["regressor"])
    measured = s["measured"] + s["share"] * (measured - s["measured"])
    noise = ca.DM(NOISE) + PER_RATE_VARIANCE * s["rate_variance"] * mass @ mass
    value, covariance, square = updated(s["value"], s["covariance"], s["walk"], regressor, measured, noise)
    found = {"value": value, "covariance": covariance, "regressor": regressor, "measured": measured}
    of_theta, of_base = s["walk"][THETA, THETA], (regressor[:BASE, THETA], measured[:BASE], noise[:BASE, :BASE])
    base, covariance, base_square = updated(s["base"], s["base_covariance"], of_theta, *of_base)
    found |= {"base": base, "base_covariance": covariance}
    found["doubts"] = ca.vertcat(doubt_after(s["doubts"][0], square), doubt_after(s["doubts"][1], base_square))
    return NumpyFunction.of("identification", s, found)


def equation(s: dict[str, ca.SX]) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Regressor (7, 15), measured side (7,) and mass matrix (7, 7) of one tick, as expressions of its symbols."""
    torso, thigh, shin = (link.T for link in ca.vertsplit(s["theta"], len(INERTIAL)))
    lengths = {"joints": s["joints"], "feet": s["feet"], "links": ca.vertcat(torso, thigh, shin, thigh, shin)}
    robot = PinnedRobot(parameters={**robot_parameters(), **lengths, "gravity": ca.SX(GRAVITY)})
    ddq = ca.SX.sym("ddq", DOF)
    tau, points = robot.inverse_dynamics(ddq), ca.vertcat(*robot.feet)
    at_tick = (
        [robot.q, robot.dq, ddq],
        [
            (s["start"][:DOF] + s["end"][:DOF]) / 2,
            (s["start"][DOF:] + s["end"][DOF:]) / 2,
            (s["end"][DOF:] - s["start"][DOF:]) / TICK_SECONDS,
        ],
    )
    terms = [ca.jacobian(tau, s["theta"]), ca.jacobian(tau, ddq), ca.jacobian(points, robot.q)]
    moved, mass, jacobians = ca.substitute(terms, *at_tick)
    base = ca.SX.zeros(BASE)
    damping = ca.vertcat(base, (ca.diag(mass) * at_tick[1][1])[BASE:])
    own = [damping, ca.vertcat(base, -s["now"]), ca.vertcat(base, -(s["before"] - s["now"]))]
    return ca.horzcat(moved, *own), jacobians.T @ ca.vec(s["force"].T), mass


def doubt_after(doubt: ca.SX, square: ca.SX) -> ca.SX:
    """The doubt after an innovation with this normalised square."""
    aim = ca.fmin(ca.fmax((square - EXPLAINED) / (UNEXPLAINED - EXPLAINED), 0), 1)
    return doubt + ca.if_else(aim > doubt, DOUBT_RISES, DOUBT_FALLS) * (aim - doubt)


def shares(doubts: Array) -> tuple[Array, Array]:
    """Of the base's and of the nominal robot in the one that is used, each (..., 1), by the `doubts` (..., 2).

    Where only the motors are wrong, the base's takes over; where the base's rows are not explained either, the nominal.
    """
    doubt, sensors = doubts[..., :1], (doubts[..., 1:] / BASE_DOUBT).clip(0, 1)
    to_base, to_nominal = (((doubt - begin) / (end - begin)).clip(0, 1) for begin, end in (TO_BASE, TO_NOMINAL))
    return to_base * (1 - sensors), to_nominal * sensors


def in_use(value: Array, base: Array, nominal: Array, doubts: Array) -> Array:
    """The robot that is used, (..., 15), by the `doubts` (..., 2) of the one found.

    Beside the masses that the base's rows say, motors are ideal, and late as found: a share of torque, so below one.
    """
    of_base, of_nominal = shares(doubts)
    late = value[..., LATE_TORQUE:]
    motors = np.zeros_like(late), np.ones_like(late), np.where(late < 1, late, USUAL_LATE)
    other = np.concatenate([base, *motors], axis=-1)
    used: Array = (1 - of_base - of_nominal) * value + of_base * other + of_nominal * nominal
    return used


def disbelief(doubts: Array) -> Array:
    """How little the robot found from all rows counts, (..., 1), from 0 to 1."""
    of_base, of_nominal = shares(doubts)
    return of_base + of_nominal


def lateness(late_torque: Array) -> Array:
    """How slow the motors are, from 0 (a lag of 4 ms) to 1, by the identified `late_torque`, of any shape."""
    return ((late_torque - USUAL_LATE) / LATE_RANGE).clip(0, 1)


def is_physical(theta: Array) -> bool:
    """Whether every link has a mass and, about its centre of mass, an inertia."""
    links = theta.reshape(len(LINKS), -1).tolist()
    return all(mass > 0 and inertia * mass > mc_x**2 + mc_z**2 for mass, mc_x, mc_z, inertia in links)


def prior_covariance(theta: Array) -> Array:
    """Of x (15, 15) about the robot theta (12,)."""
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

"""The true robot's parameters, identified from its walk, a tick at a time.

The problem. Over a tick with the stance foot on the ground, in all coordinates q (7,), with a torque command u held
for the tick and `before` the one held for the tick before,

    Y(q, q', q'') theta + d D - kappa S u - lag S (before - u) = J' F

theta (12,) are the links' inertial parameters (`link_parameters.py`), d the joints' damping with D_j = M_jj q_j' at
the joints, kappa the share of the torque that arrives, lag that of a change of torque that arrives a tick late, and F
the measured force on both feet. All is linear in x = (theta, d, kappa, lag), which is found by least squares
(`least_squares.py`). q and q' are the mean of the tick's ends, q'' their difference, F the mean over the tick.

A difference of noisy rates is noisier still, and as it is part of the regressors too, it would pull the answer
towards none. So both sides go through the same low-pass (FILTER_TIME) first, which leaves the equation true. Of M q''
the noise is M times that of q'', which is in R with the rates' variance; the other entries of R are for what the means
over a tick leave out.

What is believed at first: the nominal robot, and around it a mass scale, a point mass at the torso's centre of mass
and, much less, any change of any link. M_jj is that of the last x. d, kappa, theta are told apart because F is
measured in newtons and not in torques.
"""

from typing import Any

import numpy as np
import pinocchio as pin
from cbf_clf_qp.tracing import Traced
from rabbit_description.state import TICK_SECONDS, Array

from rl_cbf_clf_controller import link_parameters as links
from rl_cbf_clf_controller.generated_model import make_motion_terms
from rl_cbf_clf_controller.least_squares import LeastSquares, updated
from rl_cbf_clf_controller.nominal_model import ACTUATED, INPUT_MAP

IDENTIFIED = (
    *(f"{link}_{name}" for link in ("torso", "thigh", "shin") for name in ("m", "mc_x", "mc_z", "I_yy")),
    "joint_damping",  # d, 1/s
    "motor_gain",  # kappa
    "late_torque",  # lag
)
THETA, DAMPING, MOTOR_GAIN, LATE_TORQUE = slice(0, links.SIZE), links.SIZE, links.SIZE + 1, links.SIZE + 2
SIZE = len(IDENTIFIED)

FILTER_TIME = 0.03  # s
FORCE_NOISE = 30.0  # N, rows of the base's slides
MOMENT_NOISE = 5.0  # N m, rows of pitch and joints
RATE_NOISE = 0.1  # m/s and rad/s, of rates that are measured without noise
SCALE_SPREAD = 1.0  # standard deviations of what is believed at first: of the mass scale about 1
PAYLOAD_SPREAD = 40.0  # of a point mass on the torso, kg
LINK_SPREAD = 0.1  # of each parameter of a link, relative
DAMPING_SPREAD = 1.0  # 1/s
GAIN_SPREAD = 0.1
LATE_SPREAD = 0.3
WALK = 1e-6  # of the first covariance, gained each tick

NOISE = np.diag([FORCE_NOISE**2] * 2 + [MOMENT_NOISE**2] * 5)
SHARE = float(1 - np.exp(-TICK_SECONDS / FILTER_TIME))
PER_RATE_VARIANCE = 2 * (SHARE / TICK_SECONDS) ** 2 / (2 - SHARE)  # of a low-passed difference of white noise
NOTHING_FILTERED = np.zeros((7, SIZE)), np.zeros(7)


class Identification:
    """`value` (15,), as in `IDENTIFIED`, of a robot with the kinematics of `model`; starts from its inertias.

    What the least squares say is taken over as long as it is a robot that can be.
    """

    def __init__(self, model: pin.Model) -> None:
        self._motion_terms = make_motion_terms(model)
        self._start = np.concatenate([links.read_links(model), [0.0, 1.0, 0.0]])
        self._prior = prior_covariance(self._start[THETA])
        self._learned = traced_identification.twin()
        self.reset()
        at_rest = np.zeros(model.nq), np.zeros(model.nv)
        self.learn(at_rest, at_rest, (np.zeros(4), np.zeros(4)), np.zeros((2, 2)))  # traced now, not in a tick
        self.reset()

    def reset(self) -> None:
        """Believe in the nominal robot again."""
        self._fit = LeastSquares(self._start, self._prior, WALK * self._prior)
        self.value = self._start
        self.interrupt()

    def interrupt(self) -> None:
        """The next tick does not follow the last one that was learned from."""
        self._filtered, self._share = NOTHING_FILTERED, 1.0

    def learn(
        self,
        start: tuple[Array, Array],
        end: tuple[Array, Array],
        torques: tuple[Array, Array],
        force: Array,
        rate_variance: float = RATE_NOISE**2,
    ) -> None:
        """From a tick's `start` and `end` (q, dq), `torques` (before, now), (4,) each, and `force` (2, 2) on the feet.

        All in stance/swing order; `force` has rows stance, swing and columns tangential, normal, N; `rate_variance`
        is that of the errors of dq, (m/s)^2 and (rad/s)^2.
        """
        fit, of_tick = self._fit, (start, end, torques, force)
        of_fit = fit.value, fit.covariance, fit.walk
        value, covariance, *filtered = self._learned(
            self._motion_terms, self.value[THETA], *of_fit, *of_tick, self._filtered, self._share, rate_variance
        )
        self._filtered, self._share = (filtered[0], filtered[1]), SHARE
        fit.take(value, covariance)
        if links.is_physical(fit.value[THETA]) and fit.value[MOTOR_GAIN] > 0:
            self.value = fit.value


@Traced
def traced_identification(
    motion_terms: Any,
    theta: Array,
    value: Array,
    covariance: Array,
    walk: Array,
    start: tuple[Array, Array],
    end: tuple[Array, Array],
    torques: tuple[Array, Array],
    force: Array,
    filtered: tuple[Array, Array],
    share: float,
    rate_variance: float,
) -> list[Array]:
    """x and its covariance a tick later, then the filtered regressor and measured side."""
    regressor, measured, mass = equation(motion_terms, theta, start, end, torques, force)
    regressor = filtered[0] + share * (regressor - filtered[0])
    measured = filtered[1] + share * (measured - filtered[1])
    noise = NOISE + PER_RATE_VARIANCE * rate_variance * mass @ mass
    return [*updated(value, covariance, walk, regressor, measured, noise), regressor, measured]


def equation(
    motion_terms: Any,
    theta: Array,
    start: tuple[Array, Array],
    end: tuple[Array, Array],
    torques: tuple[Array, Array],
    force: Array,
) -> tuple[Array, Array, Array]:
    """Regressor (7, 15), measured side (7,) and mass matrix (7, 7) of one tick, the links being theta (12,)."""
    q, dq, ddq = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2, (end[1] - start[1]) / TICK_SECONDS
    moved, mass, jacobians = motion_terms(q, dq, ddq, theta)
    before, now = torques
    own = [ACTUATED * mass.diagonal() * dq, -INPUT_MAP @ now, -INPUT_MAP @ (before - now)]
    regressor = np.column_stack([moved, *own])
    return regressor, jacobians[0].T @ force[0] + jacobians[1].T @ force[1], mass


def prior_covariance(theta: Array) -> Array:
    """Of x (15, 15) about the robot theta (12,)."""
    torso_mass, _, torso_moment, _ = theta[:4]
    height = torso_moment / torso_mass
    point_mass = np.concatenate([[1.0, 0.0, height, height**2], np.zeros(links.SIZE - 4)])
    sizes = np.abs(theta)
    sizes[1::4] = sizes[2::4]  # the CoM may turn about the joint
    covariance = np.zeros((SIZE, SIZE))
    covariance[THETA, THETA] = (
        SCALE_SPREAD**2 * np.outer(theta, theta)
        + PAYLOAD_SPREAD**2 * np.outer(point_mass, point_mass)
        + np.diag((LINK_SPREAD * sizes) ** 2)
    )
    covariance[links.SIZE :, links.SIZE :] = np.diag([DAMPING_SPREAD**2, GAIN_SPREAD**2, LATE_SPREAD**2])
    return covariance

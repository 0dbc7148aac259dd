"""Online adaptation: the true robot is identified as it walks, and what that changes enters the QP as alpha and beta.

`identification.py` finds what the robot weighs, how its joints are damped and what its motors give;
`joint_calibration.py` where its joints' angles are zero. A second model carries what is found, and the estimates are
the difference of the quantities by this and by the nominal model, as the oracle's are by the plant's own
(`cbf_clf_qp.estimates`). The policy's are added to them. The angles are corrected before anything is computed from
them. Where the state is predicted (`state_prediction.py`), the identification still learns from the measured one.

The identification uses a tick only if the stance foot was the only one on the ground, and had been for SETTLING ticks.
So it leaves out the tick of a touchdown, flight, a swing foot on the ground, a missing tick, an unknown torque. (A foot
that bounces lands twice.) It forgets nothing when the legs swap: the robot is the same from either leg. An episode
begins with nothing known, and with some ticks in which only the noise of the rates is found (`rate_noise.py`).

No masses explain a motor that saturates unseen. As far as the innovations say so, the robot found gives way to the one
that the base's rows say or to the nominal one (`identification.py`).
"""

from copy import copy

import numpy as np
from cbf_clf_qp.estimates import Estimates
from rabbit_description.planar_urdf import SLIDES
from rabbit_description.state import DOF, Array, RobotState

from rl_cbf_clf_controller.identification import (
    DAMPING,
    IDENTIFIED,
    LATE_TORQUE,
    MOTOR_GAIN,
    THETA,
    Identification,
    disbelief,
    in_use,
    lateness,
)
from rl_cbf_clf_controller.joint_calibration import JointCalibration
from rl_cbf_clf_controller.rate_noise import RateNoise
from rl_cbf_clf_controller.robot_numbers import RobotNumbers
from rl_cbf_clf_controller.scene import Estimator, Scene, is_finite
from rl_cbf_clf_controller.state_prediction import prediction_function

KNOWN = (*IDENTIFIED, "hip_offset", "knee_offset", "doubt")  # offsets in rad
SETTLING = 2  # ticks on the ground before what is measured counts
PITCH_RATE = DOF + SLIDES  # its place in the state
CONTACT_FORCE = 1.0  # N; a foot that carries less is in the air


class IdentifiedRobot(Estimator):
    """The robot as identified so far; it begins as the `nominal` one. One object serves one thread.

    With `gives_way` others count where it does not explain what is measured.
    """

    def __init__(self, nominal: RobotNumbers, gives_way: bool = False) -> None:
        self._nominal, self._gives_way = nominal, gives_way
        self._identification = Identification(nominal)
        self._calibration = JointCalibration(nominal)
        self._rate_noise = RateNoise()
        self._predicted = prediction_function()
        self.reset()

    @property
    def known(self) -> Array:
        """(18,), as in `KNOWN`, of the robot that is used."""
        return np.concatenate([self._used, self._calibration.value, self._identification.doubts[:1]])

    @property
    def disbelief(self) -> float:
        """See `identification.disbelief`; 0 where it does not give way."""
        return float(disbelief(self._identification.doubts)[0]) if self._gives_way else 0.0

    @property
    def lateness(self) -> float:
        """See `identification.lateness`."""
        return float(lateness(self._used[LATE_TORQUE]))

    def reset(self) -> None:
        """Begin an episode: the nominal robot."""
        self._identification.reset()
        self._calibration.reset()
        self._rate_noise.reset()
        self._last: Scene | None = None
        self._measured: Array | None = None
        self._measured_last: Array | None = None
        self._standing = 0  # ticks on end in which the stance foot alone stood
        self._update_row()

    def another(self) -> "IdentifiedRobot":
        """See `Estimator`."""
        other = copy(self)
        other._identification, other._calibration = copy(self._identification), copy(self._calibration)
        other._rate_noise = copy(self._rate_noise)
        other.reset()
        return other

    def corrected(self, state: RobotState) -> RobotState:
        """The state with its angles set right."""
        return state.with_q(self.set_right(state.q))

    def set_right(self, q: Array) -> Array:
        """The angles in q (7,), in either order of the legs."""
        return self._calibration.corrected(q)

    def predicted(self, x: Array, torque: Array) -> Array:
        """The state (14,) in which a torque that is computed from `x` takes effect, stance/swing order.

        `torque` (4,), N m, acts until then; where it is not known, the state is that of now.
        """
        self._measured = x
        if not is_finite(torque):
            return x
        return self._predicted(x, self._row, torque, self._used[LATE_TORQUE : LATE_TORQUE + 1]).x

    def estimate(self, scene: Scene, before: Estimates) -> Estimates:
        """Learn from the tick that ends now; then by how much the robot found differs from the nominal one."""
        measured = scene.x if self._measured is None else self._measured
        self._learn(scene, measured)
        self._last, self._measured_last, self._measured = scene, measured, None
        return scene.error_of(self._row)

    def _learn(self, now: Scene, measured: Array) -> None:
        last, before = self._last, self._measured_last
        if last is None or before is None or not is_pinned(last.tick, now):
            self._standing = 0
            self._identification.interrupt()
            self._rate_noise.interrupt()
            return
        self._standing += 1
        if self._standing > SETTLING and is_finite(last.torque):
            self._calibration.learn(measured)
            self._rate_noise.add(before[PITCH_RATE], measured[PITCH_RATE])
            variance = self._rate_noise.variance
            if variance is not None:
                self._identification.learn(before, measured, (last.torque, now.torque), now.force, variance)
            self._update_row()

    def _update_row(self) -> None:
        of = self._identification
        used = self._used = in_use(of.value, of.base, of.nominal, of.doubts) if self._gives_way else of.value
        self._row = self._nominal.with_links(used[THETA], used[MOTOR_GAIN], used[DAMPING]).row


def is_pinned(last: int, now: Scene) -> bool:
    """Whether in the tick that ends now, after tick `last`, the stance foot alone stood, and the torque is known."""
    stance, swing = now.force[:, 1].tolist()
    return last + 1 == now.tick and is_finite(now.torque) and swing < CONTACT_FORCE <= stance

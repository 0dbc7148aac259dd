"""Online adaptation: the true robot is identified as it walks, and what that changes enters the QP as alpha and beta.

`identification.py` finds what the robot weighs, how its joints are damped and what its motors give;
`joint_calibration.py` where its joints' angles are zero. A second model carries what is found, and the estimates are
the difference of the quantities by this and by the nominal model, as the oracle's are by the plant's own
(`model_error.py`). The policy's are added to them. The angles are corrected before anything is computed from them.
Where the state is predicted (`state_prediction.py`), the identification still learns from the measured one.

The identification uses a tick only if the stance foot was the only one on the ground, and had been for SETTLING ticks.
So it leaves out the tick of a touchdown, flight, a swing foot on the ground, a missing tick, an unknown torque. (A foot
that bounces lands twice.) It forgets nothing when the legs swap: the robot is the same from either leg. An episode
begins with nothing known, and with some ticks in which only the noise of the rates is found (`rate_noise.py`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.model_error import ModelError, error_under
from cbf_clf_qp.tick import Estimator, Pending, Terms
from rabbit_description.state import Array, RobotState

from rl_cbf_clf_controller.generated_model import make_model
from rl_cbf_clf_controller.identification import (
    DAMPING,
    IDENTIFIED,
    LATE_TORQUE,
    MOTOR_GAIN,
    THETA,
    Identification,
)
from rl_cbf_clf_controller.joint_calibration import JointCalibration
from rl_cbf_clf_controller.pinned_robot import PinnedRobot
from rl_cbf_clf_controller.rate_noise import RateNoise
from rl_cbf_clf_controller.scene import Scene, is_finite
from rl_cbf_clf_controller.state_prediction import predicted_state

KNOWN = (*IDENTIFIED, "hip_offset", "knee_offset")  # rad
SETTLING = 2  # ticks on the ground before what is measured counts
PITCH = 2  # its place in q
State = tuple[Array, Array]  # q_s, dq_s
CONTACT_FORCE = 1.0  # N; a foot that carries less is in the air


@dataclass(frozen=True)
class OtherRobot:
    """Estimates by another robot than the nominal one."""

    robot: PinnedRobot

    def at(self, terms: Terms[Scene]) -> Estimates:
        """By how much it differs at a tick."""
        _, dynamics = self.robot.at(terms.scene.q_s, terms.scene.dq_s)
        return error_under(dynamics, terms)


class IdentifiedRobot(Estimator[Scene]):
    """The robot as identified so far."""

    def __init__(self, urdf: str | None = None) -> None:
        self._robot = make_model(urdf)
        self._error = ModelError()
        self._identification = Identification(self._robot.model)
        self._calibration = JointCalibration(self._robot.model)
        self._rate_noise = RateNoise()
        self.reset()

    @property
    def known(self) -> Array:
        """(17,), as in `KNOWN`."""
        return np.concatenate(self.values)

    @property
    def values(self) -> tuple[Array, Array]:
        """What is found of the robot (15,) and of the zeros of its angles (2,)."""
        return self._identification.value, self._calibration.value

    def reset(self) -> None:
        """Begin an episode: the nominal robot."""
        self._identification.reset()
        self._calibration.reset()
        self._rate_noise.reset()
        self._last: Scene | None = None
        self._measured: State | None = None
        self._measured_last: State | None = None
        self._standing = 0  # ticks on end in which the stance foot alone stood
        self._believe()

    def corrected(self, state: RobotState) -> RobotState:
        """The state with its angles set right."""
        return state.with_q(self._calibration.corrected(state.q))

    def predicted(self, q_s: Array, dq_s: Array, torque: Array) -> State:
        """The state in which a torque that is computed from `q_s`, `dq_s` (7,) takes effect, stance/swing order.

        `torque` (4,), N m, acts until then; where it is not known, the state is that of now.
        """
        self._measured = q_s, dq_s
        if not is_finite(torque):
            return q_s, dq_s
        lag = float(self._identification.value[LATE_TORQUE])
        return predicted_state(self._robot.robot_at(q_s, dq_s), q_s, dq_s, torque, lag)

    def estimate(self, terms: Terms[Scene], before: Estimates) -> Estimates:
        """Learn from the tick that ends now; then by how much the robot found differs from the nominal one."""
        return self._error(terms, self._learned(terms.scene).at(terms.scene.q_s, terms.scene.dq_s)[1])

    def pending(self, terms: Terms[Scene], before: Sequence[Pending]) -> Pending:
        """Learn; the robot found, of which the tick's trace computes the rest."""
        return OtherRobot(self._learned(terms.scene))

    def _learned(self, scene: Scene) -> PinnedRobot:
        measured = self._measured or (scene.q_s, scene.dq_s)
        self._learn(scene, measured)
        self._last, self._measured_last, self._measured = scene, measured, None
        return self._robot.robot_at(scene.q_s, scene.dq_s)

    def _learn(self, now: Scene, measured: State) -> None:
        last, before = self._last, self._measured_last
        if last is None or before is None or not is_pinned(last.tick, now):
            self._standing = 0
            self._identification.interrupt()
            self._rate_noise.interrupt()
            return
        self._standing += 1
        if self._standing > SETTLING and is_finite(last.torque):
            self._calibration.learn(*measured)
            self._rate_noise.add(before[1][PITCH], measured[1][PITCH])
            variance = self._rate_noise.variance
            if variance is not None:
                torques = last.torque, now.torque
                self._identification.learn(before, measured, torques, now.force, variance)
            self._believe()

    def _believe(self) -> None:
        found = self._identification.value
        self._robot.believe(found[THETA], found[MOTOR_GAIN], found[DAMPING])


def is_pinned(last: int, now: Scene) -> bool:
    """Whether in the tick that ends now, after tick `last`, the stance foot alone stood, and the torque is known."""
    stance, swing = now.force[:, 1].tolist()
    return last + 1 == now.tick and is_finite(now.torque) and swing < CONTACT_FORCE <= stance

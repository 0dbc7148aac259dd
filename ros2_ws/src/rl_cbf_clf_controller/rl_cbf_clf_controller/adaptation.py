"""Online adaptation: the true robot is identified as it walks, and what that changes enters the QP as alpha and beta.

`identification.py` finds what the robot weighs, how its joints are damped and what its motors give;
`joint_calibration.py` where its joints' angles are zero. A second model carries what is found, and the estimates are
the difference of the quantities by this and by the nominal model, as the oracle's are by the plant's own
(`model_error.py`). The policy's are added to them. The angles are corrected before anything is computed from them.

Learned from are ticks in which the stance foot, and it alone, stood, and had done so for SETTLING ticks: not the tick
of a touchdown, nor flight, a swing foot on the ground, a missing tick, an unknown torque. A foot that bounces lands
twice. Nothing is forgotten when the legs swap: the robot is the same from either leg. An episode begins with nothing
known.
"""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.model_error import model_error
from cbf_clf_qp.tick import Terms
from rabbit_description.state import Array, RobotState

from rl_cbf_clf_controller.generated_model import make_model
from rl_cbf_clf_controller.identification import DAMPING, IDENTIFIED, MOTOR_GAIN, THETA, Identification
from rl_cbf_clf_controller.joint_calibration import JointCalibration
from rl_cbf_clf_controller.scene import Scene

KNOWN = (*IDENTIFIED, "hip_offset", "knee_offset")  # rad
SETTLING = 2  # ticks on the ground before what is measured counts
CONTACT_FORCE = 1.0  # N; a foot that carries less is in the air


@dataclass(frozen=True)
class Measured:
    """What is known of the tick that ends now: `torque` (4,), as applied, N m, stance/swing order, or NaN.

    `force` (2, 2), N: rows stance, swing foot; columns tangential, normal.
    """

    tick: int
    torque: Array
    force: Array


class Adaptation(Protocol):
    """Estimates that are added to the `policy`'s, tick by tick; `known` has a value for each of `KNOWN`, or none."""

    @property
    def known(self) -> Array: ...

    def reset(self) -> None: ...

    def corrected(self, state: RobotState) -> RobotState: ...

    def estimate(self, terms: Terms[Scene], policy: Estimates, measured: Measured) -> Estimates | None: ...


class NoAdaptation:
    """Nothing beside the policy's."""

    known = np.zeros(0)

    def reset(self) -> None:
        """Nothing is kept."""

    def corrected(self, state: RobotState) -> RobotState:
        """`state`."""
        return state

    def estimate(self, terms: Terms[Scene], policy: Estimates, measured: Measured) -> None:
        """None."""


@dataclass(frozen=True)
class Tick:
    """What is kept of a tick: when, (q, dq), and the torque (4,) that led to it, stance/swing order."""

    number: int
    state: tuple[Array, Array]
    torque: Array


class IdentifiedRobot:
    """The robot as identified so far."""

    def __init__(self, urdf: str | None = None) -> None:
        self._robot = make_model(urdf)
        self._identification = Identification(self._robot.model)
        self._calibration = JointCalibration(self._robot.model)
        self.reset()

    @property
    def known(self) -> Array:
        """(17,), as in `KNOWN`."""
        return np.concatenate([self._identification.value, self._calibration.value])

    def reset(self) -> None:
        """Begin an episode: the nominal robot."""
        self._identification.reset()
        self._calibration.reset()
        self._last: Tick | None = None
        self._quiet = 0  # ticks on end of pinned walking
        self._believe()

    def corrected(self, state: RobotState) -> RobotState:
        """The state with its angles set right."""
        return replace(state, q=self._calibration.corrected(state.q))

    def estimate(self, terms: Terms[Scene], policy: Estimates, measured: Measured) -> Estimates:
        """Learn from the tick that ends now; then what the robot found differs from the nominal."""
        scene = terms.scene
        now = Tick(measured.tick, (scene.q_s, scene.dq_s), measured.torque)
        self._learn(now, measured)
        self._last = now
        self._robot.update(scene.q_s, scene.dq_s)
        return model_error(terms, self._robot.pinned())

    def _learn(self, now: Tick, measured: Measured) -> None:
        last = self._last
        if last is None or not is_pinned(last.number, measured):
            self._quiet = 0
            self._identification.interrupt()
            return
        self._quiet += 1
        if self._quiet > SETTLING and np.isfinite(last.torque).all():
            self._calibration.learn(*now.state)
            self._identification.learn(last.state, now.state, (last.torque, measured.torque), measured.force)
            self._believe()

    def _believe(self) -> None:
        found = self._identification.value
        self._robot.believe(found[THETA], found[MOTOR_GAIN], found[DAMPING])


def is_pinned(last: int, measured: Measured) -> bool:
    """Whether in the tick that ends now, after tick `last`, the stance foot alone stood, and the torque is known."""
    stance, swing = measured.force[:, 1]
    return bool(last + 1 == measured.tick and np.isfinite(measured.torque).all() and swing < CONTACT_FORCE <= stance)

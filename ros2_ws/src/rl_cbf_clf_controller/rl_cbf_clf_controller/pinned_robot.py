"""What a model says of a robot that stands on one foot: its feet's kinematics, its dynamics. No model here."""

from dataclasses import dataclass
from typing import Protocol

from cbf_clf_qp.affine import Affine
from rabbit_description.state import Array


@dataclass(frozen=True)
class Kinematics:
    """Swing foot from the stance foot and hip (the base) from the stance foot, world frame; m, m/s, m/s^2.

    `swing`, `swing_rate`, `hip`, `hip_rate` (2,); `swing_jacobian` (2, n); `swing_bias` (2,) its J-dot q-dot.
    """

    swing: Array
    swing_rate: Array
    swing_jacobian: Array
    swing_bias: Array
    hip: Array
    hip_rate: Array


@dataclass(frozen=True)
class PinnedDynamics:
    """`acceleration` (n) and stance-foot `force` (F_T, F_N), both affine in the torque u (m,), stance/swing order."""

    acceleration: Affine
    force: Affine

    @property
    def normal_tangential(self) -> Affine:
        """The force as (F_N, F_T), the order of C1, C2."""
        return Affine(self.force.a[::-1].copy(), self.force.b[::-1].copy())


class PinnedRobot(Protocol):
    """A robot that a trace can ask."""

    def at(self, q_s: Array, dq_s: Array) -> tuple[Kinematics, PinnedDynamics]:
        """At a state `q_s`, `dq_s` (n,), stance/swing order."""


@dataclass(frozen=True)
class KnownRobot:
    """A robot at a state at which all has been computed."""

    feet: Kinematics
    dynamics: PinnedDynamics

    def at(self, q_s: Array, dq_s: Array) -> tuple[Kinematics, PinnedDynamics]:
        """At that state."""
        return self.feet, self.dynamics

"""What is at a joint beside its motor, and between the two: coupling, friction, damping, springs, elastic gears."""

from functools import cached_property
from math import radians, sqrt
from typing import ClassVar

import numpy as np
from rabbit_description.planar_urdf import BASE
from rabbit_description.state import JOINTS, TORQUE_LIMIT, Array

from rabbit_sim.perturbation import Control, EngineNumber, JointTorque, Memory, Number, Perturbation, setting
from rabbit_sim.plant import SUBSTEP_SECONDS

HIPS, KNEES = [0, 2], [1, 3]  # of the joints
IS_KNEE = np.array([0.0, 1.0, 0.0, 1.0])
COGGING_PERIODS = 60  # of a joint's turn
ECCENTRIC_PERIODS = 6  # likewise
DAHL_STIFFNESS = 500.0  # k of `Hysteresis`, N m/rad
STICKING_STIFFNESS, STRIBECK_RATE = 5000.0, 0.1  # of `StickSlip`, N m/rad and rad/s
ROTOR_INERTIA = 0.05  # kg m^2, reflected
GEAR_STIFFNESS = 5000.0  # N m/rad
GEAR_DAMPING_RATIO = 0.2  # of a rotor against a joint that stands still


class DryFriction(Perturbation):
    """Coulomb friction and stiction, which each engine has: read by its plant.

    At rest a joint takes up to so much; sliding it has so much against the motion.
    """

    coulomb: EngineNumber = setting(
        0.0, 0, 100, "dry friction of each joint, with stiction, N m", Control("dry friction", 0.5, "N m")
    )


class JointDamping(Perturbation):
    """Viscous joints: -d M_jj(q) dq_j on actuated joint j.

    So d alone would give the acceleration -d dq_j to a joint free to move, whatever its inertia.
    """

    order = 110

    joint_damping: Number = setting(0.0, 0, 100, "d in the joint torque -d M_jj dq_j, 1/s")

    def joint_torque(self, urdf: str) -> JointTorque:
        import pinocchio  # here alone: parameters are read without it

        model, d = pinocchio.buildModelFromXML(urdf), self.joint_damping
        data = model.createData()

        def torque(q: Array, dq: Array) -> Array:
            inertia: Array = pinocchio.crba(model, data, q).diagonal()[BASE:]
            return -d * inertia * dq[BASE:]

        return torque


class KneeSpring(Perturbation):
    """Springs, k (rest - angle)."""

    order = 100
    switches = ("knee_spring",)

    knee_spring: EngineNumber = setting(
        0.0,
        0,
        1000,
        "stiffness of springs beside the knees' motors, N m/rad",
        Control("knees' springs", 10, "N m/rad", high=200),
    )
    knee_rest: Number = setting(0.4, -1, 2, "angle at which the knees' springs are at rest, rad")

    def joint_torque(self, urdf: str) -> JointTorque:
        stiffness, rest = self.knee_spring * IS_KNEE, self.knee_rest
        return lambda q, dq: stiffness * (rest - q[BASE:])


class CoupledJoints(Perturbation):
    """The knee gets a share of its hip's torque too, as over a belt."""

    order = 504

    joint_coupling: EngineNumber = setting(
        0.0, -1, 1, "share of a hip's torque that its knee gets too", Control("hip pulls at knee", 0.05)
    )

    def transmitted(self, memory: Memory, torque: Array, joints: Array, rates: Array) -> Array:
        coupled: Array = np.array(torque)
        coupled[KNEES] += self.joint_coupling * torque[HIPS]
        return coupled


class FadingMotors(Perturbation):
    """Motors that give less the faster they turn, as a direct-current motor at its voltage's limit does.

    At the rate w a torque along the motion is at most TORQUE_LIMIT (1 - |w| / no_load_speed).
    """

    order = 505

    no_load_speed: EngineNumber = setting(
        0.0,
        0,
        1000,
        "rate at which a motor gives no torque along its motion, rad/s; 0: none",
        Control("no-load speed, 0: none", 1, "rad/s"),
    )

    def transmitted(self, memory: Memory, torque: Array, joints: Array, rates: Array) -> Array:
        most = TORQUE_LIMIT * np.maximum(1 - np.abs(rates) / self.no_load_speed, 0)
        return np.where(torque * rates > 0, torque.clip(-most, most), torque)


class Cogging(Perturbation):
    """A torque -c sin(COGGING_PERIODS angle) on each joint: its magnets pull towards the stator's teeth."""

    order = 506

    cogging: EngineNumber = setting(0.0, 0, 100, "largest cogging torque of a joint, N m", Control("cogging", 1, "N m"))

    def transmitted(self, memory: Memory, torque: Array, joints: Array, rates: Array) -> Array:
        return torque - self.cogging * np.sin(COGGING_PERIODS * joints)


class EccentricGears(Perturbation):
    """Gears whose ratio varies with the joint's angle: the torque is times 1 + e sin(ECCENTRIC_PERIODS angle)."""

    order = 503

    gear_eccentricity: EngineNumber = setting(0.0, 0, 2, "how far a gear's ratio varies, as a share of it")

    def transmitted(self, memory: Memory, torque: Array, joints: Array, rates: Array) -> Array:
        return torque * (1 + self.gear_eccentricity * np.sin(ECCENTRIC_PERIODS * joints))


class SharedSupply(Perturbation):
    """Motors on one battery: together they drive with at most so much power. Braking needs none."""

    order = 507

    supply_power: EngineNumber = setting(0.0, 0, 1e6, "most power that all motors draw together, W; 0: no limit")

    def transmitted(self, memory: Memory, torque: Array, joints: Array, rates: Array) -> Array:
        power = torque * rates
        drawn = power.clip(0).sum()
        return np.where(power > 0, torque * min(self.supply_power / max(drawn, 1e-9), 1), torque)


class LostCommands(Perturbation):
    """A bus that loses a tick's command or not, whatever became of the last; the joints get what they got before.

    An episode begins with no torque.
    """

    order = 508

    command_dropout: EngineNumber = setting(
        0.0, 0, 0.95, "probability that a tick's command is lost", Control("lost commands", 0.01)
    )

    def begin(self, memory: Memory) -> None:
        memory.substep, memory.is_lost, memory.torque = 0, False, np.zeros(JOINTS)

    def transmitted(self, memory: Memory, torque: Array, joints: Array, rates: Array) -> Array:
        if memory.substep % memory.parameters.substeps == 0:
            memory.is_lost = memory.rng.random() < self.command_dropout
        memory.substep += 1
        memory.torque = memory.torque if memory.is_lost else torque
        return memory.torque


class HotMotors(Perturbation):
    """Motors whose torque constant falls as they heat up: the torque is over 1 + a E.

    E is the integral of (torque / TORQUE_LIMIT)^2 since the reset, s. They cool more slowly than anyone walks.
    """

    order = 509

    motor_heating: EngineNumber = setting(
        0.0, 0, 10, "a in a motor's torque over 1 + a E, E its heat, 1/s", Control("motors' heat", 0.05, "1/s", high=2)
    )

    def begin(self, memory: Memory) -> None:
        memory.heat = np.zeros(JOINTS)

    def transmitted(self, memory: Memory, torque: Array, joints: Array, rates: Array) -> Array:
        weakened: Array = torque / (1 + self.motor_heating * memory.heat)
        memory.heat = memory.heat + SUBSTEP_SECONDS * (torque / TORQUE_LIMIT) ** 2
        return weakened


class DahlFriction:
    """What two perturbations share: the friction f of a joint, and F (`most`), which may depend on the rates (4,)."""

    stiffness: ClassVar[float]  # k, N m/rad

    def most(self, rates: Array) -> float | Array:
        """F, N m."""
        raise NotImplementedError

    def begin(self, memory: Memory) -> None:
        memory.friction = np.zeros(JOINTS)

    def transmitted(self, memory: Memory, torque: Array, joints: Array, rates: Array) -> Array:
        most, turned = self.most(rates), SUBSTEP_SECONDS * rates
        end = most * np.sign(turned)
        memory.friction = end + (memory.friction - end) * np.exp(-self.stiffness * np.abs(turned) / most)
        return torque - memory.friction


class Hysteresis(DahlFriction, Perturbation):
    """Joints whose friction depends on where they turned last, by Dahl's model.

    The friction f of a joint that turns by dx goes towards F in its direction:   df = k (1 - f sign(dx) / F) dx
    (P. R. Dahl, "A solid friction model", Aerospace Corporation, 1968). A joint that turns back is pushed by f at
    first.
    """

    order = 510
    stiffness: ClassVar[float] = DAHL_STIFFNESS

    hysteresis: EngineNumber = setting(
        0.0, 0, 100, "most of the joints' friction with memory, N m", Control("hysteresis", 1, "N m")
    )

    def most(self, rates: Array) -> float | Array:
        """See `DahlFriction`."""
        return self.hysteresis


class StickSlip(DahlFriction, Perturbation):
    """Joints that stick and let go: Dahl's friction, stiffer, with an F that falls as the joint turns (R. Stribeck).

    At the rate r it is F (1 + exp(-(r / STRIBECK_RATE)^2)) / 2.
    """

    order = 511
    stiffness: ClassVar[float] = STICKING_STIFFNESS

    stick_slip: EngineNumber = setting(
        0.0, 0, 400, "friction at which a joint breaks away, twice that in motion, N m", Control("stick-slip", 1, "N m")
    )

    def most(self, rates: Array) -> float | Array:
        """See `DahlFriction`."""
        return self.stick_slip * (1 + np.exp(-((rates / STRIBECK_RATE) ** 2))) / 2


class Gears(Perturbation):
    """Elastic gears with play: a rotor of inertia J at each joint drives it through a spring k and a damper c.

    With s = rotor - joint the joint gets k (s -+ b / 2) + c s' outside of the play b, and nothing within it. A tooth
    does not pull; without play the spring does. A rotor begins in the middle of the play, where its joint is, and as
    fast.
    """

    gear_stiffness: EngineNumber = setting(
        0.0,
        0,
        2e4,
        "stiffness of elastic joints, N m/rad; 0: rigid",
        Control("gear stiffness, 0: rigid", 100, "N m/rad"),
    )
    backlash: EngineNumber = setting(
        0.0, 0, 5, "play of each joint's gear from side to side, degrees", Control("backlash", 0.1, "degrees")
    )

    @cached_property
    def _spring(self) -> tuple[float, float, float]:
        """Half the play, rad; k, N m/rad; c, N m s/rad."""
        stiffness = self.gear_stiffness or GEAR_STIFFNESS
        return radians(self.backlash) / 2, stiffness, 2 * GEAR_DAMPING_RATIO * sqrt(stiffness * ROTOR_INERTIA)

    def transmitted(self, memory: Memory, torque: Array, joints: Array, rates: Array) -> Array:
        half, stiffness, damper = self._spring
        slip, slip_rate = memory.joints - joints, memory.rates - rates  # of the rotors, which were there at the reset
        beyond = slip - slip.clip(-half, half)
        passed: Array = stiffness * beyond + damper * slip_rate
        if half:
            side = np.sign(beyond)
            passed = side * np.maximum(side * passed, 0.0)
        memory.rates = memory.rates + SUBSTEP_SECONDS * (torque - passed) / ROTOR_INERTIA
        memory.joints = memory.joints + SUBSTEP_SECONDS * memory.rates
        return passed

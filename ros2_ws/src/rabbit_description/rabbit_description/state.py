"""The layout of the robot's state and what the simulator measures of it at one tick."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from math import atan2, cos, isfinite, nan, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rabbit_description.planar_urdf import BASE, BASE_JOINTS

Array = NDArray[Any]  # float64 unless said otherwise

TICK_SECONDS = 0.01  # s, the paper's T_s: a tick unless `tick_seconds` says otherwise, see `tick.py`
TORQUE_LIMIT = 200.0  # N m at each joint
ROBOT_MASS = 32.0  # kg, nominal

ACTUATED = ("left_hip", "left_knee", "right_hip", "right_knee")
COORDINATES = (*BASE_JOINTS, *ACTUATED)
FEET = ("left", "right")
DOF = len(COORDINATES)  # degrees of freedom: so many numbers have q and dq
JOINTS = len(ACTUATED)  # so many motors, encoders, components of mu and outputs are there
LEG_JOINTS = JOINTS // len(FEET)
SWAP_TORQUE = np.array([2, 3, 0, 1])  # left, right <-> stance, swing when the right leg stands
SWAP_STATE = np.concatenate([np.arange(BASE), BASE + SWAP_TORQUE])


@dataclass(frozen=True)
class RobotLayout:
    """What the arrays of a state and of a torque hold, by name; `has_rates`: whether q' is part of the state."""

    coordinates: tuple[str, ...]
    joints: tuple[str, ...]
    feet: tuple[str, ...] = ()
    has_rates: bool = True

    @property
    def names(self) -> dict[str, list[str]]:
        """The fields of `Episode` that name them."""
        return {name: list(getattr(self, name)) for name in ("coordinates", "joints", "feet")}

    @property
    def lengths(self) -> dict[str, int]:
        """The lengths of a `RobotState`'s arrays."""
        n, feet = len(self.coordinates), len(self.feet)
        return {"q": n, "dq": n, "foot_force": 2 * feet, "contact": feet, "applied": len(self.joints)}


LAYOUT = RobotLayout(COORDINATES, ACTUATED, FEET)


class Leg(IntEnum):
    """Row of a leg in arrays over the feet."""

    LEFT = 0
    RIGHT = 1

    @property
    def other(self) -> "Leg":
        return Leg.LEFT if self is Leg.RIGHT else Leg.RIGHT

    @property
    def joints(self) -> slice:
        """The leg's hip and knee among the coordinates; in stance/swing order the left one's are the stance leg's."""
        hip = BASE + self * LEG_JOINTS
        return slice(hip, hip + LEG_JOINTS)

    @classmethod
    def standing(cls, touchdowns: int) -> "Leg":
        """The stance leg after so many touchdowns: an episode begins on the left one."""
        return cls(touchdowns % 2)


@dataclass(frozen=True)
class StonePreview:
    """Stone `index` (the first is 1), seen one step ahead: `l_k` must end in [l_min, l_max], m from the stance foot.

    `height`: of its top above that of the stone before, m; 0 if heights are not previewed.
    """

    index: int
    l_min: float
    l_max: float
    height: float = 0.0


def newest_preview(previews: Mapping[int, StonePreview], now: int, since: int = 0) -> StonePreview | None:
    """The newest of one stone's previews by stamp, ns, from `since` to `now`.

    The simulator previews a stone at the touchdown before it, so a preview belongs to the first state that needs it: it
    is stamped after the state before, and not after this one.
    """
    stamps = [stamp for stamp in previews if since <= stamp <= now]
    return previews[max(stamps)] if stamps else None


def no_torque() -> Array:
    """NaN (4,): none was applied yet, or it is not known."""
    return np.full(JOINTS, np.nan)


def orientation_of(attitude: float) -> Array:
    """Quaternion of a turn about y by `attitude`, rad: (w, y)."""
    half = attitude / 2 if isfinite(attitude) else nan
    return np.array([cos(half), sin(half)])  # libm's, as C has them


@dataclass(frozen=True)
class BodySensors:
    """What the robot's sensors say at the end of a tick, with their errors.

    `joint_angles`, `joint_rates` (4,): encoders and their drives, `ACTUATED` order; rad, rad/s. The IMU sits in the
    torso at the hip: `orientation` (2,) is the gyro integrated since the reset, w and y of the quaternion; `pitch_rate`
    the gyro, rad/s; `specific_force` (2,) the accelerometer's mean over the tick, torso frame (forward, up), m/s^2; NaN
    at tick 0.
    """

    joint_angles: Array
    joint_rates: Array
    orientation: Array
    pitch_rate: float
    specific_force: Array

    @property
    def attitude(self) -> float:
        """The angle of `orientation`, rad; the same bits in process and through the messages, which carry that."""
        w, y = self.orientation
        return 2 * atan2(y, w)


@dataclass  # not frozen: that would take a tick 3 us
class RobotState:
    """What is measured at one tick, all in the world frame (x forward, z up).

    `q`, `dq` (7,): `COORDINATES`, m and rad. `foot_force` (2, 2), N: rows left, right; columns tangential (+x) and
    normal (+z), averaged over the tick that ended now. `contact` (2,): a foot carried more than 1 N at some
    moment of that tick.
    `touchdowns` counts landings since the reset, so stone `touchdowns + 1` is the one previewed; `preview` is None on
    flat ground. `running` is False once the episode has ended (fall, miss, all stones walked). `applied` (4,), N m,
    left/right order: the command over the tick that ended now, which in real time may be another than the controller's
    last; NaN at tick 0. `sensors`: where only the robot's sensors measure; `q` and `dq` are NaN until a state estimator
    has filled them in.
    A control task's state has arrays of the task's lengths, no feet, and the model's `parameters` at this tick.
    """

    tick: int
    q: Array
    dq: Array
    foot_force: Array
    contact: NDArray[np.bool_]
    touchdowns: int
    preview: StonePreview | None
    running: bool = True
    applied: Array = field(default_factory=no_torque)
    sensors: BodySensors | None = None
    parameters: Array | None = None

    @classmethod
    def of_message(cls, message: Any, preview: StonePreview | None) -> "RobotState":
        """Reads an object with the fields of a `RobotState` message."""
        return cls(
            tick=message.tick,
            q=np.array(message.q),
            dq=np.array(message.dq),
            foot_force=np.array(message.foot_force).reshape(-1, 2),
            contact=np.array(message.contact, dtype=bool),
            touchdowns=message.touchdowns,
            preview=preview,
            running=message.running,
            applied=np.array(message.applied),
        )

    @property
    def joints(self) -> tuple[Array, Array]:
        """Angles and rates (4,) of the joints as measured, rad, rad/s: views, which may be written to."""
        seen = self.sensors
        return (self.q[BASE:], self.dq[BASE:]) if seen is None else (seen.joint_angles, seen.joint_rates)

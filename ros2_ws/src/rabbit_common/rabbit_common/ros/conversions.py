"""Messages to the library's dataclasses and back. What is not finite is refused here.

Numbers travel as float64, so a value arrives with the same bits. An array has the robot's length, which is checked.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import asdict

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, Vector3, Wrench, WrenchStamped
from rabbit_description.state import (
    ACTUATED,
    COORDINATES,
    LAYOUT,
    TICK_SECONDS,
    Array,
    BodySensors,
    RobotLayout,
    RobotState,
    StonePreview,
)
from rabbit_msgs import msg
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Header

from rabbit_common.message_checks import Refused, check_finite, check_lengths, check_state, doubles

WORLD = "world"  # the frame of what the simulator measures
SOLES = ("l_sole", "r_sole")  # the feet's frames, in the order of FEET
NOTHING = np.zeros(0)
LENGTHS = LAYOUT.lengths
LARGEST_SIGMA = 1000.0  # rad/s^2, as the controller's parameter
LATE = "late"  # reason of a refusal
UNIT = 1e-6  # by which a quaternion's norm may be off
UNKNOWN = -1.0  # as the first of a covariance: an `Imu` does not measure that


def header(ticks: int, tick_seconds: float = TICK_SECONDS) -> Header:
    """Simulated time after `ticks` ticks."""
    at = Header(frame_id=WORLD)
    set_time(at, ticks, tick_seconds)
    return at


def set_time(at: Header, ticks: int, tick_seconds: float = TICK_SECONDS) -> None:
    """Have `at` say the time after `ticks` ticks."""
    at.stamp.sec, at.stamp.nanosec = divmod(ticks * round(1e9 * tick_seconds), 1_000_000_000)


def nanoseconds(time: Time) -> int:
    """The nanoseconds of a stamp."""
    return int(time.sec) * 1_000_000_000 + int(time.nanosec)


def state_message(state: RobotState, episode: int, at: Header) -> msg.RobotState:
    """A measured state; the preview travels on another topic."""
    message = msg.RobotState()
    write_state(message, state, episode, at)
    return message


def write_state(message: msg.RobotState, state: RobotState, episode: int, at: Header) -> None:
    """The same into a message that is there: a new one makes more objects than it needs."""
    message.header, message.episode, message.tick = at, episode, state.tick
    message.q, message.dq, message.foot_force = doubles(state.q), doubles(state.dq), doubles(state.foot_force)
    message.contact, message.applied = state.contact.tolist(), doubles(state.applied)
    message.touchdowns, message.previewed, message.running = state.touchdowns, state.preview is not None, state.running


def state_of(
    message: msg.RobotState, preview: StonePreview | None, finite: bool = True, layout: RobotLayout = LAYOUT
) -> RobotState:
    """A checked state from its message and the preview of stone `touchdowns + 1`; None on flat ground."""
    check_state(message, finite, layout)
    return RobotState.of_message(message, preview)


def is_unknown(message: msg.RobotState) -> bool:
    """Whether q and dq are NaN: nobody could estimate them."""
    return all(map(math.isnan, message.q)) and all(map(math.isnan, message.dq))


def preview_message(preview: StonePreview, episode: int, at: Header, sender: str = "") -> msg.StonePreview:
    return msg.StonePreview(header=at, episode=episode, sender=sender, **asdict(preview))


def preview_of(message: msg.StonePreview) -> StonePreview:
    """Raises `Refused`."""
    check_finite("l_min, l_max, height", (message.l_min, message.l_max, message.height))
    if not 0 <= message.l_min < message.l_max:
        raise Refused("no stone", f"l_min = {message.l_min}, l_max = {message.l_max}; expected 0 <= l_min < l_max")
    return StonePreview(message.index, message.l_min, message.l_max, message.height)


def check_episode(message: msg.Episode, after: int, layout: RobotLayout = LAYOUT) -> None:
    """Refuse an announcement of a phase or noise that is none, of another robot, or of an episode before `after`.

    A simulator that begins anew counts from 1 again, see `is_new_simulator`.
    """
    if message.phase > msg.Episode.ENDED:
        raise Refused("no phase", f"phase = {message.phase}; expected 0 to {msg.Episode.ENDED}")
    if not (math.isnan(message.sigma) or 0 <= message.sigma <= LARGEST_SIGMA):
        raise Refused("no noise", f"sigma = {message.sigma}; expected NaN or 0 to {LARGEST_SIGMA} rad/s^2")
    for name, expected in layout.names.items():
        if (got := list(getattr(message, name))) not in ([], expected):
            raise Refused("another robot", f"{name} = {', '.join(got[:8])}; expected {', '.join(expected)}")
    if message.episode < after and not is_new_simulator(message):
        raise Refused(LATE, f"episode {message.episode}; expected {after} or a later one")


class Announcements:
    """Where the simulator stands, as a node needs it that may have been led ahead by an episode that never was.

    Then the true ones are late, for ever. So the second that is late, with no tick between, leads the node back.
    """

    def __init__(self, layout: RobotLayout = LAYOUT) -> None:
        self._late, self._layout = 0, layout

    def went_on(self) -> None:
        """A state came that was next in turn."""
        self._late = 0

    def check(self, message: msg.Episode, present: int) -> bool:
        """Whether what is known is of no use any more; `present`: the episode of the newest state. Raises `Refused`."""
        try:
            check_episode(message, present, self._layout)
        except Refused as error:
            self._late += error.reason == LATE
            if error.reason != LATE or self._late < 2:
                raise
            return True
        return is_new_simulator(message) and present > 0


def is_new_simulator(message: msg.Episode) -> bool:
    """Whether this is the first word of a simulator that knows of none before it."""
    return message.phase == msg.Episode.WAITING and message.episode == 0


def other_tick(message: msg.Episode, seconds: float) -> str:
    """Why a node whose ticks are so many `seconds` apart cannot follow this episode; empty: it can."""
    if message.tick_seconds == seconds:
        return ""
    return f"tick_seconds = {message.tick_seconds:g} of the simulator; this node has {seconds:g}"


def check_plan(message: msg.EpisodePlan, done: Collection[int]) -> None:
    """Refuse a plan of noise that is none, or for another episode than the one after `done`."""
    if not 0 <= message.sigma <= LARGEST_SIGMA:
        raise Refused("no noise", f"sigma = {message.sigma}; expected 0 to {LARGEST_SIGMA} rad/s^2")
    if message.after_episode not in done:
        reason = "late" if message.after_episode < min(done) else "wrong episode"
        raise Refused(reason, f"plan after episode {message.after_episode}; expected {min(done)}")


def torque_of(message: msg.TorqueCommand, joints: int = len(ACTUATED)) -> Array:
    """Torques of so many `joints`, N m."""
    check_lengths(message, {"torque": joints})
    check_finite("torque", message.torque)
    return np.array(message.torque)


def joint_state(state: RobotState, at: Header) -> JointState:
    """Positions, velocities and torques by the URDF's joint names, the planar base's included, which has none."""
    q, dq = doubles(state.q), doubles(state.dq)
    effort = doubles(np.append(np.zeros(3), np.nan_to_num(state.applied)))  # 0 where none was applied yet
    return JointState(header=at, name=list(COORDINATES), position=q, velocity=dq, effort=effort)


def encoder_message(sensors: BodySensors, at: Header, applied: Array = NOTHING) -> JointState:
    """What the four joints' encoders say, and the torques (4,) over the tick, if they are given."""
    angles, rates, effort = doubles(sensors.joint_angles), doubles(sensors.joint_rates), doubles(np.nan_to_num(applied))
    return JointState(header=at, name=list(ACTUATED), position=angles, velocity=rates, effort=effort)


def foot_wrench(force: Array, leg_angle: float, foot: int, at: Header) -> WrenchStamped:
    """The ground's force (2,) on a foot, tangential and normal, N, in its sole; `leg_angle`: of the shin, rad."""
    (x, z), sine, cosine = force.tolist(), math.sin(leg_angle), math.cos(leg_angle)
    turned = Vector3(x=cosine * x - sine * z, z=sine * x + cosine * z)
    return WrenchStamped(header=Header(stamp=at.stamp, frame_id=SOLES[foot]), wrench=Wrench(force=turned))


def joints_of(message: JointState, joints: Sequence[str] = ACTUATED) -> tuple[Array, Array]:
    """Positions and velocities (n,) of these joints, which may come in whatever order, and with others."""
    if missing := [joint for joint in joints if joint not in message.name]:
        raise Refused("other joints", f"name = {message.name[:8]}; expected {', '.join(missing)} among them")
    check_lengths(message, dict.fromkeys(("position", "velocity"), len(message.name)))
    order = [message.name.index(joint) for joint in joints]
    return np.array(message.position)[order], np.array(message.velocity)[order]


def imu_message(sensors: BodySensors, at: Header, variances: Sequence[float]) -> Imu:
    """An IMU in the torso at the hip, which turns about y alone.

    `variances`: of the attitude, rad^2, of the gyro, rad^2/s^2, and of the accelerometer, m^2/s^4.
    """
    w, y = sensors.orientation
    attitude, gyro, accelerometer = variances
    forward, up = sensors.specific_force
    force_variances = (accelerometer, 0.0, accelerometer)
    if np.isnan(sensors.specific_force).any():  # no tick has passed yet
        forward, up, force_variances = 0.0, 0.0, (UNKNOWN, 0.0, 0.0)
    return Imu(
        header=Header(stamp=at.stamp, frame_id="torso"),
        orientation=Quaternion(y=y, w=w),
        orientation_covariance=np.diag((0.0, attitude, 0.0)).ravel(),
        angular_velocity=Vector3(y=sensors.pitch_rate),
        angular_velocity_covariance=np.diag((0.0, gyro, 0.0)).ravel(),
        linear_acceleration=Vector3(x=forward, z=up),
        linear_acceleration_covariance=np.diag(force_variances).ravel(),
    )


def imu_of(message: Imu) -> tuple[Array, float, Array]:
    """Orientation (2,), pitch rate and specific force (2,), NaN if unknown, as in `BodySensors`; else it is refused."""
    turn = message.orientation
    norm = math.hypot(turn.w, turn.y)
    if turn.x or turn.z or abs(norm - 1) > UNIT:
        text = f"orientation (x, y, z, w) = ({turn.x}, {turn.y}, {turn.z}, {turn.w})"
        raise Refused("no turn about y", f"{text}; expected a unit quaternion with x = z = 0")
    force = np.array([message.linear_acceleration.x, message.linear_acceleration.z])
    if message.linear_acceleration_covariance[0] == UNKNOWN:
        force[:] = math.nan
    return np.array([turn.w, turn.y]), message.angular_velocity.y, force

"""Messages to the library's dataclasses and back. What is not finite is refused here.

Numbers travel as float64 in arrays of fixed size, so a value arrives with the same bits.
"""

from array import array

import numpy as np
from builtin_interfaces.msg import Time
from rabbit_description.state import COORDINATES, TICK_SECONDS, Array, RobotState, StonePreview
from rabbit_msgs import msg
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from rabbit_ros.door import Refused, check_finite

_TICK_NS = round(TICK_SECONDS * 1e9)


def stamp(ticks: int) -> Time:
    """Simulated time after `ticks` ticks."""
    seconds, nanoseconds = divmod(ticks * _TICK_NS, 1_000_000_000)
    return Time(sec=seconds, nanosec=nanoseconds)


def state_message(state: RobotState, episode: int, at: Time) -> msg.RabbitState:
    """A measured state as its message; the preview travels on its own topic."""
    return msg.RabbitState(
        stamp=at,
        episode=episode,
        tick=state.tick,
        q=state.q,
        dq=state.dq,
        foot_force=state.foot_force.ravel(),
        contact=state.contact.tolist(),  # of numpy's own booleans rosidl writes False
        applied=state.applied,
        touchdowns=state.touchdowns,
        previewed=state.preview is not None,
        running=state.running,
    )


def state_of(message: msg.RabbitState, preview: StonePreview | None, finite: bool = True) -> RobotState:
    """A state from its message and the preview of stone `touchdowns + 1`; None on flat ground.

    An episode's last state may be anything (`finite` False): the plant may have diverged.
    """
    for name in ("q", "dq", "foot_force") if finite else ():
        check_finite(name, getattr(message, name))
    return RobotState(
        tick=message.tick,
        q=np.array(message.q),
        dq=np.array(message.dq),
        foot_force=np.array(message.foot_force).reshape(2, 2),
        contact=np.array(message.contact, dtype=bool),
        touchdowns=message.touchdowns,
        preview=preview,
        running=message.running,
        applied=np.array(message.applied),
    )


def preview_message(preview: StonePreview, episode: int, at: Time) -> msg.StonePreview:
    """A preview as its message."""
    return msg.StonePreview(stamp=at, episode=episode, index=preview.index, l_min=preview.l_min, l_max=preview.l_max)


def preview_of(message: msg.StonePreview) -> StonePreview:
    """A preview from its message."""
    check_finite("l_min, l_max", (message.l_min, message.l_max))
    if not 0 <= message.l_min < message.l_max:
        raise Refused("no stone", f"l_min = {message.l_min}, l_max = {message.l_max}; expected 0 <= l_min < l_max")
    return StonePreview(message.index, message.l_min, message.l_max)


def torque_of(message: msg.TorqueCommand) -> Array:
    """Torques (4,), N m."""
    check_finite("torque", message.torque)
    return np.array(message.torque)


def joint_state(state: RobotState, at: Time) -> JointState:
    """Positions and velocities under the URDF's joint names, the planar base's among them."""
    position, velocity = array("d", state.q.tobytes()), array("d", state.dq.tobytes())
    return JointState(header=Header(stamp=at), name=list(COORDINATES), position=position, velocity=velocity)

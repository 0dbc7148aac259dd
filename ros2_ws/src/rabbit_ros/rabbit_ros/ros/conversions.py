"""Messages to the library's dataclasses and back. What is not finite is refused here.

Numbers travel as float64 in arrays of fixed size, so a value arrives with the same bits.
"""

import math
from collections.abc import Collection
from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
from builtin_interfaces.msg import Time
from rabbit_description.state import COORDINATES, TICK_NANOSECONDS, Array, RobotState, StonePreview
from rabbit_msgs import msg

from rabbit_ros.message_checks import Refused, check_finite

LARGEST_SIGMA = 1000.0  # rad/s^2, as the controller's parameter


def stamp(ticks: int) -> Time:
    """Simulated time after `ticks` ticks."""
    seconds, nanoseconds = divmod(ticks * TICK_NANOSECONDS, 1_000_000_000)
    return Time(sec=seconds, nanosec=nanoseconds)


def nanoseconds(time: Time) -> int:
    """Of a stamp."""
    return int(time.sec) * 1_000_000_000 + int(time.nanosec)


def state_message(state: RobotState, episode: int, at: Time) -> SimpleNamespace:
    """A measured state with the fields of a `RabbitState`; the preview travels on its own topic."""
    return SimpleNamespace(
        stamp=at,
        episode=episode,
        tick=state.tick,
        q=state.q,
        dq=state.dq,
        foot_force=state.foot_force.ravel(),
        contact=state.contact,
        applied=state.applied,
        touchdowns=state.touchdowns,
        previewed=state.preview is not None,
        running=state.running,
    )


def state_of(message: msg.RabbitState, preview: StonePreview | None, finite: bool = True) -> RobotState:
    """A checked state from its message and the preview of stone `touchdowns + 1`; None on flat ground."""
    check_state(message, finite)
    return RobotState.of_message(message, preview)


def check_state(message: msg.RabbitState, finite: bool = True) -> None:
    """Refuse what is not finite; an episode's last state may be anything (`finite` False): the plant may diverge."""
    for name in ("q", "dq", "foot_force") if finite else ():
        check_finite(name, getattr(message, name))


def preview_message(preview: StonePreview, episode: int, at: Time) -> msg.StonePreview:
    """A preview as its message."""
    return msg.StonePreview(stamp=at, episode=episode, **asdict(preview))


def preview_of(message: msg.StonePreview) -> StonePreview:
    """A preview from its message."""
    check_finite("l_min, l_max, height", (message.l_min, message.l_max, message.height))
    if not 0 <= message.l_min < message.l_max:
        raise Refused("no stone", f"l_min = {message.l_min}, l_max = {message.l_max}; expected 0 <= l_min < l_max")
    return StonePreview(message.index, message.l_min, message.l_max, message.height)


def check_episode(message: msg.Episode, after: int) -> None:
    """Refuse an announcement of a phase or noise that is none, or of an episode before `after`.

    A simulator that begins anew counts from 1 again, see `is_new_simulator`.
    """
    if message.phase > msg.Episode.ENDED:
        raise Refused("no phase", f"phase = {message.phase}; expected 0 to {msg.Episode.ENDED}")
    if not (math.isnan(message.sigma) or 0 <= message.sigma <= LARGEST_SIGMA):
        raise Refused("no noise", f"sigma = {message.sigma}; expected NaN or 0 to {LARGEST_SIGMA} rad/s^2")
    if message.episode < after and not is_new_simulator(message):
        raise Refused("late", f"episode {message.episode}; expected {after} or a later one")


def is_new_simulator(message: msg.Episode) -> bool:
    """Whether this is the first word of a simulator that knows of none before it."""
    return message.phase == msg.Episode.WAITING and message.episode == 0


def check_plan(message: msg.EpisodePlan, done: Collection[int]) -> None:
    """Refuse a plan of noise that is none, or for another episode than the one after `done`."""
    if not 0 <= message.sigma <= LARGEST_SIGMA:
        raise Refused("no noise", f"sigma = {message.sigma}; expected 0 to {LARGEST_SIGMA} rad/s^2")
    if message.after_episode not in done:
        reason = "late" if message.after_episode < min(done) else "wrong episode"
        raise Refused(reason, f"plan after episode {message.after_episode}; expected {min(done)}")


def torque_of(message: msg.TorqueCommand) -> Array:
    """Torques (4,), N m."""
    check_finite("torque", message.torque)
    return np.array(message.torque)


def joint_state(state: RobotState, at: Time) -> SimpleNamespace:
    """The fields of a `JointState`: positions and velocities by the URDF's joint names, the planar base's included."""
    header = SimpleNamespace(stamp=at, frame_id="")
    return SimpleNamespace(header=header, name=COORDINATES, position=state.q, velocity=state.dq, effort=())

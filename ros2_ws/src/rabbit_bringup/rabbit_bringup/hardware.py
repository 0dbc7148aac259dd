"""A robot behind ros2_control as a plant whose physics is the world's, and what keeps it whole.

`Hardware` estimates the state of what the sensors say and sends torques, as far and as fast as they may go. Times are
those of the sensors' clock, in s.
"""

from collections.abc import Callable, Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field
from rabbit_description.state import ACTUATED, DOF, TICK_SECONDS, Array, BodySensors, Leg, RobotState
from rabbit_estimator.contact_aided_filter import ContactAidedFilter
from rabbit_estimator.parameters import EstimatorParameters
from rabbit_sim.kinematics import RabbitFeet
from rabbit_sim.parameters import PlayerParameters
from rabbit_sim.plant import CLEAR_HEIGHT, CONTACT_FORCE, Plant, PlantReading, Span, Touch

from rabbit_bringup.sensor_watch import EncoderWatch

ROUNDING = 1e-6  # N m


class HardwareParameters(PlayerParameters):
    """The parameters of the simulator's node, and what keeps a robot whole."""

    IS_SIMULATED: ClassVar[bool] = False

    episodes: int = Field(1, ge=0, description="walks; a person enables the robot before each")
    trainer: Literal["auto", "ignore", "wait", "follow"] = Field(
        "ignore", description="whether a trainer plans the walks, which includes exploration noise"
    )
    start_paused: bool = Field(True, description="wait for the service `pause` to enable the robot")
    real_time: bool = Field(True, description="nobody waits for a late torque")
    publish_tf: bool = Field(False, description="publish `tf` and `robot_description` beside a robot_state_publisher")
    command_limit: float = Field(200.0, gt=0, le=200, description="largest torque of each joint, N m")
    limit_time: float = Field(0.2, gt=0, le=10, description="a joint at that limit for longer stops the robot, s")
    ramp: float = Field(0.3, gt=0, le=10, description="time over which torques grow from 0 after enabling, s")
    command_rate: float = Field(20e3, gt=0, le=1e6, description="fastest change of a commanded torque, N m/s")
    start_tolerance: float = Field(
        0.15, gt=0, le=3.2, description="farther from the gait's start a joint or the torso is not enabled, rad"
    )
    joint_low: float = Field(-2.5, ge=-6.3, le=0, description="a joint below it stops the robot, rad")
    joint_high: float = Field(2.5, ge=0, le=6.3, description="a joint above it stops the robot, rad")
    joint_rate: float = Field(20.0, gt=0, le=1000, description="a joint that turns faster stops the robot, rad/s")
    stale: float = Field(0.05, gt=0, le=60, description="without the sensors of a new tick for so long it stops, s")
    largest_tick: float = Field(
        0.015, gt=0.01, le=0.1, description="a longer tick by the sensors' stamps stops the robot, s"
    )
    largest_skew: float = Field(0.012, gt=0, le=0.1, description="sensors farther apart in time stop the robot, s")
    frozen_time: float = Field(
        0.045, gt=0, le=10, description="an encoder that says the same for longer while the robot turns stops it, s"
    )


class Hardware(Plant):
    """The robot; `send` gets torques (4,), N m, in the order of ACTUATED.

    `sensors`: the newest, None before the first; `at`: their time, s; `foot_force` (2, 2), in the soles, x and z, N.
    """

    def __init__(
        self, parameters: HardwareParameters, send: Callable[[Array], None], tick_seconds: float = TICK_SECONDS
    ) -> None:
        self._p, self._send, self._tick_seconds = parameters, send, tick_seconds
        self._estimator = ContactAidedFilter(EstimatorParameters(tick_seconds=tick_seconds))
        self._feet = RabbitFeet()
        self.sensors: BodySensors | None = None
        self.at = 0.0
        self.foot_force = np.zeros((2, 2))
        self._asked = self._sent = np.zeros(len(ACTUATED))
        self._sent_at = 0.0

    def reset(self, q: Array, dq: Array, stance: Leg) -> None:
        """The robot is where it is: it stands on its left foot, whose place is x = z = 0 by definition."""
        self._tick, self._clear = -1, [False, False]
        self._ramped_from: float | None = None
        self._observed = self.at
        self._at_limit, self._encoders = np.zeros(len(ACTUATED)), EncoderWatch(self._p.frozen_time)

    def set_stones(self, spans: Sequence[Span]) -> None:
        """They lie where they lie."""

    def push(self, force: float, seconds: float) -> None:
        """Raises `ValueError`: somebody must do it."""
        raise ValueError("push: this robot is pushed by hand")

    def push_for_tick(self, forces: Array) -> None:
        """Nobody does."""

    def close(self) -> None:
        """Leave it without torque."""
        self.stop()

    def command(self, torque: Array) -> None:
        """Send a torque (4,), N m, as far and as fast as it may go by the time of the newest sensors."""
        if self._ramped_from is None:
            # the first one acts over the tick that begins
            self._ramped_from = self._sent_at = self.at - self._tick_seconds
        share = min(1.0, (self.at - self._ramped_from) / self._p.ramp)
        most = self._p.command_rate * (self.at - self._sent_at)
        self._asked = torque
        torque = share * np.clip(torque, -self._p.command_limit, self._p.command_limit)
        self._sent, self._sent_at = np.clip(torque, self._sent - most, self._sent + most), self.at
        self._send(self._sent)

    def stop(self) -> None:
        """No torque."""
        self._asked = self._sent = np.zeros(len(ACTUATED))
        self._sent_at = self.at
        self._send(self._sent)

    def advance(self, command: Array) -> None:
        """A tick has passed. Its answer was sent when it came; what stands in for a missing one is sent now."""
        if not np.array_equal(command, self._asked):
            self.command(command)

    @property
    def fault(self) -> str:
        """Why the robot must stop; empty: it goes on."""
        assert self.sensors is not None
        p, angles, rates = self._p, self.sensors.joint_angles, self.sensors.joint_rates
        beyond = (angles < p.joint_low) | (angles > p.joint_high)
        checks = (
            ("joint limits", beyond, angles, f"rad; expected {p.joint_low:g} to {p.joint_high:g}"),
            ("joint rate", np.abs(rates) > p.joint_rate, rates, f"rad/s; expected at most {p.joint_rate:g}"),
            ("torque limit", self._at_limit > p.limit_time, self._at_limit, f"s; expected at most {p.limit_time:g}"),
            ("frozen encoders", self._encoders.are_frozen, self._encoders.turned, "rad of which they said nothing"),
        )
        for name, wrong, values, words in checks:
            if wrong.any():
                said = (f"{ACTUATED[i]} {values[i]:.3g}" for i in wrong.nonzero()[0])
                return f"{name}: {', '.join(said)} {words}"
        return ""

    def far_from(self, start: Array) -> str:
        """What of the pose is not near a gait's first coordinates `start` (7,); empty: all is."""
        assert self.sensors is not None
        names, said = ("torso", *ACTUATED), [self.sensors.attitude, *self.sensors.joint_angles.tolist()]
        expected, tolerance = start[DOF - len(names) :].tolist(), self._p.start_tolerance
        pairs = zip(names, said, expected, strict=True)
        far = [(name, angle, near) for name, angle, near in pairs if not abs(angle - near) <= tolerance]
        words = ", ".join(f"{name} {angle:.2f} (expected {near:.2f})" for name, angle, near in far)
        return f"not near the gait's start: {words}, +-{tolerance:g} rad" if far else ""

    def observe(self) -> PlantReading:
        """What the sensors say, as the filter understands it."""
        assert self.sensors is not None
        self._tick += 1
        passed, self._observed = min(self.at - self._observed, self._p.largest_tick), self.at
        is_at_limit = np.abs(self._sent) >= self._p.command_limit - ROUNDING
        self._at_limit = np.where(is_at_limit, self._at_limit + passed, 0.0)
        self._encoders.see(self.sensors, passed)
        angles = self.sensors.attitude + self.sensors.joint_angles.reshape(2, 2).sum(axis=1)  # of the shins
        force = np.array([in_world(sole, angle) for sole, angle in zip(self.foot_force, angles, strict=True)])
        contact, unknown = force[:, 1] > CONTACT_FORCE, np.full(DOF, np.nan)
        state = RobotState(self._tick, unknown, unknown, force, contact, 0, None, sensors=self.sensors)
        state = self._estimator.update(state)
        feet = self._feet.positions(state.q)
        return PlantReading(state.q, state.dq, force, feet, contact, tuple(self._touches(feet, contact)))

    def _touches(self, feet: Array, contact: Array) -> list[Touch]:
        """Feet that came down since the last tick, after they had been higher than the other."""
        touches = []
        for leg in Leg:
            if contact[leg] and self._clear[leg]:
                touches.append(Touch(leg, float(feet[leg, 0]), float(feet[leg.other, 0]), hold=True))
            is_high = feet[leg, 1] - feet[leg.other, 1] > CLEAR_HEIGHT
            self._clear[leg] = not contact[leg] and bool(self._clear[leg] or is_high)
        return touches


def in_world(force: Array, angle: float) -> Array:
    """A force (2,) in the sole of a shin that is turned by `angle`, as `conversions.foot_wrench` has it."""
    sine, cosine = np.sin(angle), np.cos(angle)
    return np.array([[cosine, sine], [-sine, cosine]]) @ force

"""A robot behind ros2_control's standard topics, in the simulator's place: the same controller node walks it.

    joint_states                           sensor_msgs/JointState         in, of a joint state broadcaster
    imu                                    sensor_msgs/Imu                in, of an IMU sensor broadcaster
    left_foot/wrench, right_foot/wrench    geometry_msgs/WrenchStamped    in, of force torque sensor broadcasters
    commands                               std_msgs/Float64MultiArray     out, to an effort controller

`Hardware` is a plant whose physics is the world's: it estimates the state of what the sensors say, and sends torques.
The rest is the simulator's node in real time, with the sensors for a clock: episodes, the previews of a course, what
stands in for a late torque, the services. `pause` stops the robot, and enables it again.
"""

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, ClassVar, Literal

import numpy as np
from geometry_msgs.msg import WrenchStamped
from pydantic import Field
from rabbit_common.message_checks import check_finite, doubles
from rabbit_common.ros.conversions import imu_of, joints_of, nanoseconds
from rabbit_common.ros.spin import run
from rabbit_description.state import (
    ACTUATED,
    DOF,
    FEET,
    TICK_NANOSECONDS,
    TICK_SECONDS,
    Array,
    BodySensors,
    Leg,
    RobotState,
)
from rabbit_estimator.contact_aided_filter import ContactAidedFilter, EstimatorError
from rabbit_estimator.parameters import EstimatorParameters
from rabbit_msgs.msg import TorqueCommand
from rabbit_sim.kinematics import RabbitFeet
from rabbit_sim.parameters import NodeParameters
from rabbit_sim.plant import CLEAR_HEIGHT, CONTACT_FORCE, Plant, PlantReading, Span, Touch
from rabbit_sim.ros.node import ERRORS, SimulatorNode
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool

JITTER = 0.1  # of a tick, by which its sensors' stamps may come early


class HardwareParameters(NodeParameters):
    """Those of the simulator's node, and what keeps a robot whole."""

    IS_SIMULATED: ClassVar[bool] = False

    episodes: int = Field(1, ge=0, description="walks; the next one begins where the one before ended")
    trainer: Literal["auto", "ignore", "wait", "follow"] = Field(
        "ignore", description="whether a trainer plans the walks, which includes exploration noise"
    )
    start_paused: bool = Field(True, description="wait for the service `pause` to enable the robot")
    real_time: bool = Field(True, description="nobody waits for a late torque")
    publish_tf: bool = Field(False, description="publish `tf` and `robot_description` beside a robot_state_publisher")
    command_limit: float = Field(200.0, gt=0, le=200, description="largest torque of each joint, N m")
    command_rate: float = Field(50e3, gt=0, le=1e6, description="fastest change of a commanded torque, N m/s")
    joint_low: float = Field(-2.5, ge=-6.3, le=0, description="a joint below it stops the robot, rad")
    joint_high: float = Field(2.5, ge=0, le=6.3, description="a joint above it stops the robot, rad")
    stale: float = Field(0.05, gt=0, le=10, description="without the sensors of a new tick for so long it stops, s")


class Hardware(Plant):
    """The robot; `send` gets torques (4,), N m, in the order of ACTUATED.

    `sensors`: the newest, None before the first; `foot_force` (2, 2), in the soles, x and z, N.
    """

    def __init__(self, parameters: HardwareParameters, send: Callable[[Array], None]) -> None:
        self._p, self._send = parameters, send
        self._estimator, self._feet = ContactAidedFilter(EstimatorParameters()), RabbitFeet()
        self.sensors: BodySensors | None = None
        self.foot_force = np.zeros((2, 2))
        self._asked = self._sent = np.zeros(len(ACTUATED))

    def reset(self, q: Array, dq: Array, stance: Leg) -> None:
        """The robot is where it is: it stands on its left foot, whose place is x = z = 0 by definition."""
        self._tick, self._clear = -1, [False, False]

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
        """Send a torque (4,), N m, as far and as fast as it may go."""
        most = self._p.command_rate * TICK_SECONDS
        torque = np.clip(torque, -self._p.command_limit, self._p.command_limit)
        self._asked, self._sent = torque, np.clip(torque, self._sent - most, self._sent + most)
        self._send(self._sent)

    def stop(self) -> None:
        """No torque."""
        self._asked = self._sent = np.zeros(len(ACTUATED))
        self._send(self._sent)

    def advance(self, command: Array) -> None:
        """A tick has passed. Its answer was sent when it came; what stands in for a missing one is sent now."""
        if not np.array_equal(command, self._asked):
            self.command(command)

    @property
    def fault(self) -> str:
        """Why the robot must stop; empty: it goes on."""
        assert self.sensors is not None
        angles = self.sensors.joint_angles
        is_beyond = (angles < self._p.joint_low) | (angles > self._p.joint_high)
        return f"joint limits: {np.array(ACTUATED)[is_beyond].tolist()}" if is_beyond.any() else ""

    def observe(self) -> PlantReading:
        """What the sensors say, as the filter understands it."""
        assert self.sensors is not None
        self._tick += 1
        angles = self.sensors.attitude + self.sensors.joint_angles.reshape(2, 2).sum(axis=1)  # of the shins
        force = np.array([in_world(*each) for each in zip(self.foot_force, angles, strict=True)])
        contact, unknown = force[:, 1] > CONTACT_FORCE, np.full(DOF, np.nan)
        state = RobotState(self._tick, unknown, unknown, force, contact, 0, None, sensors=self.sensors)
        state = self._estimator.update(state)
        feet = self._feet.positions(state.q)
        return PlantReading(state.q, state.dq, force, feet, contact, tuple(self._touches(feet, contact)))

    def _touches(self, feet: Array, contact: Array) -> list[Touch]:
        """Feet that came down since the last tick, after they had been higher than the other."""
        found = []
        for leg in Leg:
            if contact[leg] and self._clear[leg]:
                found.append(Touch(leg, float(feet[leg, 0]), float(feet[leg.other, 0]), hold=True))
            is_high = feet[leg, 1] - feet[leg.other, 1] > CLEAR_HEIGHT
            self._clear[leg] = not contact[leg] and bool(self._clear[leg] or is_high)
        return found


def in_world(force: Array, angle: float) -> Array:
    """A force (2,) in the sole of a shin that is turned by `angle`, as `conversions.foot_wrench` has it."""
    sine, cosine = np.sin(angle), np.cos(angle)
    turned: Array = np.array([[cosine, sine], [-sine, cosine]]) @ force
    return turned


class HardwareNode(SimulatorNode):
    """The simulator's node with such a plant."""

    PARAMETERS = HardwareParameters
    _own: HardwareParameters

    def __init__(self) -> None:
        super().__init__()
        self._commands = self.create_publisher(Float64MultiArray, "commands", 10)
        simulation = self._player.simulation
        simulation.plant.close()
        send = lambda torque: self._commands.publish(Float64MultiArray(data=doubles(torque)))  # noqa: E731
        simulation.plant = self._robot = Hardware(self._own, send)
        self._stamps = dict.fromkeys(("joint_states", "imu", *FEET), 0)  # of the newest messages, ns
        self._read: dict[str, Any] = {}
        self._ticked, self._sensed = 0, time.monotonic()  # stamp of the newest tick, ns; when it came
        self._hear(JointState, "joint_states", self._on_joints, qos_profile_sensor_data)
        self._hear(Imu, "imu", self._on_imu, qos_profile_sensor_data)
        for foot in FEET:
            self._hear(WrenchStamped, f"{foot}_foot/wrench", partial(self._on_wrench, foot), qos_profile_sensor_data)

    # What comes in

    def _on_joints(self, message: JointState) -> None:
        self._take("joint_states", message, joints_of(message, ACTUATED))

    def _on_imu(self, message: Imu) -> None:
        self._take("imu", message, imu_of(message))

    def _on_wrench(self, foot: str, message: WrenchStamped) -> None:
        self._take(foot, message, (np.array([message.wrench.force.x, message.wrench.force.z]),))

    def _take(self, name: str, message: Any, read: tuple[Any, ...]) -> None:
        """One sensor; once all have said something newer than the last tick, that is the next one."""
        for each in read[:2]:  # the third is the specific force, which may be unknown at first
            check_finite(name, np.ravel(each).tolist())
        self._message_counter.accept(name)
        self._stamps[name], self._read[name] = nanoseconds(message.header.stamp), read
        if min(self._stamps.values()) >= self._ticked + (1 - JITTER) * TICK_NANOSECONDS:
            self._ticked, self._sensed = min(self._stamps.values()), time.monotonic()
            self._robot.sensors = BodySensors(*self._read["joint_states"], *self._read["imu"])
            self._robot.foot_force = np.array([self._read[foot][0] for foot in FEET])
            self._tick()

    def _on_torque(self, message: TorqueCommand) -> None:
        super()._on_torque(message)
        if self._player.torque is not None and not self._paused:
            self._robot.command(self._player.torque)

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if request.data:
            self._player.end("reset", "stopped by the service pause")
        response = super()._on_pause(request, response)
        self._rest()
        return response

    # The tick

    def _set_pace(self, own: NodeParameters) -> None:
        """The sensors set it."""

    def _go_on(self) -> None:
        """As they do."""

    def _tick(self) -> None:
        """The sensors say how the tick has ended."""
        if self._player.state is None or self._paused:
            return
        try:
            if fault := self._robot.fault:
                self._player.end("fault", fault)
            elif self._player.torque is not None:
                self._player.step_answered(self._player.torque)
            elif self._player.step_without_answer():
                self._live_controllers.said_nothing()
        except EstimatorError as error:
            self._player.end("fault", str(error))
        self._rest()

    def _look(self) -> None:
        silent = time.monotonic() - self._sensed
        if self._player.state is not None and silent > self._own.stale:
            self._player.end("fault", f"no sensors for {silent:.3f} s")
        super()._look()
        self._rest()

    def _rest(self) -> None:
        """No torque but in an episode."""
        if self._player.state is None or self._paused:
            self._robot.stop()

    def _answered_by_someone(self) -> bool:
        is_sensed = self._robot.sensors is not None and time.monotonic() - self._sensed < self._own.stale
        return is_sensed and super()._answered_by_someone()


def main() -> None:
    """The executable `ros2_control`."""
    run(HardwareNode, errors=ERRORS)

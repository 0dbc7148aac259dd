"""A robot behind ros2_control's standard topics, in the simulator's place: the same controller node walks it.

    joint_states                           sensor_msgs/JointState         in, of a joint state broadcaster
    imu                                    sensor_msgs/Imu                in, of an IMU sensor broadcaster
    left_foot/wrench, right_foot/wrench    geometry_msgs/WrenchStamped    in, of force torque sensor broadcasters
    stamped_commands                       sensor_msgs/JointState         out, to `command_guard`: `effort`, with the
                                                                          stamp of the sensors that it answers

`Hardware` is the plant. The rest is the simulator's node in real time, with the sensors for a clock: episodes, the
previews of a course, what stands in for a late torque, the services. `pause` stops the robot, and enables it for one
walk.
"""

import time
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rabbit_common.message_checks import check_finite, doubles
from rabbit_common.ros.conversions import imu_of, joints_of, nanoseconds
from rabbit_common.ros.spin import run
from rabbit_description.gait import load_gaits
from rabbit_description.state import ACTUATED, FEET, Array, BodySensors
from rabbit_estimator.contact_aided_filter import EstimatorError
from rabbit_msgs.msg import TorqueCommand
from rabbit_msgs.srv import ResetEpisode
from rabbit_sim.parameters import PlayerParameters
from rabbit_sim.ros.node import ERRORS, SimulatorNode
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu, JointState
from std_srvs.srv import SetBool

from rabbit_bringup.hardware import Hardware, HardwareParameters
from rabbit_bringup.sensor_watch import SECOND, SensorClock

SENSORS = ("joint_states", "imu", *FEET)
SENSOR = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)


class HardwareNode(SimulatorNode):
    """The simulator's node with such a plant."""

    NAME = "ros2_control"
    PARAMETERS = HardwareParameters
    _p: HardwareParameters

    def __init__(self) -> None:
        super().__init__()
        self._commands = self.create_publisher(JointState, "stamped_commands", 10)
        simulation = self.rabbit
        simulation.plant.close()
        simulation.plant = self._robot = Hardware(self._p, self._send, simulation.parameters.tick_seconds)
        self._start, _ = load_gaits(self._p.gait).x_start
        limits = self._p.largest_tick, self._p.largest_skew
        self._sensors = SensorClock(SENSORS, *limits, simulation.parameters.tick_seconds)
        self._read: dict[str, Any] = {}
        self._sensed = time.monotonic()  # when the newest tick came
        self._done = self._player.episode.episode  # the walk that is over
        self._hear(JointState, "joint_states", self._on_joints, SENSOR)
        self._hear(Imu, "imu", self._on_imu, SENSOR)
        for foot in FEET:
            self._hear(WrenchStamped, f"{foot}_foot/wrench", partial(self._on_wrench, foot), SENSOR)

    # What comes in

    def _on_fault(self, reason: str) -> None:
        super()._on_fault(reason)
        self._rest()

    def _on_joints(self, message: JointState) -> None:
        self._take("joint_states", message, joints_of(message))

    def _on_imu(self, message: Imu) -> None:
        self._take("imu", message, imu_of(message))

    def _on_wrench(self, foot: str, message: WrenchStamped) -> None:
        self._take(foot, message, (np.array([message.wrench.force.x, message.wrench.force.z]),))

    def _take(self, name: str, message: Any, read: Sequence[Any]) -> None:
        """One sensor; once all have said something newer than the last tick, that is the next one."""
        for values in read[:2]:  # the third is the specific force, which may be unknown at first
            check_finite(name, np.ravel(values).tolist())
        self._message_counter.accept(name)
        self._end_if_silent()  # this process may have stood still
        self._read[name] = read
        if not self._sensors.take(name, nanoseconds(message.header.stamp)):
            return
        if self._sensors.ticked:
            self._sensed = time.monotonic()
            self._robot.at = self._sensors.ticked / SECOND
            self._robot.sensors = BodySensors(*self._read["joint_states"], *self._read["imu"])
            self._robot.foot_force = np.array([self._read[foot][0] for foot in FEET])
        self._tick()

    def _on_torque(self, message: TorqueCommand) -> None:
        self._end_if_silent()
        super()._on_torque(message)
        if self._player.torque is not None and not self._paused:
            self._robot.command(self._player.torque)

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if request.data:
            self._player.end("reset", "stopped by the service pause")
        elif unfit := self._unfit():
            response.message = unfit
            return response
        response = super()._on_pause(request, response)
        self._rest()
        return response

    def _on_reset(self, request: ResetEpisode.Request, response: ResetEpisode.Response) -> ResetEpisode.Response:
        response.message = "a robot is not reset: the service pause enables it for one walk"
        return response

    # The tick

    def _set_pace(self, parameters: PlayerParameters) -> None:
        """The sensors set it."""

    def _go_on(self) -> None:
        """Does nothing: the sensors set when a tick ends."""

    def _tick(self) -> None:
        """The sensors say how the tick has ended."""
        if self._player.state is None or self._paused:
            return
        try:
            is_hanging = self._player.state.tick == 0 and self._player.torque is None  # nothing moves it yet
            if fault := ("" if is_hanging else self._sensors.fault) or self._robot.fault:
                self._player.end("fault", fault)
            elif self._player.torque is not None:
                self._player.step(self._player.torque)
            elif self._player.step_without_answer():
                self._live_controllers.said_nothing()
        except EstimatorError as error:
            self._player.end("fault", str(error))
        self._rest()

    def _look(self) -> None:
        self._end_if_silent()
        super()._look()
        self._rest()

    def _end_if_silent(self) -> None:
        """What the sensors said is old, be it that they or that this process stood still."""
        silent = time.monotonic() - self._sensed
        if self._player.state is not None and silent > self._p.stale:
            self._player.end("fault", f"no sensors for {silent:.3f} s: {self._sensors}")
            self._rest()

    def _rest(self) -> None:
        """The robot gets torque in an episode alone. A person enables it before each one."""
        if self._player.state is None and self._player.episode.episode > self._done:
            self._done, self._paused = self._player.episode.episode, True
        if self._player.state is None or self._paused:
            self._robot.stop()

    def _send(self, torque: Array) -> None:
        seconds, nanoseconds = divmod(self._sensors.ticked, SECOND)
        message = JointState(name=list(ACTUATED), effort=doubles(torque))
        message.header.stamp.sec, message.header.stamp.nanosec = seconds, nanoseconds
        self._commands.publish(message)

    # Whether it may begin

    def _begin_next(self) -> None:
        if not self._answered_by_someone():
            return
        if unfit := self._unfit():  # it was fit when it was enabled
            self._paused = True
            self.get_logger().error(f"the robot is not enabled any more: {unfit}")
            return
        super()._begin_next()
        if self._player.state is not None:
            self._sensed = time.monotonic()  # to begin took a while, and nothing is commanded yet

    def _unfit(self) -> str:
        """Why the robot cannot be enabled; empty: it can."""
        if self._others.refusal:
            return self._others.refusal
        if self._robot.sensors is None or time.monotonic() - self._sensed > self._p.stale:
            return f"no sensors: {self._sensors}"
        if not self._commands.get_subscription_count():
            return "nobody hears stamped_commands: expected a command_guard"
        return self._sensors.fault or self._robot.far_from(self._start)

    def _answered_by_someone(self) -> bool:
        is_sensed = self._robot.sensors is not None and time.monotonic() - self._sensed < self._p.stale
        return is_sensed and super()._answered_by_someone()


def main() -> None:
    """The executable `ros2_control`."""
    run(HardwareNode, errors=ERRORS)

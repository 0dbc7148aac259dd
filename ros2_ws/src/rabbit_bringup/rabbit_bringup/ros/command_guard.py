"""A small process between the bridge and the motors, which outlives the bridge and the controller.

stamped_commands    sensor_msgs/JointState        in, of the bridge `ros2_control`: torques, with the sensors' stamp
joint_states        sensor_msgs/JointState        in, of a joint state broadcaster: what time it is for the sensors
commands            std_msgs/Float64MultiArray    out, to an effort controller, also where nothing comes in
"""

import time

import numpy as np
from rabbit_common.message_checks import Refused, check_finite, check_lengths, doubles
from rabbit_common.priority import take_priority
from rabbit_common.ros.checked_node import CheckedNode
from rabbit_common.ros.conversions import joints_of, nanoseconds
from rabbit_common.ros.diagnostics import ERROR, OK, Diagnostics, Status
from rabbit_common.ros.parameters import declare, refuse_unknown
from rabbit_common.ros.spin import run, steady_timer
from rabbit_description.state import ACTUATED
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from rabbit_bringup.command_guard import CommandGuard, GuardParameters

LOOK_SECONDS = 0.01


class CommandGuardNode(CheckedNode):
    """Hands on what is new, and else zeros."""

    def __init__(self) -> None:
        super().__init__("command_guard")
        parameters = declare(self, GuardParameters)
        refuse_unknown(self)
        take_priority(parameters.priority, self.get_logger().warning)
        self._guard, self._said = CommandGuard(parameters), ""
        self._commands = self.create_publisher(Float64MultiArray, "commands", 10)
        self._masters = self._hear(JointState, "stamped_commands", self._on_command, QoSProfile(depth=10))
        self._hear(JointState, "joint_states", self._on_joints, qos_profile_sensor_data)
        self._diagnostics = Diagnostics(self, self._message_counter, self._status)
        steady_timer(self, LOOK_SECONDS, self._look)
        self.get_logger().info("ready: no torque until a command of zero has come")

    def close(self) -> None:
        """Leave the robot without torque."""
        self._commands.publish(Float64MultiArray(data=[0.0] * len(ACTUATED)))

    def _on_joints(self, message: JointState) -> None:
        joints_of(message)  # a gripper's, on the same topic, do not say that the robot's still come
        self._guard.sense(nanoseconds(message.header.stamp), time.monotonic())

    def _on_command(self, message: JointState) -> None:
        if tuple(message.name) != ACTUATED:
            raise Refused("other joints", f"name = {list(message.name)[:8]}; expected {', '.join(ACTUATED)}")
        check_lengths(message, {"effort": len(ACTUATED)})
        check_finite("effort", message.effort)
        if not self._guard.alone(self._masters.get_publisher_count()):
            raise Refused("several masters", self._guard.fault)
        self._message_counter.accept("stamped_commands")
        self._guard.command(np.array(message.effort), nanoseconds(message.header.stamp), time.monotonic())
        self._send()

    def _look(self) -> None:
        self._guard.look(time.monotonic())
        self._guard.alone(self._masters.get_publisher_count())
        if not self._guard.acts.any():
            self._send()

    def _send(self) -> None:
        self._commands.publish(Float64MultiArray(data=doubles(self._guard.acts)))
        if self._guard.fault not in ("", self._said):
            self.get_logger().error(f"no torque: {self._guard.fault}")
        self._said = self._guard.fault

    def _status(self) -> Status:
        fault, figures = self._guard.fault, {"passes commands": not self._guard.fault}
        return (ERROR, f"no torque: {fault}", figures) if fault else (OK, "passes commands", figures)


def main() -> None:
    """The executable `command_guard`."""
    run(CommandGuardNode)

"""The controller of a task before a robot: it answers the states that the robot's drivers say.

    joint_states   sensor_msgs/JointState       in, by the names of the task's coordinates; or
    odom           nav_msgs/Odometry            in, of coordinates x, y, yaw
    parameters     rabbit_msgs/TaskParameters   in, where the task has commands: an obstacle, a goal
    wanted         std_msgs/Float64MultiArray   in, of a teleoperator, if `filters`
    commands       std_msgs/Float64MultiArray   out, in the order of the task's inputs; or
    cmd_vel        geometry_msgs/Twist          out, of inputs linear_x, linear_y, angular_z

It begins paused: the service `pause` enables the robot. Where states or parameters fall silent it sends zeros, and is
paused again.
"""

import math
import secrets
import time
from typing import Literal

import numpy as np
from cbf_clf_qp.functions import Array
from geometry_msgs.msg import Quaternion, Twist
from nav_msgs.msg import Odometry
from pydantic import Field
from rabbit_common.guard import reason_of
from rabbit_common.message_checks import array_of, check_finite, doubles
from rabbit_common.priority import take_priority
from rabbit_common.ros.checked_node import CheckedNode
from rabbit_common.ros.conversions import joints_of
from rabbit_common.ros.diagnostics import ERROR, OK, WARN, Diagnostics, Status
from rabbit_common.ros.parameters import declare, refuse_unknown
from rabbit_common.ros.qos import TICK
from rabbit_common.ros.spin import run, steady_timer
from rabbit_common.task_messages import parameters_of
from rabbit_description import ABOUT_TASK
from rabbit_description.task import TaskError
from rabbit_description.task_source import load_task
from rabbit_description.task_state import task_state
from rabbit_msgs.msg import ControllerState, LearnerTerms, TaskParameters
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header
from std_srvs.srv import SetBool

from rl_cbf_clf_controller.filtering import filtering
from rl_cbf_clf_controller.ros import policies
from rl_cbf_clf_controller.ros.answerers import TaskAnswerer
from rl_cbf_clf_controller.weights import PolicyFileError

LOOK_SECONDS = 0.02
POSE = ("x", "y", "yaw")
TWIST = ("linear_x", "linear_y", "angular_z")
NOT_MEASURED = np.zeros(0)


class RobotParameters(policies.NodeParameters):
    """The parameters of a task's controller, and what the robot speaks."""

    task: str = Field("", description=ABOUT_TASK)
    input: Literal["joint_states", "odom"] = Field("joint_states", description="what says the state")
    output: Literal["commands", "cmd_vel"] = Field("commands", description="what the robot hears")
    filters: bool = Field(False, description="answer with the input that is nearest to `wanted`")
    start_paused: bool = Field(True, description="wait for the service `pause` to enable the robot")
    stale: float = Field(0.1, gt=0, le=10, description="s without a state, after which it is paused")
    stale_parameters: float = Field(0.5, gt=0, le=3600, description="s without `parameters`, likewise")
    stale_wanted: float = Field(0.5, gt=0, le=3600, description="s without `wanted`, after which zeros are wanted")


class RobotControllerNode(CheckedNode):
    """Answers sensors with commands."""

    def __init__(self) -> None:
        super().__init__("controller")
        self._sender = f"{self.get_fully_qualified_name()} {secrets.token_hex(8)}"[-128:]
        self._settings = p = declare(self, RobotParameters)
        refuse_unknown(self)
        take_priority(p.priority, self.get_logger().warning)
        self.task = task = load_task(p.task)
        sensed, told = p.input == "joint_states", p.output == "commands"
        if not sensed and not set(task.names_of_q) <= set(POSE):
            raise TaskError(f"coordinates = {task.names_of_q}: expected some of {POSE} where odom says the state")
        if not told and not set(task.names_of_u) <= set(TWIST):
            raise TaskError(f"inputs = {task.names_of_u}: expected some of {TWIST} for cmd_vel")
        self._answerer = answerer = TaskAnswerer(filtering(task) if p.filters else task, p.policy)
        self._policies = policies.Policies(self, p, answerer.built_in, answerer.fit, self._sender, self._take_policies)
        answerer.follow(self._policies.in_force.policy)
        self.close = self._policies.close
        self._paused, self._fault, self._ticks = p.start_paused, "", 0
        self._wanted = np.zeros(len(task.names_of_u))
        self._p = None if task.commanded else task.parameters_at({}, {})
        self._came = dict.fromkeys(("state", "parameters", "wanted"), -math.inf)  # when, s by the steady clock
        self._commands = self.create_publisher(*((Float64MultiArray, "commands") if told else (Twist, "cmd_vel")), 10)
        if sensed:
            self._hear(JointState, "joint_states", self._on_joints, qos_profile_sensor_data)
        else:
            self._hear(Odometry, "odom", self._on_odometry, qos_profile_sensor_data)
        if task.commanded:
            self._hear(TaskParameters, "parameters", self._on_parameters, TICK)
        if p.filters:
            self._hear(Float64MultiArray, "wanted", self._on_wanted, qos_profile_sensor_data)
        self.create_service(SetBool, "pause", self._on_pause)
        self._details = self.create_publisher(ControllerState, "controller_state", TICK)
        self._terms = self.create_publisher(LearnerTerms, "learner_terms", TICK)
        self._diagnostics = Diagnostics(self, self._message_counter, self._status)
        steady_timer(self, LOOK_SECONDS, self._look)
        self.get_logger().info(f"ready: task {task.name}, policy {self._policies.in_force.version}")

    # What comes in

    def _on_fault(self, reason: str) -> None:
        self._stop(reason)

    def _on_joints(self, message: JointState) -> None:
        self._take(message.header, *joints_of(message, self.task.names_of_q))

    def _on_odometry(self, message: Odometry) -> None:
        """Takes the base's state in the world; the message has the twist in the robot's frame."""
        pose, twist = message.pose.pose, message.twist.twist
        yaw = yaw_of(pose.orientation)
        forward, left = twist.linear.x, twist.linear.y
        q = {"x": pose.position.x, "y": pose.position.y, "yaw": yaw}
        dq = {
            "x": math.cos(yaw) * forward - math.sin(yaw) * left,
            "y": math.sin(yaw) * forward + math.cos(yaw) * left,
            "yaw": twist.angular.z,
        }
        names = self.task.names_of_q
        self._take(message.header, np.array([q[name] for name in names]), np.array([dq[name] for name in names]))

    def _on_parameters(self, message: TaskParameters) -> None:
        self._p = parameters_of(self.task, message)
        self._heard("parameters")

    def _on_wanted(self, message: Float64MultiArray) -> None:
        wanted = array_of(message, "data", len(self._wanted))
        check_finite("wanted", wanted.tolist())
        self._wanted = wanted
        self._heard("wanted")

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if not request.data and (missing := self._missing()):
            response.message = missing
            return response
        self._paused, self._fault, response.success = request.data, "", True
        self._ticks += bool(self._ticks)  # so that nothing is measured from the last tick before the pause
        self._send(np.zeros_like(self._wanted))
        return response

    def _heard(self, name: str) -> None:
        self._came[name] = time.monotonic()
        self._message_counter.accept(name)

    # The tick

    def _take(self, header: Header, q: Array, dq: Array) -> None:
        """A state; answered at once."""
        x = np.concatenate([q, dq])[: self.task.system.x.numel()]
        check_finite(self._settings.input, x.tolist())
        self._heard("state")
        self._take_policies()
        if self._paused or self._missing():
            return
        p, wanted = self._p, self._wanted
        assert p is not None
        if self._settings.filters:
            is_stale = time.monotonic() - self._came["wanted"] > self._settings.stale_wanted
            p = np.append(p, np.zeros_like(wanted) if is_stale else wanted)
        if policy := self._policies.swap((1, self._ticks), ""):
            self._answerer.follow(policy)
        try:
            acted = self._answerer.act(task_state(self.task, x, p, NOT_MEASURED, self._ticks))
        except Exception as error:  # the task is a user's
            self._stop(reason_of(error))
            return
        if acted.fault:
            self._stop(acted.fault)
            return
        self._send(acted.torque)
        head = {"header": header, "episode": 1, "tick": self._ticks, "sender": self._sender}
        if self._details.get_subscription_count():
            self._details.publish(ControllerState(**head, **self._answerer.state_fields()))
        if self._terms.get_subscription_count() and (terms := self._answerer.terms_fields()):
            self._terms.publish(LearnerTerms(**head, **terms))
        self._ticks += 1

    def _take_policies(self) -> None:
        self._policies.take((1, self._ticks), self._message_counter.accept, self._refuse)

    def _send(self, u: Array) -> None:
        if self._settings.output == "commands":
            self._commands.publish(Float64MultiArray(data=doubles(u)))
            return
        twist = Twist()
        for name, value in zip(self.task.names_of_u, u.tolist(), strict=True):
            part, axis = name.split("_")
            setattr(getattr(twist, part), axis, value)
        self._commands.publish(twist)

    def _look(self) -> None:
        """No command but what the newest states ask for."""
        if not self._paused and (missing := self._missing()):
            self._stop(missing)
        if self._paused:
            self._send(np.zeros_like(self._wanted))

    def _stop(self, reason: str) -> None:
        self._paused, self._fault = True, reason
        self._send(np.zeros_like(self._wanted))
        self.get_logger().error(f"paused: {reason}")

    def _missing(self) -> str:
        """What is too old; empty: nothing."""
        limits = {"state": self._settings.stale}
        if self.task.commanded:
            limits["parameters"] = self._settings.stale_parameters
        for name, limit in limits.items():
            if (silent := time.monotonic() - self._came[name]) > limit:
                return f"no {name} for {silent:.3f} s" if math.isfinite(silent) else f"no {name} yet"
        return ""

    def _status(self) -> Status:
        figures = {"policy": self._policies.in_force.version, "paused": self._paused, "ticks": self._ticks}
        if self._fault:
            return ERROR, f"paused: {self._fault}", figures
        if missing := self._missing():
            return WARN, missing, figures
        return OK, "paused" if self._paused else "commands the robot", figures


def yaw_of(o: Quaternion) -> float:
    """The turn about z, rad; NaN where the numbers are too large."""
    return math.atan2(2 * (o.w * o.z + o.x * o.y), 1 - 2 * (o.y * o.y + o.z * o.z))  # `**` would raise OverflowError


def main() -> None:
    """The executable `robot_controller`."""
    run(RobotControllerNode, errors=(TaskError, PolicyFileError))

"""A robot behind ros2_control's topics that is a task's true system, and who teleoperates it, in one process.

The teleoperator pulls the joints to postures, a new one every `held` ticks, at random. Time goes on with each command:
states, parameters and what is wanted go out together, and the newest answer acts. As it ends it prints how near the
first barrier came to 0, also had every wish been granted, and how long answers took, ms.
"""

import json
import sys
import time

import numpy as np
import rclpy
from rabbit_common.message_checks import doubles
from rabbit_common.ros.qos import TICK
from rabbit_common.task_messages import parameter_fields
from rabbit_description.task_source import load_task
from rabbit_msgs.msg import TaskParameters
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

LOW, HIGH = (-1.2, 0.3), (0.6, 2.0)  # of postures, rad
STIFFNESS, DAMPING = 60.0, 12.0  # N m/rad, N m s/rad


class Arm:
    """`x`: its state at tick `k`; `least`: the first barrier's least value so far."""

    def __init__(self, task, seed, commands, held):
        self.task, self.held, self.count = task, held, commands * held
        self.x, self.commands, _ = task.beginning(seed)
        self.rng, self.k, self.least = np.random.default_rng(seed), 0, np.inf

    def wish(self):
        """Torques (m,) to the posture, a new one every `held` ticks."""
        if self.k % self.held == 0:
            self.posture = self.rng.uniform(LOW, HIGH)
        torques = STIFFNESS * (self.posture - self.x[:2]) - DAMPING * self.x[2:]
        return torques.clip(-self.task.limit, self.task.limit)

    def p(self, of_plant):
        """At this tick."""
        return self.task.parameters_at(of_plant, self.commands(self.k * self.task.seconds, 0))

    def step(self, u):
        """A tick."""
        true = self.p(self.task.true)
        self.least = min(self.least, float(self.task.tick.look(self.x, true).barriers[0]))
        self.x, self.k = self.task.moved(self.x, true, u).x, self.k + 1

    @property
    def is_over(self):
        """After its last tick."""
        return self.k >= self.count


class Drivers:
    """The arm's topics; `ages`: of the answers, s. It hangs still until the first command that is not zero."""

    def __init__(self, node, arm):
        self.arm, self.ages, self.has_begun = arm, [], False
        self.states = node.create_publisher(JointState, "joint_states", qos_profile_sensor_data)
        self.parameters = node.create_publisher(TaskParameters, "parameters", TICK)
        self.wanted = node.create_publisher(Float64MultiArray, "wanted", qos_profile_sensor_data)
        node.create_subscription(Float64MultiArray, "commands", self.on_command, 10)
        node.create_timer(0.05, self.repeat)
        self.speak()

    def on_command(self, message):
        u = np.array(message.data)
        self.has_begun |= bool(u.any())
        if self.has_begun and not self.arm.is_over:
            self.ages.append(time.monotonic() - self.sent)
            self.arm.step(u)
            self.speak()

    def speak(self):
        self.wish = self.arm.wish()
        self.publish()

    def repeat(self):
        """Sensors are best effort: what was lost is said again."""
        if time.monotonic() - self.sent > 0.2 or not self.has_begun:
            self.publish()

    def publish(self):
        arm, self.sent = self.arm, time.monotonic()
        self.parameters.publish(TaskParameters(tick=arm.k, **parameter_fields(arm.task, arm.p({}))))
        self.wanted.publish(Float64MultiArray(data=doubles(self.wish)))
        q, dq = arm.x[:2][::-1], arm.x[2:][::-1]  # a broadcaster has an order of its own
        names = list(arm.task.coordinates[::-1])
        self.states.publish(JointState(name=names, position=doubles(q), velocity=doubles(dq)))


def main():
    asked = json.loads(sys.argv[1])
    how = (load_task(asked["task"]), asked["seed"], asked["commands"], asked["held"])
    alone, arm = Arm(*how), Arm(*how)
    while not alone.is_over:
        alone.step(alone.wish())
    rclpy.init()
    node = rclpy.create_node("arm")
    drivers = Drivers(node, arm)
    while not arm.is_over:
        rclpy.spin_once(node, timeout_sec=0.1)
    ages = (1e3 * np.percentile(drivers.ages, (50, 99))).round(2).tolist()
    said = {"ticks": arm.k, "least": arm.least, "unfiltered": alone.least}
    print(json.dumps({**said, "added_ms": dict(zip(("median", "p99"), ages, strict=True))}), flush=True)


if __name__ == "__main__":
    main()

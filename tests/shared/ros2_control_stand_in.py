"""A robot in a physics engine that speaks ros2_control's standard topics, as one in `mujoco_ros2_control` does.

It hangs still in the first state of a walk until it is commanded; then its clock runs, whoever answers, and the newest
command acts, for as long as its drives hear one. As it ends it prints how it went.
"""

import json
import sys
import time
from dataclasses import replace

import numpy as np
import rclpy
from geometry_msgs.msg import WrenchStamped
from rabbit_common.ros.conversions import encoder_message, foot_wrench, header, imu_message
from rabbit_description.gait import load_gaits
from rabbit_description.state import TICK_SECONDS, Leg
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Simulation
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64MultiArray

VARIANCES = (1e-5, 1e-5, 1e-2)
HUNG_TICKS = 20  # of the wall clock, from one word of a robot that hangs and waits to the next


class StandIn:
    """Runs at `pace` times real time. `waits`: for a command to each tick; `timeout`: of its drives, s.

    From tick `wrong_from` on, if that is not 0, its sensors are `wrong`: silent, back or frozen.
    """

    def __init__(self, node, plant, gait, seed, pace, waits, timeout, wrong, wrong_from):
        self.wrong, self.wrong_from, self.waits, self.waited = wrong, wrong_from, waits, 0
        self.timeout, self.commanded, self.answered = timeout, time.monotonic(), (None, np.zeros(4))
        self.simulation = Simulation(plant, load_gaits(gait))
        self.state = self.simulation.reset(seed)
        self.torque, self.last, self.clock = np.zeros(4), np.zeros(4), 1
        self.joints = node.create_publisher(JointState, "joint_states", qos_profile_sensor_data)
        self.imu = node.create_publisher(Imu, "imu", qos_profile_sensor_data)
        names = [f"{foot}_foot/wrench" for foot in ("left", "right")]
        self.feet = [node.create_publisher(WrenchStamped, name, qos_profile_sensor_data) for name in names]
        node.create_subscription(Float64MultiArray, "commands", self.on_command, 10)
        node.create_subscription(JointState, "stamped_commands", self.on_stamped, 10)  # says which tick is answered
        node.create_timer(TICK_SECONDS / pace, self.tick)

    def on_command(self, message):
        self.torque, self.commanded = np.array(message.data), time.monotonic()

    def on_stamped(self, message):
        self.answered = message.header.stamp, np.array(message.effort)

    def is_answered(self):
        """Whether the torque that acts answers the newest sensors."""
        stamp, torque = self.answered
        return stamp == header(self.clock).stamp and np.array_equal(torque, self.torque)

    def tick(self):
        if time.monotonic() - self.commanded > self.timeout:
            self.torque = np.zeros(4)
        hangs = not (self.torque.any() or self.state.tick)
        self.waited += 1
        if self.waits and (self.waited < HUNG_TICKS if hangs else not self.is_answered()):
            return
        self.waited = 0
        if self.state.running and not hangs:
            self.last = self.torque
            self.state = self.simulation.step(self.torque)
        wrong = self.wrong if 0 < self.wrong_from < self.state.tick else ""
        self.clock += 1
        if wrong != "silent":
            self.speak(wrong)

    def speak(self, wrong):
        at, truth = header(self.clock), self.simulation.reading.q
        sensors = self.state.sensors
        if not self.state.tick:  # it hangs: its accelerometer feels its weight
            felt = 9.81 * np.array([-np.sin(sensors.attitude), np.cos(sensors.attitude)])
            sensors = replace(sensors, specific_force=felt)
        joints, imu = encoder_message(sensors, at, self.last), imu_message(sensors, at, VARIANCES)
        if wrong == "frozen":
            joints.position, joints.velocity = self.frozen
        else:
            self.frozen = joints.position, joints.velocity
        if wrong == "back":
            joints.header = header(1)
        for name in ("name", "position", "velocity", "effort"):  # a broadcaster has an order of its own
            setattr(joints, name, getattr(joints, name)[::-1])
        self.joints.publish(joints)
        self.imu.publish(imu)
        for leg in Leg:
            angle = float(truth[2] + truth[3 + 2 * leg] + truth[4 + 2 * leg])
            self.feet[leg].publish(foot_wrench(self.state.foot_force[leg], angle, leg, at))


def main():
    asked = json.loads(sys.argv[1])
    rclpy.init()
    node = rclpy.create_node("hardware")
    plant = SimulationParameters(**asked["plant"], sensors="lab")
    how = {name: asked[name] for name in ("gait", "seed", "pace", "waits", "timeout", "wrong", "wrong_from")}
    robot = StandIn(node, plant, **how)
    end = time.monotonic() + asked["seconds"]
    rests = 0
    while time.monotonic() < end and rests < 200:
        rclpy.spin_once(node, timeout_sec=0.01)
        rests = rests + 1 if robot.state.tick and not (robot.state.running and robot.torque.any()) else 0
    said = {"outcome": robot.simulation.outcome.value, "stones": robot.state.touchdowns, "ticks": robot.state.tick}
    print(json.dumps({**said, "torque": robot.torque.tolist()}), flush=True)


if __name__ == "__main__":
    main()

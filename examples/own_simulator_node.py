"""A ROS node that takes the place of our simulator: a robot that hangs from a frame and swings its legs.

python examples/own_simulator_node.py    and in another shell: python examples/own_controller_node.py
"""

import numpy as np
import rclpy
from rabbit_msgs.msg import Episode, RobotState, TorqueCommand
from rclpy.qos import DurabilityPolicy, QoSProfile

TICKS, TICK, DAMPING = 300, 0.01, 2.0  # of the episode; s; N m s/rad
INERTIA, WEIGHT = np.array([[1.2, 0.4, 1.2, 0.4], [20, 8, 20, 8]])  # kg m^2; N m, of a leg or shin held out level
JOINTS = ["left_hip", "left_knee", "right_hip", "right_knee"]
LAYOUT = {"coordinates": ["base_x", "base_z", "base_pitch", *JOINTS], "joints": JOINTS, "feet": ["left", "right"]}
LATCHED = QoSProfile(depth=20, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def announce(phase: int, tick: int, outcome: str = "") -> None:
    episodes.publish(Episode(header=state.header, episode=1, phase=phase, tick=tick, outcome=outcome, **LAYOUT))


def step(command: TorqueCommand) -> None:
    if not state.running or (command.episode, command.tick) != (1, state.tick):
        return  # an answer that came already
    q, dq, torque = (np.array(values) for values in (state.q, state.dq, command.torque))
    hanging = q[3:] + [0, q[3], 0, q[5]]  # rad, from the vertical
    dq[3:] += TICK * (torque - DAMPING * dq[3:] - WEIGHT * np.sin(hanging)) / INERTIA
    state.tick, state.q, state.dq, state.applied = state.tick + 1, (q + TICK * dq).tolist(), dq.tolist(), command.torque
    state.header.stamp.sec, state.header.stamp.nanosec = divmod(state.tick * 10_000_000, 10**9)
    state.running = state.tick < TICKS
    states.publish(state)
    if not state.running:
        announce(Episode.ENDED, TICKS, "walked")


rclpy.init()
node = rclpy.create_node("test_stand")
states = node.create_publisher(RobotState, "state", 5000)
episodes = node.create_publisher(Episode, "episode", LATCHED)
node.create_subscription(TorqueCommand, "torque", step, 5000)
at_rest = {"foot_force": [0.0] * 4, "contact": [False] * 2, "applied": [np.nan] * 4, "dq": [0.0] * 7}
state = RobotState(episode=1, running=True, q=[0.0, 1.0, 0.0, -0.4, 0.4, 0.2, 0.3], **at_rest)
announce(Episode.RUNNING, 0)
node.create_timer(0.5, lambda: states.publish(state) if state.running else None)  # until it is answered
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    pass
except Exception:
    if rclpy.ok():  # else SIGTERM has ended it, perhaps as it published
        raise

"""A ROS node that takes the place of our controller: PD control of the joints along the path of a gait.

rabbit walk --controller none --terrain flat    and in another shell: python examples/own_controller_node.py
"""

import rclpy
from numpy import array, clip, ndarray
from numpy.polynomial.polynomial import polyder, polyval
from rabbit_msgs.msg import RobotState, TorqueCommand

PATH = array([  # rad: of stance hip, stance knee, swing hip, swing knee the factors of 1, s, s^2, ... over the phase s
    [-0.622, 0.213, -0.173, 0.203],
    [0.030, 1.415, 0.155, 1.135],
    [2.830, -6.610, -2.410, 1.970],
    [-7.030, 10.120, -4.530, -2.180],
    [7.335, -7.010, 12.885, -6.120],
    [-2.716, 2.075, -6.549, 5.205],
])  # fmt: skip
BEGIN, SPAN = -0.221, 0.444  # rad: the stance leg's angle as a step begins, and how far it turns
KP, KD, LIMIT = 500.0, 20.0, 200.0  # N m/rad, N m s/rad, N m


def torque_of(q: ndarray, dq: ndarray, touchdowns: int) -> list[float]:
    legs = [3, 4, 5, 6] if touchdowns % 2 == 0 else [5, 6, 3, 4]  # stance, swing; the left leg stands first
    phase, rate = ((x[2] + x[legs[0]] + x[legs[1]] / 2 - zero) / SPAN for x, zero in ((q, BEGIN), (dq, 0)))
    s = clip(phase, 0, 1)
    y = q[legs] - polyval(s, PATH)
    dy = dq[legs] - polyval(s, polyder(PATH)) * rate * (s == phase)
    q[legs] = clip(-KP * y - KD * dy, -LIMIT, LIMIT)
    return q[3:].tolist()  # left hip, left knee, right hip, right knee


def answer(state: RobotState) -> None:
    if state.running:  # not the last of an episode
        torque = torque_of(array(state.q), array(state.dq), state.touchdowns)
        turn = {"header": state.header, "episode": state.episode, "tick": state.tick}
        torques.publish(TorqueCommand(torque=torque, sender="pd", **turn))


rclpy.init()
node = rclpy.create_node("pd_controller")
torques = node.create_publisher(TorqueCommand, "torque", 10)
node.create_subscription(RobotState, "state", answer, 10)
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    pass
except Exception:
    if rclpy.ok():  # else SIGTERM has ended it, perhaps as it published
        raise

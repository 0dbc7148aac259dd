"""Simulator and controller in one process: the same nodes, topics and services, with calls between the two.

A state goes to the controller and its torque back without the middleware. Other processes read every topic; what they
publish on those that are handed over is not heard.
"""

from rabbit_common.ros.direct import Direct
from rabbit_common.ros.spin import run
from rabbit_sim.ros.node import ERRORS as SIMULATOR_ERRORS
from rabbit_sim.ros.node import SimulatorNode
from rclpy.node import Node
from rl_cbf_clf_controller.ros.node import ERRORS as CONTROLLER_ERRORS
from rl_cbf_clf_controller.ros.node import ControllerNode

HANDED_OVER = ("state", "preview", "episode", "torque")


def make_nodes() -> tuple[Node, ...]:
    """Both nodes; the controller is there before the simulator says its first word."""
    direct = Direct(*HANDED_OVER)
    controller = ControllerNode(direct)
    return SimulatorNode(direct), controller


def main() -> None:
    """The executable `one_process`."""
    run(make_nodes, errors=(*SIMULATOR_ERRORS, *CONTROLLER_ERRORS))


if __name__ == "__main__":
    main()

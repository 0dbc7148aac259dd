"""A graph in a ROS domain that many other processes are in."""

from contextlib import ExitStack
from typing import Any

import rclpy
from rabbit_msgs.msg import Episode
from rclpy.signals import SignalHandlerOptions

OTHERS = 40  # more than Fast DDS asks by default, and than the 32 that were asked


def test_nodes_find_each_other_behind_many_others(make_world: Any) -> None:
    with ExitStack() as stack:
        for number in range(OTHERS):  # each is a participant of its own, with the lowest ports that are free
            context = rclpy.Context()
            rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
            stack.callback(rclpy.try_shutdown, context=context)
            other = rclpy.create_node(f"other_{number}", context=context, enable_rosout=False)
            stack.callback(other.destroy_node)
        world = make_world("crowd")
        world.start("simulator", stones=2, motor_lag=0.004)
        world.start("controller", controller="cbf-clf-qp")
        episodes = world.hear("episode")
        world.go()
        world.wait(lambda: any(each.phase == Episode.ENDED and each.tick > 0 for each in episodes))
    assert episodes[-1].outcome == "walked"

"""`rclpy.init` as every process here calls it: on the chosen network, signals left alone, what is wrong in one line."""

import os
import re

import rclpy
from rclpy.context import Context
from rclpy.signals import SignalHandlerOptions

from rabbit_ros.network import StartError, choose_network

_HOMES_OF_LOGS = ("ROS_LOG_DIR", "ROS_HOME", "HOME")


def initialise(context: Context | None = None, args: list[str] | None = None) -> None:
    """Initialise `context`, or the default one, with ROS arguments; `None`: those of the command line.

    Raises:
        StartError: the environment or an argument cannot be used.
    """
    choose_network()
    if not any(map(os.environ.get, _HOMES_OF_LOGS)):
        raise StartError(f"no folder for the logs: expected one of {', '.join(_HOMES_OF_LOGS)} in the environment")
    try:
        rclpy.init(args=args, context=context, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # whatever rcl refuses
        raise StartError(_line(str(error))) from error


def _line(said: str) -> str:
    """What rcl says, without the lines of its sources."""
    text = re.sub(r", at \S+:\d+", "", said).removeprefix("failed to initialize rcl: ")
    return f"unknown ROS arguments {text}" if text.startswith("[") else text

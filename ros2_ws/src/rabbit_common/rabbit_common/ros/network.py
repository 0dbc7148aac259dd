"""`rclpy.init` as every process here calls it, and who can hear its nodes: this machine alone, unless the environment
says otherwise.

Under ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST Fast DDS asks nobody else, but it listens on every interface and answers
whoever names this machine as a static peer. The profile `fastdds.xml` binds every socket to 127.0.0.1 instead.
"""

import contextlib
import os
import re
from collections.abc import Iterator
from pathlib import Path

import rclpy
from rclpy.context import Context
from rclpy.signals import SignalHandlerOptions

from rabbit_common.executables import Refused

RANGE, PEERS, MIDDLEWARE = "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_STATIC_PEERS", "RMW_IMPLEMENTATION"
PROFILE, WHOLE = "FASTRTPS_DEFAULT_PROFILES_FILE", "RMW_FASTRTPS_USE_QOS_FROM_XML"
DOMAIN = "ROS_DOMAIN_ID"
LAST_DOMAIN = 232  # beyond it there are no ports
FAST_DDS = "rmw_fastrtps_cpp"
PROFILES = Path(__file__).parents[1]
_HOMES_OF_LOGS = ("ROS_LOG_DIR", "ROS_HOME", "HOME")


class StartError(Refused):
    """The environment or the ROS arguments cannot be used: one line with the thing and its value."""


def domain() -> int:
    """The ROS domain that the environment names; raises `StartError`."""
    text = os.environ.get(DOMAIN) or "0"
    if not (text.isascii() and text.isdigit() and int(text) <= LAST_DOMAIN):
        raise StartError(f"{DOMAIN} {text}: expected a whole number from 0 to {LAST_DOMAIN}")
    return int(text)


def choose_network() -> None:
    """Set what rclpy reads when it is initialised; a profile, range or peers that the user named stay in force.

    Raises `StartError` if there is no such ROS domain.
    """
    domain()
    if os.environ.get(MIDDLEWARE, FAST_DDS) != FAST_DDS:
        os.environ.setdefault(RANGE, "LOCALHOST")  # as far as that middleware goes
    elif not os.environ.get(PROFILE):
        wider = os.environ.get(RANGE, "LOCALHOST") != "LOCALHOST" or os.environ.get(PEERS)
        os.environ[PROFILE] = str(PROFILES / ("fastdds_network.xml" if wider else "fastdds.xml"))
        if not wider:
            os.environ[RANGE] = "SYSTEM_DEFAULT"  # the profile's; LOCALHOST would add sockets
        os.environ.setdefault(WHOLE, "1")  # without it, what the profile says of memory does not count
        os.environ.setdefault(RANGE, "LOCALHOST")


def initialise(context: Context | None = None, args: list[str] | None = None) -> None:
    """Initialise `context`, or the default one, with ROS arguments; `None`: those of the command line.

    The network is chosen first; signals are left alone. Raises `StartError`.
    """
    choose_network()
    if not any(map(os.environ.get, _HOMES_OF_LOGS)):
        raise StartError(f"no folder for the logs: expected one of {', '.join(_HOMES_OF_LOGS)} in the environment")
    try:
        rclpy.init(args=args, context=context, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # whatever rcl refuses; without the lines of its sources
        text = re.sub(r", at \S+:\d+", "", str(error)).removeprefix("failed to initialize rcl: ")
        raise StartError(f"unknown ROS arguments {text}" if text.startswith("[") else text) from error


@contextlib.contextmanager
def joined(enclave: str) -> Iterator[Context]:
    """A command's place in the graph: a context of rclpy in this enclave of a secured one; raises `StartError`."""
    context = rclpy.Context()
    initialise(context, ["--ros-args", "--enclave", enclave])
    try:
        yield context
    finally:
        rclpy.try_shutdown(context=context)

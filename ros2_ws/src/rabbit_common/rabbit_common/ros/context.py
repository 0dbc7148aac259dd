"""A command's own place in the graph, for as long as it looks or asks."""

import contextlib
from collections.abc import Iterator

import rclpy
from rclpy.context import Context

from rabbit_common.executables import Refused
from rabbit_common.ros.network import StartError, initialise


@contextlib.contextmanager
def joined(enclave: str) -> Iterator[Context]:
    """A context of rclpy in this enclave of a secured graph; raises `Refused` where the environment cannot be used."""
    context = rclpy.Context()
    try:
        initialise(context, ["--ros-args", "--enclave", enclave])
    except StartError as error:
        raise Refused(str(error)) from error
    try:
        yield context
    finally:
        rclpy.try_shutdown(context=context)

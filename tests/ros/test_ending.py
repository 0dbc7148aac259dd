"""A node's end: signals that come after the first change nothing."""

import signal
import subprocess
import sys

HANGS = """
import ctypes
from rabbit_common.ros import spin
from rclpy.node import Node

class Hanging(Node):
    def __init__(self):
        super().__init__("hanging")
        self.create_timer(0.1, lambda: print("runs", flush=True))

    def destroy_node(self):
        ctypes.PyDLL(None).pause()  # keeps the interpreter's lock, as a middleware that waits for itself

spin._MIDDLEWARE = 1
spin.run(Hanging)
"""


def test_a_node_whose_middleware_hangs_ends_cleanly() -> None:
    with subprocess.Popen([sys.executable, "-c", HANGS], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "runs\n"
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=180)
    assert process.returncode == 0

"""A node's end: signals that come after the first change nothing."""

import signal
import subprocess
import sys

ENDS_SLOWLY = """
import os
import sys
from rabbit_common.ros.spin import run
from rclpy.node import Node

class Last:
    def __del__(self, write=os.write, read=os.read):  # after the interpreter has undone the signals' handlers
        write(1, b"ends\\n")
        read(0, 1)

class Plain(Node):
    def __init__(self):
        super().__init__("plain")
        os.write(1, b"runs\\n")

sys.last = Last()
run(Plain)
"""


def test_a_node_that_is_told_twice_to_end_ends_cleanly() -> None:
    command = [sys.executable, "-c", ENDS_SLOWLY]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        for word, number in (("runs", signal.SIGINT), ("ends", signal.SIGTERM)):
            assert process.stdout.readline() == f"{word}\n"
            process.send_signal(number)
        process.communicate("\n", timeout=180)
    assert process.returncode == 0


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

"""Runs a node until a signal. Every node's `main` is a call of this."""

import gc
import signal
import sys
import time
from collections.abc import Callable

import rclpy
from rabbit_description.plugins import PluginError
from rabbit_description.user_code import fault_in_user_code
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.timer import Timer

from rabbit_common.deadline import end_within
from rabbit_common.priority import give_way
from rabbit_common.ros.network import StartError, initialise
from rabbit_common.ros.parameters import ParameterError, refuse_unknown
from rabbit_common.ros.services import guard_services

_LOOK_UP = 0.1  # s between looks at the signals; without a time-out this executor's wait hears none
_LAST_WORK = 10.0  # s
_DELIVERY = 3.0  # s
_MIDDLEWARE = 10  # s, that it may take to end
_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def run(make: Callable[[], Node], errors: tuple[type[Exception], ...] = (), *, gives_way: bool = False) -> None:
    """Make a node, spin, close it.

    SIGINT and SIGTERM end it between two callbacks; more of them change nothing. This thread alone hears them: a
    solver that answers SIGINT itself can then keep it off. If arguments or parameters cannot be used, it ends with one
    line and exit code 2. The process ends in any case, see `deadline`.

    Args:
        make: the node's class. If it has `busy()`, it is spun until that is False (10 s at most); if it has `close()`,
            that is called at the end. If its `failure` becomes a line, it ends with that and its `failure_code`, or 2.
        errors: besides `ParameterError`, what the constructor raises when a file or value cannot be used.
        gives_way: whether the node's work can wait, and a tick of simulator and controller goes before it.
    """
    signals: list[int] = []
    for number in _SIGNALS:
        signal.signal(number, lambda got, _: signals.append(got))
    signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)  # in this thread, and in those that it starts meanwhile
    unusable: tuple[type[Exception], ...] = (StartError, ParameterError, PluginError, *errors)
    try:
        initialise()
        node = make()
        refuse_unknown(node, ())
        if gives_way:
            give_way()
        guard_services(node)
    except Exception as error:
        where = str(error) if isinstance(error, unusable) else fault_in_user_code(error)
        if not where:
            raise
        print("error:", " ".join(where.split()), file=sys.stderr)
        sys.exit(2)
    gc.freeze()  # what is there by now stays: looking through it again would hold up a tick
    executor = EventsExecutor()
    executor.add_node(node)
    crashed = ""
    try:
        executor.spin_once(0.0)  # starts the executor's threads
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)
        while not signals and not getattr(node, "failure", ""):
            executor.spin_once(_LOOK_UP)
        deadline = time.monotonic() + _LAST_WORK
        while getattr(node, "busy", bool)() and time.monotonic() < deadline:
            executor.spin_once(_LOOK_UP)
    except Exception as error:
        if not (crashed := fault_in_user_code(error) or ""):
            raise
    finally:
        getattr(node, "close", lambda: None)()
        end = time.monotonic() + _DELIVERY
        for publisher in node.publishers:  # which takes with it what its readers do not have yet
            publisher.wait_for_all_acked(Duration(seconds=max(0.0, end - time.monotonic())))
        failed = 0
        if failure := crashed or getattr(node, "failure", ""):
            failed = getattr(node, "failure_code", 2)
            print(f"error: {failure}", file=sys.stderr)
        end_within(_MIDDLEWARE, failed or int(sys.exc_info()[0] is not None))
        node.destroy_node()
        rclpy.try_shutdown()
        for number in _SIGNALS:  # as the interpreter ends it undoes handlers
            signal.signal(number, signal.SIG_IGN)
    if failed:
        sys.exit(failed)


def steady_timer(node: Node, period: float, callback: Callable[[], object]) -> Timer:
    """A timer by the wall clock, in s, whatever the simulated time is."""
    return node.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))

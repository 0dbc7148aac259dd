"""One walk through the node graph: start the nodes, wait until they are matched, let them walk, end them."""

import contextlib
import sys
from collections.abc import Callable, Iterator
from typing import Any

from rabbit_common.priority import leave_priority, take_listeners_priority
from rabbit_common.ros.namespace_check import NamespaceCheck

from rabbit_bringup.launching.processes import Processes, write_parameters
from rabbit_bringup.launching.walk import WalkSettings
from rabbit_bringup.ros.walk_monitor import Progress, WalkMonitor

Tell = Callable[[Any], object]  # gets the `Episode` message of an episode that has ended


def walk_through(
    walk: WalkSettings, tell: Tell = lambda _: None, show: Callable[[Progress], object] = lambda _: None
) -> WalkMonitor:
    """Walk all episodes, as `walking` says; `show` gets the walk's progress now and then."""
    with walking(walk, tell) as monitor:
        while not monitor.is_over:
            show(monitor.glance())
    return monitor


@contextlib.contextmanager
def walking(walk: WalkSettings, tell: Tell = lambda _: None) -> Iterator[WalkMonitor]:
    """A graph that walks, seen by the monitor, as long as that is called now and then; all nodes have ended at the end.

    Raises `LaunchError` if another graph is there, or a node cannot be started, ended by itself, or is not ready in
    time; `Interrupted` by a signal.
    """
    processes = Processes(walk.folder / "log")
    with contextlib.ExitStack() as stack:
        check = stack.enter_context(contextlib.closing(NamespaceCheck(walk.options.namespace)))
        take_listeners_priority(walk.options.priority, warn=lambda line: print(line, file=sys.stderr))
        stack.callback(leave_priority, walk.options.priority)  # what is started meanwhile has it too
        stack.enter_context(processes.ended_at_last())
        check.look(walk.names)
        write_parameters(walk.parameter_file, walk.parameters())
        for name in sorted(walk.names, key=lambda name: name != "trainer"):  # which imports the longest
            processes.check()
            package, executable = walk.executable(name)
            processes.start(name, walk.arguments(name), executable, package)
        with contextlib.closing(WalkMonitor(walk.options, processes, tell)) as monitor:
            monitor.begin()
            yield monitor

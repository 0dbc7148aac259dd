"""Every node's executable: becomes an entry point in the group `rabbit.nodes`, by default the one of the same name.

A node imports for a second or two. A Ctrl-C meanwhile ends it at once, without a traceback.
"""

import signal
import sys
from importlib.metadata import entry_points
from pathlib import Path


def main(name: str = "") -> None:
    """Import the node's module, then run its `main`."""
    import numpy as np  # noqa: F401  its threads do not hear SIGINT, which is blocked by the executable's first line

    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # nobody has it ignored
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    wanted = name or Path(sys.argv[0]).name
    nodes = tuple(entry_points(group="rabbit.nodes", name=wanted))
    if len(nodes) != 1:
        line = f"error: {len(nodes)} nodes {wanted} installed, expected one; source the workspace's setup.bash"
        print(line, file=sys.stderr)
        sys.exit(2)
    try:
        node = nodes[0].load()
    except ModuleNotFoundError as error:
        print(f"error: {wanted} needs {error.name}, which is not installed", file=sys.stderr)
        sys.exit(2)
    node()

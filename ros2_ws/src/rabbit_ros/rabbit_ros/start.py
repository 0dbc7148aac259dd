"""Every node's executable: becomes the entry point of the executable's own name in the group `rabbit.nodes`.

A node imports for a second or two. Told to end meanwhile (Ctrl-C), it does so without a traceback.
"""

import sys
from importlib.metadata import entry_points
from pathlib import Path


def main() -> None:
    """Import the node's module, then run its `main`; exit code 130 if interrupted before."""
    try:
        (node,) = entry_points(group="rabbit.nodes", name=Path(sys.argv[0]).name)
        run = node.load()
    except KeyboardInterrupt:
        sys.exit(130)
    run()

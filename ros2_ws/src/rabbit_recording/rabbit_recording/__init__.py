"""Recordings of the graph: written, read, checked, replayed."""

from rabbit_common.threads import use_one_thread

use_one_thread()


class RecordingError(RuntimeError):
    """A recording that cannot be written or read, in one line."""

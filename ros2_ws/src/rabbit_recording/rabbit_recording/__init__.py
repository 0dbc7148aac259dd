"""Recordings of the graph: written, read, checked, replayed."""

from rabbit_common.threads import use_one_thread

use_one_thread()

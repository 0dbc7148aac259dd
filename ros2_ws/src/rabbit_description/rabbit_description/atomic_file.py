"""Files that are written whole or not at all, also when their writer is killed."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A path to write to, in the same folder: what is there takes the place of `path`, unless the block raises.

    Each writer has a path of its own: of several at once the last one's file stays, whole.
    """
    partial = path.with_name(f".{uuid4().hex}.{path.name}")
    try:
        yield partial
        with partial.open("rb") as file:
            os.fsync(file.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)

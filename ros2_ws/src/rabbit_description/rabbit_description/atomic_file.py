"""Files that are written whole or not at all, also when their writer is killed."""

import csv
import fcntl
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from itertools import chain, count
from pathlib import Path
from typing import Any
from uuid import uuid4

PARTIAL = re.compile(r"\.[0-9a-f]{32}\..+", re.DOTALL)  # the names that `replacing` gives


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A path to write to, in the same folder: what is there takes the place of `path`, unless the block raises.

    No two writers have the same path: of several at once the last one's file stays, whole.

    Raises:
        OSError: with the name of the file, as on a full disk.
    """
    partial = path.with_name(f".{uuid4().hex}.{path.name}")
    try:
        with partial.open("xb") as lock:
            fcntl.flock(lock, fcntl.LOCK_SH)  # until this process ends: see `remove_partials`
            yield partial
            with partial.open("rb") as file:
                os.fsync(file.fileno())
            partial.replace(path)
    except OSError as error:
        if error.filename not in (None, str(partial)):
            raise
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error
    finally:
        with suppress(OSError):  # a disk that is read-only by now
            partial.unlink(missing_ok=True)


def remove_partials(folder: Path) -> None:
    """Remove what killed writers have left in a folder and below; a writer that lives has a lock on its file."""
    for path in folder.rglob(".*"):
        if PARTIAL.fullmatch(path.name) and path.is_file():
            with suppress(OSError), path.open("rb") as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                path.unlink()


def replace_text(path: Path, text: str) -> None:
    """Write a text file, whole or not at all."""
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")


def replace_table(path: Path, rows: Iterable[Mapping[str, Any]], names: Iterable[str] = ()) -> None:
    """Write a CSV file, whole or not at all: columns `names`, by default all that a row has; a cell may be empty."""
    rows = list(rows)
    columns = [*names] or list(dict.fromkeys(name for row in rows for name in row))
    with replacing(path) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, columns)
        table.writeheader()
        table.writerows(rows)


def first_free(path: Path) -> Path:
    """The path itself, or the first of `PATH-2`, `PATH-3`, ... that is not there."""
    paths = chain([path], (path.with_name(f"{path.name}-{number}") for number in count(2)))
    return next(free for free in paths if not free.exists())

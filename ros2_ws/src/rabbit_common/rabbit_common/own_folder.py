"""What a command may write to: folders that were empty or that it made, and files that are not there yet.

Until it ends, no other command writes there: it has a lock, which dies with its process.
"""

import fcntl
import os
from collections.abc import Callable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import typer
from rabbit_description.atomic_file import remove_partials

from rabbit_common.options import fail

CLICK = typer.Context.__mro__[1].__module__.rpartition(".")[0]  # a package, or in newer typers a part of typer
RESERVED = ".{}.{}".format("0" * 32, "{}")  # of a file to come: as long as a name of `atomic_file.replacing`


def own_folder(path: Path, command: str) -> Path:
    """Make a folder, or take an empty one or one that `command` made; ends the command otherwise, nothing written.

    The file `.rabbit-COMMAND` in it says whose it is. What a killed command has half written there is removed.
    """
    mark = path / f".rabbit-{command.replace(' ', '-')}"
    try:
        _take(path, mark, f"expected a new or empty folder, or one that `rabbit {command}` made")
        if mark.is_file():
            remove_partials(path)
        mark.touch()
    except OSError as error:
        fail(f"--out {path}: {error.strerror}")
    return path


def new_folder(path: Path) -> Path:
    """Make a folder, or take an empty one; its absolute path. Ends the command otherwise."""
    folder = path.absolute()
    try:
        _take(folder, None, "expected a new or empty folder")
    except OSError as error:
        fail(f"--out {folder}: {error.strerror}")
    return folder


def new_file(path: Path) -> Path:
    """A path at which there is nothing yet, not even a link, and at which a file can be written; ends the command
    otherwise. Its folder is made."""
    reserved = path.with_name(RESERVED.format(path.name))
    try:
        if not os.path.lexists(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            _lock(path, os.open(reserved, os.O_RDWR | os.O_CREAT, 0o666), partial(reserved.unlink, missing_ok=True))
    except OSError as error:
        fail(f"--out {path}: {error.strerror}")
    if os.path.lexists(path):  # or by now
        fail(f"--out {path}: is there already: expected a new file")
    return path


def _take(folder: Path, mark: Path | None, expected: str) -> None:
    """Make a folder and lock it; what it has in it, if anything, must be a command's that left its `mark`."""
    if os.path.lexists(folder) and not folder.is_dir():
        fail(f"--out {folder}: {expected}")
    folder.mkdir(parents=True, exist_ok=True)
    _lock(folder, os.open(folder, os.O_RDONLY | os.O_DIRECTORY))
    if not (mark and mark.is_file()) and any(folder.iterdir()):
        fail(f"--out {folder}: {expected}")


def _lock(path: Path, descriptor: int, at_end: Callable[[], object] | None = None) -> None:
    """Lock an open file or folder until the command ends; ends it where another one has the lock."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        fail(f"--out {path}: another command is writing there: expected another place, or that it has ended")
    except OSError:
        pass  # a file system without locks
    context: Any = import_module(f"{CLICK}.globals").get_current_context(silent=True)
    if context:  # else it is held as long as the process lives
        for last in (partial(os.close, descriptor), at_end):  # the last one is called first
            if last:
                context.call_on_close(last)

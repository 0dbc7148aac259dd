"""What a command may write to: folders that were empty or are its own, and files that are not there yet."""

from pathlib import Path

from rabbit_description.atomic_file import remove_partials

from rabbit_common.options import fail


def own_folder(path: Path, command: str) -> Path:
    """Make a folder, or take an empty one or one that `command` made; ends the command otherwise, nothing written.

    The file `.rabbit-COMMAND` in it says whose it is. What a killed command has half written there is removed.
    """
    mark = path / f".rabbit-{command.replace(' ', '-')}"
    try:
        if mark.is_file():
            remove_partials(path)
        else:
            _make(path, f"expected a new or empty folder, or one that `rabbit {command}` made")
            mark.touch()
    except OSError as error:
        fail(f"--out {path}: {error.strerror}")
    return path


def new_folder(path: Path) -> Path:
    """Make a folder, or take an empty one; its absolute path. Ends the command otherwise."""
    folder = path.absolute()
    try:
        _make(folder, "expected a new or empty folder")
    except OSError as error:
        fail(f"--out {folder}: {error.strerror}")
    return folder


def new_file(path: Path) -> Path:
    """A path at which there is nothing yet; ends the command otherwise."""
    if path.exists():
        fail(f"--out {path}: is there already: expected a new file")
    return path


def _make(folder: Path, expected: str) -> None:
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        fail(f"--out {folder}: {expected}")
    folder.mkdir(parents=True, exist_ok=True)

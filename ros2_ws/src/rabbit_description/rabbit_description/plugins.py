"""Parts that packages bring by entry points, and that parameters choose by name: `--plant rigid`.

    entry_points={"rabbit.plants": ["rigid = rabbit_sim.rigid_plant:RigidPlant"]}      in a setup.py

docs/architecture.md has the groups. A part is imported when it is loaded.
"""

import sys
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from typing import Any


class PluginError(LookupError):
    """No part of that name can be had; the message is one line."""


def entries(group: str) -> Any:
    """The entry points of all installed packages under this name."""
    return _entry_points(tuple(sys.path)).select(group=group)


def names(group: str) -> tuple[str, ...]:
    """What a parameter may choose from, in alphabetical order."""
    return tuple(sorted(_by_name(group, tuple(sys.path))))


def load(group: str, name: str) -> Any:
    """The class or function of this name.

    Raises:
        PluginError: no installed package brings it, a library that it needs is not installed, it was written for
            another version of a library, its module raises an error, or has no such part.
    """
    from rabbit_description.user_code import fault_in_user_code, plugged  # pydantic: not for a list of commands
    from rabbit_description.validation import one_of

    parts = _by_name(group, tuple(sys.path))
    if name not in parts:
        known = names(group)
        choices = one_of(name, known) if known else "what an installed package brings; none brings one"
        raise PluginError(f"{group} {name}: expected {choices}")
    plugged.add(parts[name].module.partition(".")[0])
    try:
        return parts[name].load()
    except ImportError as error:
        library = (error.name or "").partition(".")[0]
        message = f"it needs the library {error.name}, which is not installed"
        if (package := parts[name].dist) and library in (package.metadata.get_all("Provides-Extra") or ()):
            message += f": pip install '{package.name}[{library}]'"
        if library and find_spec(library):
            message = f"{error}: it was written for another version of {library}"
        raise PluginError(f"{group} {name}: {message}") from error
    except Exception as error:  # it is code, and may raise anything
        if where := fault_in_user_code(error):
            raise PluginError(f"{group} {name}: {where}") from error
        if isinstance(error, AttributeError):
            raise PluginError(f"{group} {name}: {error}") from error
        raise


@cache
def _by_name(group: str, path: tuple[str, ...]) -> dict[str, EntryPoint]:
    """The entry points as `sys.path` is; raises `PluginError` where two packages bring other parts under one name."""
    parts: dict[str, EntryPoint] = {}
    for entry in _entry_points(path).select(group=group):
        first = parts.setdefault(entry.name, entry)
        if first.value != entry.value:
            raise PluginError(f"{group} {entry.name}: expected one, found {first.value} and {entry.value}")
    return parts


@cache  # reading those of all packages takes tens of ms
def _entry_points(path: tuple[str, ...]) -> Any:
    return entry_points()

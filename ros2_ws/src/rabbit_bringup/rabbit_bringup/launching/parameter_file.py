"""The parameters of a graph's nodes as a ROS parameter file, read and written."""

import re
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from rabbit_description.atomic_file import replace_text
from rabbit_description.bounded_file import FileError
from rabbit_description.yaml_file import dump_yaml, read_yaml

PARAMETERS = "ros__parameters"
_WILD = {"*": "[^/]+/", "**": "(.*/)?"}  # parts of a node's full name


class ParameterFileError(ValueError):
    """A file that is no ROS parameter file; one line."""


def write_parameters(path: Path, nodes: dict[str, dict[str, Any]]) -> None:
    """Write parameters by node name; they hold in whatever namespace the node is."""
    content = {f"/**/{name}": {PARAMETERS: _plain(values)} for name, values in nodes.items()}
    replace_text(path, dump_yaml(content))


def read_parameters(path: Path, namespace: str, nodes: Collection[str]) -> dict[str, dict[str, Any]]:
    """What a file says to each of the nodes in a namespace, later entries before earlier ones, as in ROS.

    Raises:
        ParameterFileError: not readable, or not of that form.
    """
    try:
        content = read_yaml(path)
    except FileError as error:
        raise ParameterFileError(f"{path}: {error}") from error
    found: dict[str, dict[str, Any]] = {name: {} for name in nodes}
    for pattern, values in _entries(path, content or {}):
        for name in nodes:
            if _matches(pattern, f"{namespace.strip('/')}/{name}".strip("/")):
                found[name] |= values
    return found


def _entries(path: Path, content: Any, above: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Name patterns with their parameters, namespaces put before the names that stand in them."""
    if not isinstance(content, dict):
        raise ParameterFileError(f"{path}: expected node names, each with {PARAMETERS}")
    for name, below in content.items():
        if name == PARAMETERS:
            if not (above and isinstance(below, dict)):
                raise ParameterFileError(f"{path}: {PARAMETERS}: expected names and values, beneath a node's name")
            values = _flat(below)
            if (name := next((name for name, value in values.items() if value is None), None)) is not None:
                raise ParameterFileError(f"{path}: {name}: expected a value; ROS reads null as text")
            yield above, values
        else:
            yield from _entries(path, below, f"{above}/{str(name).strip('/')}")


def _flat(values: dict[str, Any], above: str = "") -> dict[str, Any]:
    """Nested names with a dot between them."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        found |= _flat(value, f"{above}{name}.") if isinstance(value, dict) else {f"{above}{name}": value}
    return found


def _matches(pattern: str, name: str) -> bool:
    parts = pattern.strip("/").split("/")
    return re.fullmatch("".join(_WILD.get(part, re.escape(part) + "/") for part in parts), f"{name}/") is not None


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    """Without empty lists: a parameter file has no type for them, and the node's default is the same."""
    return {name: value for name, value in values.items() if value not in ([], ())}

"""The parameters of a walk as one YAML file that every node reads with `--params-file`."""

from pathlib import Path
from typing import Any

import yaml


def write_parameters(path: Path, nodes: dict[str, dict[str, Any]]) -> None:
    """Write parameters by node name; they hold in whatever namespace the node is."""
    content = {f"/**/{name}": {"ros__parameters": _plain(values)} for name, values in nodes.items()}
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    """Without empty lists: a parameter file has no type for them, and the node's default is the same."""
    return {name: value for name, value in values.items() if value not in ([], ())}

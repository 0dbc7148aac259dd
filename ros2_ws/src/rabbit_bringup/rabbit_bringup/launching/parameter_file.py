"""The parameters of a graph's nodes as a ROS parameter file."""

from pathlib import Path
from typing import Any

from rabbit_description.atomic_file import replace_text
from rabbit_description.yaml_file import dump_yaml


def write_parameters(path: Path, nodes: dict[str, dict[str, Any]]) -> None:
    """Write parameters by node name; they hold in whatever namespace the node is.

    Empty lists are left out: a parameter file has no type for them, and the node's default is the same.
    """
    plain = {
        name: {key: each for key, each in values.items() if each not in ([], ())} for name, values in nodes.items()
    }
    replace_text(path, dump_yaml({f"/**/{name}": {"ros__parameters": values} for name, values in plain.items()}))

"""Finds and reads YAML files; what is in them is not trusted."""

from pathlib import Path
from typing import Any

import yaml


class YamlFileError(ValueError):
    """A file that is no YAML, in one line without its name."""


def yaml_path(name_or_path: str | Path, folder: Path) -> Path:
    """A path that ends in `.yaml` as it is; anything else is the name of a file in `folder`."""
    path = Path(name_or_path)
    return path if path.suffix == ".yaml" else folder / f"{name_or_path}.yaml"


def read_yaml(path: Path) -> Any:
    """What the file holds, plain data alone.

    Raises:
        YamlFileError: it cannot be read, is no UTF-8 or no YAML, or is nested too deep.
    """
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except (
        OSError,
        yaml.YAMLError,
        ValueError,
        OverflowError,
        TypeError,
    ) as error:  # not all are PyYAML's own
        raise YamlFileError(" ".join(str(error).split())) from error
    except RecursionError as error:
        raise YamlFileError("nested too deep") from error

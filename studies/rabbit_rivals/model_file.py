"""Trained models as safetensors: arrays, and one JSON object that makes sense of them; checked when read."""

import hashlib
import json
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from pydantic import BaseModel, ValidationError
from rabbit_description.atomic_file import replacing
from rabbit_description.bounded_file import FileError, read_bytes
from rabbit_description.state import Array
from rabbit_description.validation import Checked, one_line
from rl_cbf_clf_controller.weights import PolicyFileError, unpack
from safetensors.numpy import save

SHIPPED = Path(__file__).parent / "policies"
SIZE_LIMIT = 32_000_000  # bytes
KEY = "rabbit_model"


class About(Checked):
    """What a model is and where it comes from; `shapes` of all its arrays follow from it."""

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Names and shapes of the arrays."""
        raise NotImplementedError


class _Head(BaseModel):
    """What the header holds; `about` by the kind of model."""

    version: str
    about: Any


Kind = TypeVar("Kind", bound=About)


@dataclass(frozen=True)
class ModelFile(Generic[Kind]):
    """Checked metadata and arrays.

    Raises:
        PolicyFileError: arrays of other names or shapes, or that are not finite.
    """

    about: Kind
    arrays: dict[str, Array] = field(repr=False)

    def __post_init__(self) -> None:
        expected = self.about.shapes
        if self.arrays.keys() != expected.keys():
            raise PolicyFileError(f"model: arrays {sorted(self.arrays)}; expected {sorted(expected)}")
        for name, shape in expected.items():
            array = self.arrays[name]
            if array.shape != shape or array.dtype.kind not in "fi":
                raise PolicyFileError(f"model: {name} is {array.dtype} {array.shape}; expected numbers {shape}")
            if not np.isfinite(array).all():
                raise PolicyFileError(f"model: {name} has values that are not finite")

    @cached_property
    def version(self) -> str:
        """The first 12 digits of the SHA-256 over metadata and arrays."""
        digest = hashlib.sha256(self.about.model_dump_json().encode())
        for name in sorted(self.arrays):
            digest.update(name.encode() + self.arrays[name].tobytes())
        return digest.hexdigest()[:12]

    def write(self, path: Path) -> None:
        """Write the file at once or not at all."""
        head = {"version": self.version, "about": self.about.model_dump(mode="json")}
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as partial:
            partial.write_bytes(save(self.arrays, metadata={KEY: json.dumps(head)}))


def read(path: Path, kind: type[Kind]) -> ModelFile[Kind]:
    """Read and check a file.

    Raises:
        PolicyFileError: there is none, or anything is wrong with it.
    """
    try:
        arrays, text = unpack(read_bytes(path, SIZE_LIMIT), KEY, SIZE_LIMIT)
        head = _Head.model_validate_json(text)
        file = ModelFile(kind.model_validate(head.about), arrays)
    except FileError as error:
        raise PolicyFileError(f"cannot read {path}: {error}") from error
    except (ValidationError, PolicyFileError) as error:
        raise PolicyFileError(f"{path}: not a file of this model: {one_line(error)}") from error
    if head.version != file.version:
        raise PolicyFileError(f"{path}: version {head.version}; its content has {file.version}")
    return file

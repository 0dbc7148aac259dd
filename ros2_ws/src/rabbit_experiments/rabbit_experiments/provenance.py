"""Where a result comes from: command and commit; and what decides it: what is asked for, and what it is made with.

asked = plain(job)          names and numbers
provenance(asked)           content of files, code of classes, versions of libraries, arithmetic of the processor
"""

import json
import math
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from importlib.metadata import PackageNotFoundError, entry_points, version
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np
from pydantic import BaseModel
from rabbit_description.atomic_file import replace_text

from rabbit_experiments.source_code import CodeError, code_of, hash_of, hash_of_text

LIBRARIES = ("numpy", "scipy", "pin", "pybullet", "mujoco", "osqp", "torch", "casadi", "safetensors", "joblib")
PARTS = ("rabbit.plants", "rabbit.controllers", "rabbit.learners")  # entry points that parameters choose by name
FUNCTIONS = "sin", "cos", "tan", "exp", "tanh", "atan"
CLASS = "class"
MADE_WITH = "made_with.json"  # in a folder in which one thing is made


@cache
def versions() -> dict[str, str]:
    """The versions of Python and of the libraries that are installed."""
    installed = {"python": platform.python_version()}
    for name in LIBRARIES:
        with suppress(PackageNotFoundError):
            installed[name] = version(name)
    return installed


@cache
def arithmetic() -> str:
    """A hash of the last bits that this processor computes: libm, numpy and BLAS choose their code by its kind."""
    x = np.linspace(-3.0, 3.0, 576)
    by_libm = [[getattr(math, name)(value) for value in x.tolist()] for name in FUNCTIONS]
    by_numpy = [getattr(np, name)(x) for name in FUNCTIONS]
    A = x.reshape(24, 24) + np.diag(np.exp(x[:24]))
    by_blas = A @ A, np.linalg.inv(A)
    return hash_of_text(b"".join(np.asarray(values).tobytes() for values in (*by_libm, *by_numpy, *by_blas)).hex())


@cache
def commit() -> str:
    """The repository's commit, `+` where files differ from it; empty outside a repository."""
    folder = Path(__file__).parent
    head = _git(folder, "rev-parse", "HEAD")
    return head + "+" * bool(head and _git(folder, "status", "--porcelain", "--untracked-files=no"))


def command() -> str:
    """This process's command line."""
    return " ".join(("rabbit", *sys.argv[1:]))


def plain(value: Any) -> Any:
    """Dataclasses and models with their class, sequences and mappings, as JSON has them; classes, functions by name.

    Raises:
        TypeError: of anything else.
    """
    if isinstance(value, Enum):
        return plain(value.value)
    if value is None or isinstance(value, str | int | float):
        return value
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, type | FunctionType):
        return {CLASS: _name(value)}
    if isinstance(value, Mapping):
        return {str(name): plain(item) for name, item in value.items()}
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    if isinstance(value, BaseModel):
        names = list(type(value).model_fields)
    elif is_dataclass(value):
        names = [field.name for field in fields(value) if field.compare]
    else:
        raise TypeError(f"{value!r}: expected plain data, a model or a dataclass")
    return {CLASS: _name(type(value)), **{name: plain(getattr(value, name)) for name in names}}


def provenance(asked: Any, hash_file: Callable[[Path], str] = hash_of) -> dict[str, str]:
    """What a result is made with, by name, besides what is `asked` for, which is `plain`: equal ones, equal results.

    Hashes of the files that it names, and of the packages of its classes and of the plants, controllers and learners
    that it names; versions of the libraries and of Python; the processor's arithmetic.

    Raises:
        CodeError: a class whose code is in no file, or that a function made.
    """
    modules, parts = set[str](), dict[str, str]()
    for key, text in _strings(asked):
        if key != CLASS:
            parts |= _parts().get(text, {})
        elif "<locals>" in text:
            raise CodeError(f"{text}: expected a class at the top level of a module, so that its results can be kept")
        else:
            modules.add(text.partition(":")[0])
    modules |= {value.partition(":")[0] for value in parts.values()}
    code = code_of(frozenset(modules))
    return {**versions(), "arithmetic": arithmetic(), **parts, **code, **named_files(asked, hash_file)}


def named_files(asked: Any, hash_file: Callable[[Path], str] = hash_of) -> dict[str, str]:
    """Hashes of the files that it names."""
    hashes: dict[str, str] = {}
    for _, text in _strings(asked):
        if os.path.isfile(text):  # noqa: PTH113 (`Path.is_file` raises where a text is too long for a name)
            path = Path(text)
            name = "/".join(path.parts[-2:])
            hashes[str(path) if name in hashes else name] = hash_file(path)
    return hashes


def changed_since(made: Path, made_with: Mapping[str, str]) -> list[str]:
    """Note beside the file `made` with what it is made; where it exists, names that differ from what was noted."""
    path = made.with_name(MADE_WITH)
    if made.exists() and path.exists():
        try:
            return differing(json.loads(path.read_text(encoding="utf-8")), made_with)
        except (ValueError, AttributeError, TypeError):
            return [MADE_WITH]
    made.parent.mkdir(parents=True, exist_ok=True)
    replace_text(path, json.dumps(made_with, indent=1))
    return []


def differing(one: Mapping[str, str], other: Mapping[str, str]) -> list[str]:
    """Names under which two provenances are not the same."""
    return sorted(name for name in {*one, *other} if one.get(name) != other.get(name))


def key_of(asked: Any) -> str:
    """SHA-256, 16 digits, of plain data."""
    return hash_of_text(json.dumps(asked, sort_keys=True))


def _name(code: type | FunctionType) -> str:
    return f"{code.__module__}:{code.__qualname__}"


def _strings(asked: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """Names and texts of all texts."""
    if isinstance(asked, str):
        yield key, asked
    elif isinstance(asked, dict):
        for name, value in asked.items():
            yield from _strings(value, name)
    elif isinstance(asked, list):
        for value in asked:
            yield from _strings(value)


@cache
def _parts() -> dict[str, dict[str, str]]:
    """The parts that packages bring: by name, what the groups have under it."""
    parts: dict[str, dict[str, str]] = {}
    for group in PARTS:
        for part in entry_points(group=group):
            parts.setdefault(part.name, {})[f"{group} {part.name}"] = part.value
    return parts


def _git(folder: Path, *words: str) -> str:
    try:
        done = subprocess.run(["git", *words], cwd=folder, capture_output=True, text=True, check=False, timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""

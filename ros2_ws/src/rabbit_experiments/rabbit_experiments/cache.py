"""What was computed is kept: a job is found again if all that decides its result is the same.

The key of a result covers the job (every parameter of plant and controller, the content of gait and policy, the seed),
`RESULTS_VERSION` and the versions of the libraries that compute. It does not cover the source code: if you change code
so that numbers move, raise `RESULTS_VERSION`, or begin in another folder.
"""

import gzip
import json
import zlib
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, fields
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

from cbf_clf_qp.problem import Problem
from pydantic import BaseModel
from rabbit_description.atomic_file import replacing

from rabbit_experiments.assembly import Assembly
from rabbit_experiments.provenance import content_key, installed

# Raise it when the numbers of a seeded run or of a training move: after a change of the plant, the controller, the
# learner or the metrics, on purpose or by rounding. test_results_version.py fails then and says what to do.
RESULTS_VERSION = 9
COMPUTING = ("numpy", "scipy", "pin", "pybullet", "mujoco", "osqp", "daqp")


@dataclass(frozen=True)
class Job(ABC):
    """Something to compute once. Equal jobs have the same result; `title` is what the progress bar says."""

    title: str = field(default="", compare=False, kw_only=True)
    model: ClassVar[type[BaseModel]]  # of the result
    suffix: ClassVar[str] = ".json.gz"
    libraries: ClassVar[tuple[str, ...]] = COMPUTING

    @abstractmethod
    def do(self) -> Any:
        """Compute the result."""

    def identity(self) -> dict[str, Any]:
        """All that decides the result."""
        return {each.name: getattr(self, each.name) for each in fields(self) if each.compare}

    def write(self, result: Any, path: Path) -> None:
        """Put a result into a file."""
        path.write_bytes(gzip.compress(json.dumps(result.model_dump()).encode()))  # keeps NaN

    def read(self, path: Path) -> Any:
        """The result in a file; raises `OSError` or `ValueError` where there is none."""
        try:
            return self.model.model_validate(json.loads(gzip.decompress(path.read_bytes())))
        except (EOFError, zlib.error) as error:
            raise ValueError(f"{path}: {error}") from error


class JobError(RuntimeError):
    """A job that ended without a result; the others can still be done."""


def plain(value: Any) -> Any:
    """What JSON takes in place of a part of an identity."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if isinstance(value, Assembly):
        return value.identity()
    if isinstance(value, Problem):
        return value.name
    raise TypeError(f"{value!r}: expected plain data, a model or an assembly")


@cache
def stamp(libraries: tuple[str, ...] = COMPUTING) -> dict[str, Any]:
    """What decides a number besides the parameters."""
    return {"results_version": RESULTS_VERSION, "libraries": installed(libraries)}


def job_key(job: Job, as_plain: Any = plain) -> str:
    """SHA-256, 16 digits, of all that decides a job's result."""
    identity = {"job": type(job).__name__, **job.identity(), **stamp(job.libraries)}
    return content_key(identity, as_plain)


class Cache:
    """Results in files under `path`, one for each job; what decides an assembly's runs is read once."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._versions: dict[Assembly, str] = {}
        self._keys: dict[Assembly, str] = {}

    def get(self, job: Job) -> Any:
        """The job's result; None where there is none, or a file that cannot be read."""
        try:
            return job.read(self._file(job))
        except (OSError, ValueError):
            return None

    def put(self, job: Job, result: Any) -> None:
        """Keep a result."""
        path = self._file(job)
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as partial:
            job.write(result, partial)

    def key(self, job: Job) -> str:
        """See `job_key`."""
        return job_key(job, lambda value: self._key_of(value) if isinstance(value, Assembly) else plain(value))

    def policy_version(self, assembly: Assembly) -> str:
        """A hash of the policy's bytes, or its name."""
        self._key_of(assembly)
        return self._versions[assembly]

    def _key_of(self, assembly: Assembly) -> str:
        if assembly not in self._keys:
            identity = assembly.identity()
            self._keys[assembly], self._versions[assembly] = content_key(identity), identity["policy_version"]
        return self._keys[assembly]

    def _file(self, job: Job) -> Path:
        key = self.key(job)
        return self.path / key[:2] / f"{key[2:]}{job.suffix}"

"""What was computed is kept: a job is found again if all that decides its result is the same.

ROOT/AB/CDEF-MADE.json.gz    a result: ABCDEF is the hash of what was asked for, MADE that of what it was made with
ROOT/made_with/MADE.json     what that is: content of files, code, versions of libraries (`provenance`)
"""

import gzip
import json
from abc import ABC, abstractmethod
from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

from pydantic import BaseModel
from rabbit_description.atomic_file import replace_text, replacing
from rabbit_description.bounded_file import gunzip, parse_json, read_bytes

from rabbit_experiments.provenance import differing, key_of, plain, provenance
from rabbit_experiments.source_code import hash_of

MADE_WITH = "made_with"
MOST_BYTES = 200_000_000  # of a result, as text


@dataclass(frozen=True)
class Job(ABC):
    """Something to compute once; fields and class decide the result. `title` is what the progress bar says."""

    title: str = field(default="", compare=False, kw_only=True)
    model: ClassVar[type[BaseModel]]  # of the result
    suffix: ClassVar[str] = ".json.gz"

    @abstractmethod
    def do(self) -> Any:
        """Compute the result."""

    @property
    def companions(self) -> Hashable:
        """Jobs that have the same can be done at once by `do_together`; None: it is done alone."""
        return None

    @classmethod
    def do_together(cls, jobs: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
        """Each of them with its result, as it is done."""
        return ((job, job.do()) for job in jobs)

    def write(self, result: Any, path: Path) -> None:
        """Put a result into a file."""
        path.write_bytes(gzip.compress(json.dumps(result.model_dump()).encode()))  # keeps NaN

    def read(self, path: Path) -> Any:
        """The result in a file; raises `ValueError` where there is none."""
        return self.model.model_validate(parse_json(gunzip(read_bytes(path, MOST_BYTES), MOST_BYTES).decode()))


class JobError(RuntimeError):
    """A job that ended without a result; the others can still be done."""


@dataclass(frozen=True)
class JobKey:
    """Hashes of what is asked for, and of what it is made with, that is `names`."""

    asked: str
    made_with: str
    names: dict[str, str] = field(compare=False)


class Cache:
    """Results in files under `path`, one for each job. The files that jobs name are read once."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._keys: dict[Job, JobKey] = {}
        self._hash_of = cache(hash_of)

    def get(self, job: Job) -> Any:
        """The job's result; None where there is none, or a file that cannot be read."""
        try:
            return job.read(self._file(job))
        except (OSError, ValueError):
            return None

    def put(self, job: Job, result: Any) -> None:
        """Keep a result.

        Raises:
            JobError: a file that the job names has changed since its key was taken.
        """
        key, path = self.key(job), self._file(job)
        if changed := differing(key.names, provenance(plain(job))):
            raise JobError(f"{job.title}: {', '.join(changed)} changed while it was made: the result is not kept")
        about = self._about(key.made_with)
        if not about.exists():
            about.parent.mkdir(parents=True, exist_ok=True)
            replace_text(about, json.dumps(key.names, indent=1))
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as partial:
            job.write(result, partial)

    def key(self, job: Job) -> JobKey:
        """Equal keys, equal results."""
        if job not in self._keys:
            asked = plain(job)
            names = provenance(asked, self._hash_of)
            self._keys[job] = JobKey(key_of(asked), key_of(names), names)
        return self._keys[job]

    def outdated(self, jobs: Iterable[Job]) -> str:
        """How many of these were made before with something else, and with what; empty if none."""
        count, changed = 0, set[str]()
        for job in jobs:
            key, path = self.key(job), self._file(job)
            for earlier in sorted(path.parent.glob(path.name.replace(key.made_with, "*")))[:1]:
                count += 1
                about = self._about(earlier.name.removesuffix(job.suffix).rpartition("-")[2])
                try:
                    changed |= set(differing(key.names, json.loads(about.read_text(encoding="utf-8"))))
                except (OSError, ValueError):
                    changed.add("version")
        return f"{count} results here were made with another {', '.join(sorted(changed))}: made again" if count else ""

    def _about(self, made_with: str) -> Path:
        return self.path / MADE_WITH / f"{made_with}.json"

    def _file(self, job: Job) -> Path:
        key = self.key(job)
        return self.path / key.asked[:2] / f"{key.asked[2:]}-{key.made_with}{job.suffix}"

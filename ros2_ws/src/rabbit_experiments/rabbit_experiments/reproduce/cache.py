"""Results by content: a run is found again if and only if everything that decides it is the same.

The key covers plant, controller, gait and policy (`Assembly.identity`, with the policy's bytes by their hash), episode
seed, kind of run, the source files that such a run goes through, and the versions of the libraries.
"""

from pathlib import Path
from typing import Any

from rabbit_experiments import provenance
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.reproduce import jobs
from rabbit_experiments.reproduce.jobs import Job, Result
from rabbit_experiments.reproduce.source_files import sources_hash


class Cache:
    """Files under `path`, one a run."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._versions = provenance.versions()
        self._identities: dict[Assembly, dict[str, Any]] = {}

    def key(self, job: Job) -> str:
        """SHA-256, 16 digits, of what decides the run."""
        return provenance.content_key(
            {
                "kind": job.kind,
                "seed": job.seed,
                "assembly": self.identity(job.assembly),
                "judges": [self.identity(judge) for judge in job.judges],
                "code": sources_hash(*jobs.SOURCES[job.kind]),
                "versions": self._versions,
            }
        )

    def get(self, job: Job) -> Result | None:
        """The run's result, if it is there and whole; a file that cannot be read counts as none."""
        path = self._file(job)
        try:
            return jobs.load(job.kind, path) if path.is_file() else None
        except (OSError, ValueError, KeyError):
            return None

    def put(self, job: Job, result: Result) -> None:
        """Keep a result."""
        jobs.save(job.kind, result, self._file(job))

    def _file(self, job: Job) -> Path:
        key = self.key(job)
        return self.path / key[:2] / f"{key[2:]}{jobs.suffix(job.kind)}"

    def identity(self, assembly: Assembly) -> dict[str, Any]:
        """What decides an episode but for its seed, see `Assembly.identity`; read once, policy and gait too."""
        if assembly not in self._identities:
            self._identities[assembly] = assembly.identity()
        return self._identities[assembly]

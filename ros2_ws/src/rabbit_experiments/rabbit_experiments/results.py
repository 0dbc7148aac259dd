"""A folder of results that fills run by run, so that an evaluation that was stopped goes on where it stopped.

DIR/evaluation.json     what is evaluated: identity, its key, command, versions; written first
DIR/runs.csv            a row a run
DIR/violations.csv      each stance tick over the friction cone, or without a push from the ground
DIR/tick_seconds.npz    what each control tick took, by run, s
DIR/summary.json        the figures over all runs; written last
"""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any
from zipfile import BadZipFile

import numpy as np
from pydantic import BaseModel
from rabbit_description.atomic_file import replacing

from rabbit_experiments.metrics import ForceTick, RunResult, RunRow

ABOUT, RUNS, VIOLATIONS, TIMES, SUMMARY = (
    "evaluation.json",
    "runs.csv",
    "violations.csv",
    "tick_seconds.npz",
    "summary.json",
)


class ResultsError(RuntimeError):
    """A folder whose content is of another evaluation, or cannot be read."""


class ResultsFolder:
    """`results` holds the runs that are done, by number; `add` puts one on disk."""

    def __init__(self, path: Path, about: dict[str, Any], overwrite: bool = False) -> None:
        """`about["key"]` tells evaluations apart.

        Raises:
            ResultsError: the folder holds another evaluation and `overwrite` is False.
        """
        self.path = path
        self.results: dict[int, RunResult] = {}
        path.mkdir(parents=True, exist_ok=True)
        if (path / ABOUT).exists() and not overwrite:
            self._check_key(about["key"])
            self._load()
        self._write(ABOUT, lambda file: json.dump(about, file, indent=2))
        (path / SUMMARY).unlink(missing_ok=True)

    def add(self, result: RunResult) -> None:
        """Keep a run."""
        self.results[result.row.run] = result
        self._save()

    def first(self, runs: int) -> list[RunResult]:
        """The first `runs` runs, in order."""
        return [self.results[run] for run in range(runs)]

    def write_summary(self, summary: dict[str, Any]) -> None:
        """Write summary.json."""
        self._write(SUMMARY, lambda file: json.dump(summary, file, indent=2))

    def _check_key(self, key: str) -> None:
        try:
            held = json.loads((self.path / ABOUT).read_text(encoding="utf-8"))["key"]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ResultsError(f"{self.path / ABOUT} cannot be read: {error}") from error
        if held != key:
            raise ResultsError(f"{self.path}: holds another evaluation (other parameters, seed, policy or code)")

    def _load(self) -> None:
        if not (self.path / RUNS).exists():
            return
        try:
            rows = [RunRow.model_validate(row) for row in _read_csv(self.path / RUNS)]
            violations = [ForceTick.model_validate(row) for row in _read_csv(self.path / VIOLATIONS)]
            with np.load(self.path / TIMES) as times:
                seconds = {int(run): times[run] for run in times.files}
            for row in rows:
                ticks = [tick for tick in violations if tick.run == row.run]
                self.results[row.run] = RunResult(row, ticks, seconds[row.run])
        except (OSError, EOFError, ValueError, KeyError, BadZipFile) as error:
            raise ResultsError(f"{self.path}: its runs cannot be read: {error}") from error

    def _save(self) -> None:
        results = [self.results[run] for run in sorted(self.results)]
        seconds = {str(result.row.run): result.tick_seconds for result in results}
        with replacing(self.path / TIMES) as path:
            np.savez_compressed(path, **seconds)  # type: ignore[arg-type]
        violations = [tick for result in results for tick in result.violations]
        self._write(VIOLATIONS, lambda file: _write_csv(file, ForceTick, violations))
        self._write(RUNS, lambda file: _write_csv(file, RunRow, [result.row for result in results]))

    def _write(self, name: str, write: Any) -> None:
        with replacing(self.path / name) as path, path.open("w", encoding="utf-8", newline="") as file:
            write(file)


def _write_csv(file: IO[str], model: type[BaseModel], rows: Sequence[BaseModel]) -> None:
    writer = csv.DictWriter(file, fieldnames=list(model.model_fields))
    writer.writeheader()
    writer.writerows(row.model_dump() for row in rows)


def _read_csv(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))

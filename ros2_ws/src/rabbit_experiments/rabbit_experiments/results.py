"""The folder of an evaluation, which is complete after each run; one that was stopped goes on.

DIR/evaluation.json     what is evaluated, its key, and what it is made with; written first
DIR/cache/              the runs that are done
DIR/runs.csv            a row a run
DIR/violations.csv      each stance tick over the friction cone, or without a push from the ground
DIR/summary.json        the figures over all runs; written last
"""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rabbit_description.atomic_file import replace_text
from rabbit_description.bounded_file import read_json

from rabbit_experiments.cache import Cache
from rabbit_experiments.metrics import ForceTick, RunResult, RunRow
from rabbit_experiments.tables import write_rows
from rabbit_experiments.walk_records import RECORDS

PICTURES = "pictures"
ABOUT, RUNS, VIOLATIONS, SUMMARY = "evaluation.json", "runs.csv", "violations.csv", "summary.json"
MOST_BYTES = 1_000_000  # of evaluation.json


class ResultsError(RuntimeError):
    """A folder whose content is of another evaluation, or cannot be read."""


class ResultsFolder:
    """The tables of an evaluation, and the `cache` of its runs."""

    def __init__(self, path: Path, about: dict[str, Any], overwrite: bool = False) -> None:
        """`about["key"]` distinguishes evaluations; `overwrite` forgets what the folder holds.

        Tables and pictures of runs that were made with something else (`about["made_with"]`) go.

        Raises:
            ResultsError: the folder holds another evaluation.
        """
        self.path, self.cache = path, Cache(path / "cache")
        path.mkdir(parents=True, exist_ok=True)
        overwrite = overwrite and (path / ABOUT).exists()
        held = self._held() if (path / ABOUT).exists() and not overwrite else about
        if held["key"] != about["key"]:
            raise ResultsError(f"{path}: holds another evaluation (other parameters, seed or policy)")
        if overwrite:
            shutil.rmtree(self.cache.path, ignore_errors=True)
        if overwrite or held["made_with"] != about["made_with"]:
            for name in (RUNS, VIOLATIONS, RECORDS):
                (path / name).unlink(missing_ok=True)
            shutil.rmtree(path / PICTURES, ignore_errors=True)
        self.write(ABOUT, about)
        (path / SUMMARY).unlink(missing_ok=True)

    def write_runs(self, results: Sequence[RunResult]) -> None:
        """Write the tables of the runs so far."""
        write_rows(self.path / VIOLATIONS, ForceTick, [tick for result in results for tick in result.violations])
        write_rows(self.path / RUNS, RunRow, [result.row for result in results])

    def _held(self) -> Any:
        try:
            held = read_json(self.path / ABOUT, MOST_BYTES)
            return {name: held[name] for name in ("key", "made_with")}
        except (ValueError, KeyError, TypeError) as error:
            raise ResultsError(f"{self.path / ABOUT} cannot be read: {error}") from error

    def write(self, name: str, content: dict[str, Any]) -> None:
        """A JSON file of the folder."""
        replace_text(self.path / name, json.dumps(content, indent=2))

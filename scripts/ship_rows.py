"""Rows of a run become those of a shipped table; then `make figures` brings the pages up to date.

python scripts/ship_rows.py DIR/benchmark.csv studies/docs/data/benchmark_mujoco.csv

A row whose counts are the shipped one's only adds how each course ended: times of a busy machine are not taken.
"""

import sys
from pathlib import Path

from rabbit_benchmark.table import BenchmarkRow, Table


def shipped(old: BenchmarkRow | None, new: BenchmarkRow) -> BenchmarkRow:
    """The row to ship."""
    counts = {"walked", "courses", "mean_stones", "reason"}
    same = old is not None and old.model_dump(include=counts) == new.model_dump(include=counts)
    return old.model_copy(update={"by_course": new.by_course}) if old and same else new


if __name__ == "__main__":
    run, path = Table.read(Path(sys.argv[1])), Path(sys.argv[2])
    table = Table.read(path)
    for key, row in run.rows.items():
        before = table.rows.get(key)
        table.rows[key] = shipped(before, row)
        if before and before.walked != row.walked:
            print(f"{row.method}, {row.cell}: {before.walked}, now {row.walked} of {row.courses}")
    table.write(path)

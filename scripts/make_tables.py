"""`make tables`: each table of studies/tables.yaml by its command, then its rows into studies/docs; it goes on.

    make tables ARGS='masses claims'     # some of them
    COURSES=1 make tables                # few courses, into runs/tables-1; nothing is shipped

`data/tables.json` says with what each was made: commit, command, seeds, seconds, versions. `make figures` comes after.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from common import ROOT
from rabbit_description.atomic_file import replace_table, replace_text
from rabbit_description.yaml_file import read_mapping
from rabbit_experiments.provenance import versions
from rabbit_reproduce.report import read_rows

LIST, DOCS = ROOT / "studies" / "tables.yaml", ROOT / "studies" / "docs"
MADE = "data/tables.json"  # in DOCS
SECONDS = "seconds.json"  # beside the tables' folders: of all calls, by table and commit
INTERRUPTED = 130
Row = dict[str, str]


def commit() -> str:
    """The commit of the code, with `+` where files differ; those of studies/docs, which are made, do not count."""

    def git(*words: str) -> str:
        return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()

    code = ".", f":!{DOCS.relative_to(ROOT)}"
    return git("rev-parse", "--short", "HEAD") + "+" * bool(git("status", "--porcelain", "--", *code))


def make(name: str, command: str, runs: Path, at: str) -> None:
    """Run the command of a table; ends the script where it fails or is stopped."""
    begin = time.monotonic()
    (runs / name).mkdir(parents=True, exist_ok=True)
    given = {**os.environ, "OUT": os.path.relpath(runs / name, ROOT), "COMMIT": at}
    with subprocess.Popen(["bash", "-euc", command], cwd=ROOT, env=given) as process:
        try:
            ended = f"failed ({code})" if (code := process.wait()) else ""
        except KeyboardInterrupt:  # the command has it too, and ends by itself
            process.wait()
            ended = "stopped; the same call goes on from here"
    seconds = read_json(runs / SECONDS)
    seconds[f"{name} {at}"] = round(seconds.get(f"{name} {at}", 0) + time.monotonic() - begin, 1)
    replace_text(runs / SECONDS, json.dumps(seconds, indent=1))
    if ended:
        print(f"{name}: {ended}", file=sys.stderr)
        sys.exit(INTERRUPTED if ended.startswith("stopped") else 1)


def ship(about: Mapping[str, Any], out: Path, docs: Path) -> None:
    """Put what a table ships to its place, several files of rows as one; print what changed."""
    for pattern, target in about["ships"].items():
        files = sorted(out.glob(pattern))
        if not target.endswith(".csv"):
            for file in files:
                place = docs / target / file.relative_to(out)
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_bytes(file.read_bytes())
            continue
        several = {file: {"folder": file.parent.name} if "*" in pattern else {} for file in files}
        rows = [folder | row for file, folder in several.items() for row in read_rows(file)]
        kept = ("folder", *about.get("columns", [name for row in rows for name in row]))
        for line in changes(read_rows(docs / target), rows):
            print(f"{target}: {line}")
        (docs / target).parent.mkdir(parents=True, exist_ok=True)
        replace_table(docs / target, ({name: row[name] for name in row if name in kept} for row in rows))


def changes(before: Sequence[Row], after: Sequence[Row]) -> Iterable[str]:
    """For each method that walks another number of courses in some cell: all that it walked, and walks now."""
    old, new = ({tuple(map(row.get, ("folder", "method", "cell"))): row for row in rows} for rows in (before, after))
    common = [key for key in new if key in old and "walked" in old[key]]
    differ = Counter(key[1] for key in common if old[key]["walked"] != new[key]["walked"])
    for method, cells in differ.items():
        one, two = (sum(int(t[key]["walked"] or 0) for key in common if key[1] == method) for t in (old, new))
        yield f"{method}: {one:,}, now {two:,}; other in {cells} cells"


def read_json(path: Path) -> dict[str, Any]:
    """What a file holds; nothing where there is none."""
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}


def main() -> None:
    """Make all, then ship all: so each has the same commit."""
    few = os.environ.get("COURSES")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="tables (default: all)")
    parser.add_argument("--list", type=Path, default=LIST, help="of tables; of another one nothing is shipped")
    parser.add_argument("--runs", type=Path, default=ROOT / "runs" / ("tables" + f"-{few}" * bool(few)))
    given = parser.parse_args()
    tables, code, runs = read_mapping(given.list), commit(), given.runs.resolve()
    names = given.names or list(tables)
    if unknown := [name for name in names if name not in tables]:
        parser.error(f"{unknown[0]}: expected one of {', '.join(tables)}")
    docs = runs / "docs" if few or given.list != LIST else DOCS
    for number, name in enumerate(names, 1):
        print(f"{name} ({number} of {len(names)}), at {code}", flush=True)
        make(name, tables[name]["command"], runs, code)
    made, seconds = read_json(docs / MADE), read_json(runs / SECONDS)
    for name in names:
        ship(tables[name], runs / name, docs)
        about = {"commit": code, "date": f"{datetime.now(UTC):%Y-%m-%d}", "seconds": seconds[f"{name} {code}"]}
        about |= {"cores": os.cpu_count(), "versions": versions()}
        made[name] = about | {key: tables[name][key] for key in ("seeds", "command")}
    replace_text(docs / MADE, json.dumps(made, indent=1) + "\n")


if __name__ == "__main__":
    main()

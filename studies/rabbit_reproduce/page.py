"""Make experiments: their runs, their reports, and the page over all: a line for each claim, then each experiment."""

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from rabbit_description.atomic_file import replace_text
from rabbit_experiments.cache import Cache
from rabbit_experiments.engine import run
from rabbit_experiments.tables import markdown_table

from rabbit_reproduce.experiment import Experiment, catalogued
from rabbit_reproduce.report import CLAIMS, RUNS, Verdict, read_rows
from rabbit_reproduce.table_lines import Results, Size

PAGE = "results.md"
Row = dict[str, str]


def make(
    experiments: Sequence[Experiment],
    size: Size,
    out: Path,
    names: Sequence[str],
    processes: int | str = 1,
) -> tuple[Path, int]:
    """Run what the cache in `out` lacks, then write; the page begins with those of `names` that `out` holds.

    What is stopped by Ctrl-C leaves the experiments whose runs are complete.

    Returns:
        The page, and how many runs were made.
    """
    cache = Cache(out / "cache")
    try:
        done = run([job for experiment in experiments for job in experiment.jobs(size)], cache, processes)
    except KeyboardInterrupt:
        _write([e for e in experiments if all(cache.get(job) for job in e.jobs(size))], cache, size, out)
        write_page(out, names)
        raise
    _write(experiments, cache, size, out)
    return write_page(out, names), done


def _write(experiments: Sequence[Experiment], cache: Cache, size: Size, out: Path) -> None:
    for experiment in experiments:
        experiment.report(Results(cache, size)).write(out)


def write_page(out: Path, names: Sequence[str]) -> Path:
    """`results.md` from the claims that `out` holds, those of the experiments `names` first, in this order."""
    groups: dict[str, list[Row]] = {name: [] for name in names}
    for row in read_rows(out / CLAIMS):
        groups.setdefault(row["experiment"], []).append(row)
    rows = [row for group in groups.values() for row in group]
    foot = Path(__file__).with_name("how_to_read.md").read_text(encoding="utf-8")
    sections = "".join(_section(out, group) for group in groups.values() if group)
    replace_text(out / PAGE, f"# The paper, reproduced\n\n{_overview(rows)}\n## The experiments\n\n{sections}\n{foot}")
    return out / PAGE


def _overview(rows: Sequence[Row]) -> str:
    """The paper's claims in one table, and how many came to what."""
    others = sorted({row["plant"] for row in rows} - {"pybullet"})
    judged_on = f"Judged on `{'`, `'.join(others)}`.\n\n" if others else ""
    claims = [row for row in rows if row["verdict"] != Verdict.OPEN]
    both = [row for row in claims if row["on_rigid"]]
    counts = f"{len(claims)} claims of the paper: {_counted(row['verdict'] for row in claims)}."
    beside = (
        f" {len(both)} of them are also judged on `rigid`: {_counted(row['on_rigid'] for row in both)}; in PyBullet "
    )
    beside += f"these are: {_counted(row['verdict'] for row in both)}."
    fallen = sum(map(_falls, claims))
    falling = f" Of those reproduced, {fallen} fall with the nominal controller at its best." if fallen else ""
    lines = [
        (_place(row), row["claim"], row["paper"], row["ours"], f"**{row['verdict']}**", row["on_rigid"], _at_best(row))
        for row in claims
    ]
    heads = ("where", "claim", "paper", "ours", "verdict", "on rigid", "nominal at its best")
    table = markdown_table(heads, [[cell.replace("|", "\\|") for cell in line] for line in lines])
    ours = f"Every run is in [{RUNS}]({RUNS}). "
    ours += f"[{CLAIMS}]({CLAIMS}) has {len(rows) - len(claims)} more of which the paper says nothing.\n"
    return f"{judged_on}{counts}{beside * bool(both)}{falling}\n\n{table}\n{ours * (len(rows) > len(claims))}"


def _place(row: Row) -> str:
    """The label alone where it is a figure's, or the section's with the experiment."""
    return row["label"] if row["label"].startswith("fig:") else f"{row['label']}, {row['experiment']}"


def _falls(row: Row) -> bool:
    return row["undone"] == "True" and row["verdict"] == Verdict.REPRODUCED


def _at_best(row: Row) -> str:
    return f"{row['tuned']}. **Falls**" if _falls(row) else row["tuned"]


def _counted(verdicts: Iterable[str]) -> str:
    return ", ".join(f"{verdict} {number}" for verdict, number in Counter(verdicts).most_common())


def _section(out: Path, rows: Sequence[Row]) -> str:
    """The section of an experiment: what it is, why it differs, its files and its command."""
    about, first = catalogued().get(rows[0]["experiment"], {}), rows[0]
    name = first["experiment"]
    differs = any(row["verdict"] not in (Verdict.REPRODUCED, Verdict.OPEN) for row in rows)
    why = f" {about['why']}" if about.get("why") and differs and first["plant"] == "pybullet" else ""
    files = ", ".join(
        f"[{about.get('caption', path.name).strip('.') if path.suffix == '.png' else path.name}]({name}/{path.name})"
        for path in sorted((out / name).glob("*.*"))
    )
    return f"- **{name}** ({first['label']}): {first['title']}.{why} `{first['command']}`{files and ': '}{files}\n"

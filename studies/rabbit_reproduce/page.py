"""Make experiments: their runs, their reports, and the page over all: every claim with its verdict, then each."""

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from rabbit_description.atomic_file import replace_text
from rabbit_experiments.cache import Cache
from rabbit_experiments.engine import run

from rabbit_reproduce.experiment import Experiment
from rabbit_reproduce.report import Report, Table, Verdict, read_report
from rabbit_reproduce.table_lines import Found, Size

PAGE = "results.md"
HEAD = """# The paper, reproduced

Made by `rabbit reproduce`; [what the columns mean](#how-to-read-it) is at the end.

"""
FOOT = """## How to read it

- **Verdicts.** *reproduced*: every part of the claim holds; *partly*: some; *not*: none; *shows nothing*: it holds, but
  the nominal controller passes the same test, so learning is not what did it; *no claim*: the paper has no number.
  A controller "walks" if nine of ten runs reach the end of the course with no miss and no fall.
- **Cells.** Walked of runs (Wilson's 95% interval), then mean stones, on flat ground steps, before the first miss or
  fall. Means have Student's 95% interval.
- **Columns.** Four plants: PyBullet and `rigid` (the paper's own kind: pinned foot, impact map), each with the paper's
  motor lag of 4 ms and without. Verdicts are those of PyBullet with lag; those "on rigid" are the same claim's on
  `rigid` with lag, from fewer runs, where these were made. A row's command makes its first column; add
  `--motor-lag 0`, `--plant rigid` or both for the others.
- **Forces.** Ratios and ticks over the cone count from 30 ms after an impact on. `runs.csv` has a line for each row
  and column with all figures.
- **Learned controllers** have the policies that a section names: shipped ones, or, where its command has `--retrain`,
  those that it trained. They were trained at mass scale 2, without lag, where nothing else is said.
"""


def make(
    experiments: Sequence[Experiment],
    size: Size,
    out: Path,
    names: Sequence[str],
    jobs: int = 1,
) -> tuple[Path, int]:
    """Run what the cache in `out` lacks, then write; the page has all of `names` that `out` holds.

    What is stopped by Ctrl-C leaves the experiments whose runs are complete.

    Returns:
        The page, and how many runs were made.
    """
    cache = Cache(out / "cache")
    try:
        done = run([job for each in experiments for job in each.jobs(size)], cache, jobs)
    except KeyboardInterrupt:
        _write([each for each in experiments if all(cache.get(job) for job in each.jobs(size))], cache, size, out)
        write_page(out, names)
        raise
    _write(experiments, cache, size, out)
    return write_page(out, names), done


def _write(experiments: Sequence[Experiment], cache: Cache, size: Size, out: Path) -> None:
    for experiment in experiments:
        report, figures = experiment.report(Found(cache, size))
        report.write(out, figures)


def write_page(out: Path, names: Sequence[str]) -> Path:
    """`results.md` from the reports that `out` holds of the experiments `names`, in this order."""
    reports = [report for name in names if (report := read_report(out / name))]
    path = out / PAGE
    replace_text(path, HEAD + _overview(reports) + "".join(map(_section, reports)) + FOOT)
    return path


def _overview(reports: Sequence[Report]) -> str:
    """All claims in one table, and how many came to what."""
    claims = [(report, claim) for report in reports for claim in report.claims]
    settings = {json.dumps(report.setting) for report in reports if report.setting}
    setting = "".join(f"Setting: `{each}`.\n\n" for each in sorted(settings))
    both = [claim for _, claim in claims if claim.on_rigid]
    counts = f"{len(claims)} claims: {_counted(claim.verdict for _, claim in claims)}."
    beside = (
        f" {len(both)} of them are also judged on `rigid`: {_counted(claim.on_rigid for claim in both)}; in PyBullet "
    )
    beside += f"these are: {_counted(claim.verdict for claim in both)}."
    rows = tuple(
        (f"[{report.label}](#{report.name})", c.claim, c.paper, c.ours, f"**{c.verdict}**", c.on_rigid)
        for report, c in claims
    )
    table = Table(name="claims", columns=("where", "claim", "paper", "ours", "verdict", "on rigid"), rows=rows)
    return f"{setting}{counts}{beside if both else ''}\n\n{table.markdown}\n"


def _counted(verdicts: Iterable[Verdict | None]) -> str:
    return ", ".join(f"{verdict} {number}" for verdict, number in Counter(verdicts).most_common())


def _section(report: Report) -> str:
    runs = "reduced runs (`--quick`)" if report.quick else "full runs"
    command = f"rabbit reproduce {report.name}{' --quick' * report.quick}{' --retrain' * report.retrained}"
    command += " --setting FILE" * bool(report.setting)
    figures = "".join(_figure(report, name, caption) for name, caption in report.figures.items())
    tables = "".join(f"{table.markdown}\n" for table in report.tables if not table.long)
    long = ", ".join(f"[{table.name}.csv]({report.name}/{table.name}.csv)" for table in report.tables)
    commit = f"{report.commit[:12] or 'unknown'}{'+' * report.commit.endswith('+')}"
    policies = ", ".join(f"{name} `{version}`" for name, version in report.policies.items()) or "none"
    return f"""## {report.name}

**{report.title}** ({report.label}). The paper: {report.paper}

{_why(report)}{figures}{tables}Data: {long}. Commit `{commit}`, {runs}.
Policies: {policies}. `{command}` makes this section.

"""


def _why(report: Report) -> str:
    """Only where something is not as in the paper."""
    differs = any(claim.verdict not in (Verdict.REPRODUCED, Verdict.OPEN) for claim in report.claims)
    return f"**Where it differs.** {report.why}\n\n" if report.why and differs and not report.setting else ""


def _figure(report: Report, name: str, caption: str) -> str:
    base = f"{report.name}/{name}"
    return f"![{caption}]({base}.png)\n\n*{caption}* ([PDF]({base}.pdf))\n\n"

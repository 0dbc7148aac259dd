"""Make experiments: their runs, their reports, and the page over all: every claim with its verdict, then each."""

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from rabbit_description.atomic_file import replace_text
from rabbit_experiments.cache import Cache
from rabbit_experiments.engine import run

from rabbit_reproduce.experiment import Experiment
from rabbit_reproduce.report import WIDTHS, Claim, Report, Table, Verdict, read_report
from rabbit_reproduce.table_lines import Found, Size

PAGE = "results.md"
BATCH = 64  # runs in MuJoCo that a process walks at once
HEAD = """# The paper, reproduced

Made by `rabbit reproduce`; [what the columns mean](#how-to-read-it) is at the end.

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
        done = run([job for each in experiments for job in each.jobs(size)], cache, jobs, batch=BATCH)
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
    path, foot = out / PAGE, Path(__file__).with_name("how_to_read.md").read_text(encoding="utf-8")
    replace_text(path, HEAD + _overview(reports) + "".join(map(_section, reports)) + foot)
    return path


def _overview(reports: Sequence[Report]) -> str:
    """All claims in one table, and how many came to what."""
    claims = [(report, claim) for report in reports for claim in report.claims]
    others = sorted({report.plant for report in reports} - {"pybullet"})
    judged_on = f"Judged on `{'`, `'.join(others)}`.\n\n" if others else ""
    both = [claim for _, claim in claims if claim.on_rigid]
    counts = f"{len(claims)} claims: {_counted(claim.verdict for _, claim in claims)}."
    beside = (
        f" {len(both)} of them are also judged on `rigid`: {_counted(claim.on_rigid for claim in both)}; in PyBullet "
    )
    beside += f"these are: {_counted(claim.verdict for claim in both)}."
    rows = tuple(
        (f"[{report.label}](#{report.name})", c.claim, c.paper, c.ours, f"**{c.verdict}**", c.on_rigid, _at_best(c))
        for report, c in claims
    )
    columns = ("where", "claim", "paper", "ours", "verdict", "on rigid", "nominal at its best")
    table = Table(name="claims", columns=columns, rows=rows)
    undone = sum(claim.undone for _, claim in claims if claim.verdict is Verdict.REPRODUCED)
    falling = f" Of those reproduced, {undone} fall with the nominal controller at its best." if undone else ""
    return f"{judged_on}{counts}{beside if both else ''}{falling}\n\n{table.markdown}\n"


def _at_best(claim: Claim) -> str:
    falls = claim.undone and claim.verdict is Verdict.REPRODUCED
    return f"{claim.tuned}. **The claim falls with it**" if falls else claim.tuned


def _counted(verdicts: Iterable[Verdict | None]) -> str:
    return ", ".join(f"{verdict} {number}" for verdict, number in Counter(verdicts).most_common())


def _for_paper(folder: str, name: str) -> str:
    """Links to a figure in each width."""
    links = [
        f"{width.strip('-').replace('-', ' ')} [PDF]({folder}/{name}{width}.pdf), [SVG]({folder}/{name}{width}.svg)"
        for width in WIDTHS
        if width
    ]
    return "; ".join(links)


def _section(report: Report) -> str:
    runs = "reduced runs (`--quick`)" if report.quick else "full runs"
    command = f"rabbit reproduce {report.name}{' --quick' * report.quick}{' --retrain' * report.retrained}"
    is_other = report.plant != "pybullet"
    command += f" --plant {report.plant}" * is_other
    figures = "".join(
        f"![{caption}]({report.name}/{name}.png)\n\n*{caption}* (For a paper: {_for_paper(report.name, name)}.)\n\n"
        for name, caption in report.figures.items()
    )
    differs = any(claim.verdict not in (Verdict.REPRODUCED, Verdict.OPEN) for claim in report.claims)
    why = f"**Where it differs.** {report.why}\n\n" if report.why and differs and not is_other else ""
    tables = "".join(f"{table.markdown}\n" for table in report.tables if not table.long)
    long = ", ".join(f"[{table.name}.csv]({report.name}/{table.name}.csv)" for table in report.tables)
    commit = f"{report.commit[:12] or 'unknown'}{'+' * report.commit.endswith('+')}"
    policies = ", ".join(f"{name} `{version}`" for name, version in report.policies.items()) or "none"
    return f"""## {report.name}

**{report.title}** ({report.label}). The paper: {report.paper}

{why}{figures}{tables}Data: {long}. Commit `{commit}`, {runs}.
Policies: {policies}. `{command}` makes this section.

"""

"""Tables over lines: one to read, and one with every figure of every line and plant."""

from collections.abc import Sequence

from rabbit_bringup.experiments.summary import falls
from rabbit_bringup.reproduce.commands import evaluate_command
from rabbit_bringup.reproduce.lines import COLUMNS, Found, Line
from rabbit_bringup.reproduce.report import Cell, Table
from rabbit_bringup.reproduce.walks import SEED, Case, Walks

SUMMED = (
    *("ticks", "ticks_over_cone", "ticks_over_cone_at_impact", "ticks_lost", "ticks_lost_at_impact"),
    *("missed_stones", "saturated_ticks", "slack_ticks", "rescue_ticks", "qp_unanswered_ticks"),
    "ecbf_start_violations",
)


def walk_table(lines: Sequence[Line], found: Found) -> Table:
    """What, the paper's figure, each plant, forces and the command."""
    paper = ("paper",) * any(line.paper for line in lines)
    columns = ("what", *paper, *(column.title for column in COLUMNS), "over cone, lost", "largest ratio", "command")
    rows: list[tuple[Cell, ...]] = []
    for line in lines:
        main = found.walks(line)
        forces = f"{main.total('ticks_over_cone')}, {main.total('ticks_lost')} of {main.total('ticks')}"
        cells = [found.walks(line, column).text for column in COLUMNS]
        command = f"`{evaluate_command(line.case(found.size))}`"
        rows.append((line.what, *((line.paper,) * len(paper)), *cells, forces, f"{main.max_ratio:.2f}", command))
    return Table(name="walks", columns=columns, rows=tuple(rows))


def long_table(lines: Sequence[Line], found: Found) -> Table:
    """A row for each line and plant."""
    columns = (
        *("what", "plant", "motor_lag", "policy", "seed", "runs", "walked", "low95", "high95", "walked_with_forces"),
        *("mean_stones", "mean_low95", "mean_high95", "std_stones", "max_force_ratio", "rms_y", "rms_dy"),
        *(*SUMMED, "falls", "command"),
    )
    cases = [(line, column, line.case(found.size, column)) for line in lines for column in COLUMNS]
    rows = tuple(_long_row(line.what, case, found.walks(line, column), found) for line, column, case in cases)
    return Table(name="runs", columns=columns, rows=rows, long=True)


def _long_row(what: str, case: Case, walks: Walks, found: Found) -> tuple[Cell, ...]:
    plant, policy = case.assembly.simulation, found.policy(case.assembly)
    return (
        *(what, plant.plant, plant.motor_lag, policy, SEED, walks.runs, walks.walked),
        *(*walks.interval, walks.with_forces, walks.mean_stones, *(walks.stones_interval or (None, None))),
        *(walks.std_stones, walks.max_ratio, walks.rms("rms_y"), walks.rms("rms_dy")),
        *(walks.total(name) for name in SUMMED),
        "; ".join(f"{kind} {count}" for kind, count in sorted(falls(walks.rows).items())),
        evaluate_command(case),
    )

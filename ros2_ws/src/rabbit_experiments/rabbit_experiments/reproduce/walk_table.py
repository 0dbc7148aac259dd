"""Tables over lines: one to read, and one with every figure of every line and plant."""

from collections.abc import Sequence

from rabbit_experiments.command_lines import evaluate_command
from rabbit_experiments.reproduce.report import Cell, Table
from rabbit_experiments.reproduce.table_lines import COLUMNS, Column, Found, Line
from rabbit_experiments.reproduce.verdict import Verdict

SUMMED = (
    *("ticks", "ticks_over_cone", "ticks_over_cone_at_impact", "ticks_lost", "ticks_lost_at_impact"),
    *("missed_stones", "saturated_ticks", "slack_ticks", "rescue_ticks", "qp_unanswered_ticks"),
    "ecbf_start_violations",
)


def walk_table(lines: Sequence[Line], found: Found) -> Table:
    """What, the paper's figure, each plant, whether it shows nothing, forces and the command."""
    plants = [column for column in COLUMNS if any(column in line.columns for line in lines)]
    paper, nominal = any(line.paper for line in lines), any(line.nominal for line in lines)
    columns = (
        *("what", *("paper",) * paper, *(column.title for column in plants), *("shows",) * nominal),
        *("over cone, lost", "largest ratio", "command"),
    )
    rows: list[tuple[Cell, ...]] = []
    for line in lines:
        main = found.walks(line)
        forces = f"{main.total('ticks_over_cone')}, {main.total('ticks_lost')} of {main.total('ticks')}"
        cells = [found.walks(line, column).text if column in line.columns else None for column in plants]
        command = f"`{evaluate_command(line.scenario(found.size))}`"
        head = (line.what, *(line.paper,) * paper, *cells, *(shows(line, found),) * nominal)
        rows.append((*head, forces, f"{main.max_ratio:.2f}", command))
    return Table(name="walks", columns=columns, rows=tuple(rows))


def shows(line: Line, found: Found) -> str | None:
    """Of a line that walks: whether it shows anything, the nominal controller passing too or not."""
    if line.nominal is None or not found.walks(line).passes:
        return None
    return str(Verdict.NOTHING) if found.walks(line.nominal).passes else "nominal fails"


def long_table(lines: Sequence[Line], found: Found) -> Table:
    """A row for each line and plant."""
    columns = (
        *("what", "plant", "motor_lag", "policy", "seed", "runs", "walked", "low95", "high95", "walked_with_forces"),
        *("mean_stones", "mean_low95", "mean_high95", "std_stones", "max_force_ratio", "rms_y", "rms_dy"),
        *(*SUMMED, "falls", "command"),
    )
    rows = tuple(_long_row(line, column, found) for line in lines for column in line.columns)
    return Table(name="runs", columns=columns, rows=rows, long=True)


def _long_row(line: Line, column: Column, found: Found) -> tuple[Cell, ...]:
    walks, scenario = found.walks(line, column), line.scenario(found.size, column)
    policy = found.policy(scenario.assembly)
    return (
        *(line.what, column.plant, column.lag, policy, scenario.seed, walks.runs, walks.walked),
        *(*walks.interval, walks.with_forces, walks.mean_stones, *(walks.stones_interval or (None, None))),
        *(walks.std_stones, walks.max_ratio, walks.rms("rms_y"), walks.rms("rms_dy")),
        *(walks.total(name) for name in SUMMED),
        "; ".join(f"{kind} {count}" for kind, count in sorted(walks.falls.items())),
        evaluate_command(scenario),
    )

"""A small campaign of faults, the same each time: what must hold after each, holds."""

import json
from pathlib import Path
from typing import Any

import pytest
from rabbit_campaigns.faults.plan import KINDS, NODES, RESULTS, SECOND, Fault, draw, read_results
from rabbit_campaigns.ros.fault_campaign import run_session

FAULTS = [
    Fault(0, "kill", "controller", 20, 0.0),
    Fault(1, "kill", "simulator", 30, 0.5),
    Fault(2, "kill", "trainer", 10, 0.0),
    Fault(3, "stop", "simulator", 15, 3.0),
    Fault(4, "terminate", SECOND, 60, 0.0),
    Fault(5, "kill", SECOND, 60, 0.0),
    Fault(6, "terminate", "recorder", 20, 0.5),  # was there from the begin
    Fault(7, "full disk", "recorder", 40, 0.0),  # began in the middle
    Fault(8, "messages", "trainer", 5, 0.5),
]
RECORDERS = [fault.number for fault in FAULTS if fault.node in ("recorder", SECOND)]


@pytest.mark.timeout(1500)
def test_every_fault_is_survived(tmp_path: Path) -> None:
    shown: list[dict[str, Any]] = []
    rows = run_session(tmp_path, 1, FAULTS, shown.append)
    assert all(row["passed"] for row in rows), json.dumps(rows[-1])
    assert [row["number"] for row in rows] == [fault.number for fault in FAULTS]
    assert rows == shown == read_results(tmp_path)
    outcomes = [row["episode"].split(":")[0] for row in rows]
    assert outcomes[0] in ("fault", "silent")  # by how long the new controller takes
    assert outcomes[1] == "reset"
    assert outcomes[3] not in ("silent", "fault")  # while the simulator stood still, nobody was late
    assert rows[-1]["acknowledged"] > 0
    assert [row["number"] for row in rows if row.get("recorded_ticks", 0) > 0 and not row["strangers"]] == RECORDERS


def test_a_campaign_is_drawn_from_its_seed() -> None:
    faults = [draw(5, number) for number in range(300)]
    assert faults == [draw(5, number) for number in reversed(range(300))][::-1]
    assert faults != [draw(6, number) for number in range(300)]
    assert {fault.kind for fault in faults} == set(KINDS)
    assert {fault.node for fault in faults if fault.kind == "kill"} == {*NODES, SECOND}


def test_a_cut_line_is_left_out(tmp_path: Path) -> None:
    (tmp_path / RESULTS).write_text('{"number": 0}\n{"number": 1')
    assert read_results(tmp_path) == [{"number": 0}]

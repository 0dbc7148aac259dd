"""The list of tables: it is complete, and a table that was stopped goes on to the same rows."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
from rabbit_benchmark.cells import chosen
from rabbit_benchmark.methods import variants
from rabbit_description.yaml_file import read_mapping

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "studies" / "docs"
TABLES = read_mapping(ROOT / "studies" / "tables.yaml")
FEW = """
few:
  seeds: 9001
  command: |
    for eps in 0.04 0.05; do
      rabbit evaluate --controller clf-qp --eps $eps --stones 1 --runs 6 --jobs 1 --out $OUT/$eps
    done
  ships: {"*/runs.csv": data/few.csv}
  columns: [run, stones, success, max_force_ratio]
"""


def test_every_shipped_table_is_in_the_list_and_what_is_said_to_be_made_is_there() -> None:
    assert {*DOCS.glob("data/*.csv")} <= {DOCS / file for table in TABLES.values() for file in table["ships"].values()}
    made = json.loads((DOCS / "data" / "tables.json").read_text(encoding="utf-8"))
    assert made.keys() <= TABLES.keys()
    for name in made:
        assert [target for target in TABLES[name]["ships"].values() if not (DOCS / target).exists()] == []


@pytest.mark.parametrize("name", TABLES)
def test_a_command_names_what_there_is(name: str) -> None:
    """Programs parse, examples and cells are there, and so are methods with their parameters."""
    command = TABLES[name]["command"]
    subprocess.run(["bash", "-n", "-c", command], check=True)
    for task in re.findall(r"\bfor task in ([^;]*);", command):
        assert all((ROOT / "examples" / f"{word}.py").is_file() for word in task.split())
    for cells in re.findall(r"(?<=--cells )'?([a-z][\w,*/-]+)|(?<=INSIDE=')([^']*)", command):
        assert chosen("".join(cells).split(","))
    for word in command.split() if "rabbit benchmark" in command else ():
        if re.match(r"(best|nominal|oracle|identified)[\w-]*(:[^$]*)?$", word):
            assert variants(word)


def test_a_queue_on_two_cores_ends_as_a_pencil_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """Four jobs of 1 s, given out 10 ms apart: the second core begins at 20 ms and walks twice."""
    monkeypatch.syspath_prepend(ROOT / "scripts")
    from cluster_cost import Nothing, queue

    hours, busy = queue({Nothing(number): 1.0 for number in range(4)}, 1, 2)
    assert hours * 3600 == pytest.approx(2.02)
    assert busy == pytest.approx(4 / (2 * 2.02))
    hours, busy = queue({Nothing(0): 0.001}, 1000, 4)  # faster than they are given out, four at once
    assert hours * 3600 == pytest.approx(2.504)
    assert busy == pytest.approx(1 / (4 * 2.504))


def test_tables_that_are_made_leave_the_commit_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "scripts")
    import make_tables

    monkeypatch.setattr(make_tables, "ROOT", tmp_path)
    monkeypatch.setattr(make_tables, "DOCS", tmp_path / "docs")
    for file in (made := tmp_path / "docs" / "made.csv"), (code := tmp_path / "code.py"):
        file.parent.mkdir(exist_ok=True)
        file.write_text("1")
    git = ["git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@b"]
    for words in (["init", "-q"], ["add", "."], ["commit", "-qm", "both"]):
        subprocess.run([*git, *words], check=True)
    made.write_text("2")
    assert not make_tables.commit().endswith("+")
    code.write_text("2")
    assert make_tables.commit().endswith("+")


@pytest.mark.timeout(600)
def test_a_table_that_was_stopped_goes_on_to_the_same_rows(tmp_path: Path) -> None:
    (listed := tmp_path / "tables.yaml").write_text(FEW)
    command = [sys.executable, "-B", str(ROOT / "scripts" / "make_tables.py"), "--list", str(listed), "--runs"]
    stopped, whole = tmp_path / "stopped", tmp_path / "whole"
    process = subprocess.Popen(
        [*command, str(stopped)],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
    )
    rows = stopped / "few" / "0.04" / "runs.csv"
    while process.poll() is None and not (rows.is_file() and rows.read_text().count("\n") > 2):
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    assert "goes on" in process.communicate()[1]
    assert process.returncode == 130
    assert not (stopped / "docs").exists()
    for runs in (stopped, whole):
        subprocess.run([*command, str(runs)], check=True, stdout=subprocess.DEVNULL)
    one, other = ((runs / "docs" / "data" / "few.csv").read_text() for runs in (stopped, whole))
    assert one == other
    assert one.count("\n") == 13
    about = json.loads((stopped / "docs" / "data" / "tables.json").read_text())["few"]
    assert about["seeds"] == 9001
    assert about["commit"].rstrip("+") in subprocess.check_output(["git", "rev-parse", "HEAD"], cwd=ROOT, text=True)

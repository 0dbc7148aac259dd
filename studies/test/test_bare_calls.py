"""A bare call of what takes long lists what there is, how long it takes and how to begin; what begins shows a bar."""

import re
from pathlib import Path
from typing import Any

import pytest
from rabbit_bringup.cli import app, commands
from rabbit_experiments import engine
from rabbit_experiments.cache import Cache
from typer.testing import CliRunner

LONG = {
    **{
        "benchmark": "rabbit benchmark all",
        "reproduce": "rabbit reproduce all",
        "misses": "rabbit misses --fit-plants ",
    },
    **{"speed": "rabbit speed --plants 40", "soak": "rabbit soak --minutes 60"},
    **{"jitter": "rabbit jitter --minutes 10", "residual": "rabbit residual --ticks 6000000"},
    "rival end-to-end": "rabbit rival end-to-end --ticks 20000000",
}


@pytest.mark.parametrize("command", LONG)
def test_a_bare_call_begins_nothing(command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, command.split())
    assert result.exit_code == 0, result.output
    assert f"    {LONG[command]}" in result.output
    assert list(tmp_path.iterdir()) == []


def test_the_size_of_a_benchmark_is_the_courses_of_its_cells(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    said = CliRunner().invoke(app, ["benchmark"]).output
    methods, cells, courses = (
        int(each.replace(",", "")) for each in re.findall(r"\b[\d,]+(?= (?:methods|cells|courses))", said)[:3]
    )
    assert said.count("(") >= cells
    assert 10 * cells < courses <= 10 * methods * cells * 10  # ten of a cell, a storm's ten times as many


def test_every_command_that_has_a_bare_text_is_here() -> None:
    found = set()
    for name, entry in commands().items():
        code = Path(__import__(entry.module, fromlist=["app"]).__file__ or "").read_text(encoding="utf-8")
        found |= {name} if "tell_if_bare(" in code else set()
    assert found == {each.split()[0] for each in LONG}


def test_the_bar_is_there_while_the_cache_is_looked_through(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """To look for 66,240 results takes minutes."""
    begun: list[bool] = []

    class Bar(engine.Progress):
        def start(self) -> None:
            begun.append(True)
            super().start()

    class Looked(Cache):
        def key(self, job: Any) -> str:
            assert begun
            return str(job)

        def get(self, job: Any) -> Any:
            return job

        def outdated(self, jobs: Any) -> str:
            return ""

    monkeypatch.setattr(engine, "Progress", Bar)
    jobs: Any = ["one", "two", "one"]
    assert engine.run(jobs, Looked(tmp_path)) == 0

"""examples/read_recording.py reads what the recorder writes."""

import runpy
import sys
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "read_recording.py"


def test_it_reads_all_ticks_and_draws_them(
    walk, write_bag, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(tmp_path / "bag")
    monkeypatch.setattr(sys, "argv", ["read_recording.py", str(bag)])
    seen = runpy.run_path(str(EXAMPLE))
    assert [tick.state.tick for tick in walk.records] == seen["ticks"].tolist()
    assert [tick.output.V for tick in walk.records] == seen["V"].tolist()
    said = capsys.readouterr().out
    assert f"episode 1: walked, {len(walk.records)} ticks" in said
    assert "policies: ['zero']" in said
    assert (tmp_path / "bag-episode-1.png").stat().st_size > 1000

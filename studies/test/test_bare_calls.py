"""A bare call of what takes long lists what there is, how long it takes and how to begin; what begins shows a bar."""

from pathlib import Path

import pytest
from rabbit_bringup.cli import app
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

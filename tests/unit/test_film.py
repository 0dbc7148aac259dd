"""`rabbit video BAG`: a film of what was recorded; examples/read_recording.py reads it."""

import runpy
import sys
from collections.abc import Callable
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest
from rabbit_viewer.commands.video import app
from rabbit_viewer.scene import SIZE
from typer.testing import CliRunner

WriteBag = Callable[..., Path]


def test_a_recording_becomes_mp4_and_gif(tmp_path: Path, write_bag: WriteBag) -> None:
    done = CliRunner().invoke(app, [str(write_bag(tmp_path / "bag")), "--speed", "4"])
    assert done.exit_code == 0, done.output
    assert done.output.splitlines() == [str(tmp_path / "bag.mp4"), str(tmp_path / "bag.gif")]
    frames = imageio.imread(tmp_path / "bag.mp4", plugin="FFMPEG")
    assert frames.shape[1:] == (SIZE[1], SIZE[0], 3)
    assert np.abs(frames[0].astype(int) - frames[-1]).max() > 100
    assert len(imageio.imread(tmp_path / "bag.gif", index=None)) > 1


@pytest.mark.parametrize("words", [("nowhere",), (".",), ("bag", "--episode", "9")])
def test_no_walk_is_one_line(
    tmp_path: Path, write_bag: WriteBag, words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    write_bag(tmp_path / "bag")
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty" if words == (".",) else tmp_path)
    done = CliRunner().invoke(app, [*words])
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1), done.output


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

"""`rabbit video BAG`: a film of what was recorded."""

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

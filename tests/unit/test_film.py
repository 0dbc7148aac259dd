"""`rabbit video BAG`: a film of what was recorded."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest
from rabbit_experiments.walk_records import RECORDS, save_records
from rabbit_viewer.commands.video import app
from rabbit_viewer.scene import SIZE
from rabbit_viewer.walk_pictures import records_of_bag
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


def test_a_recording_in_a_runs_folder_has_the_plant_of_the_run(tmp_path: Path, write_bag: WriteBag) -> None:
    """A recording alone does not say how steep the ground was; the run's records beside it do."""
    alone = records_of_bag(write_bag(tmp_path / "recording"))
    assert "slope" not in alone.about
    inside = write_bag(tmp_path / "run" / "recording")
    save_records(replace(alone, about={**alone.about, "slope": 5.0, "R2": 9.0}), tmp_path / "run" / RECORDS)
    for source in (inside, next(inside.glob("*.mcap"))):
        about = records_of_bag(source).about
        assert about["slope"] == 5.0
        assert about["R2"] == alone.about["R2"]  # the controller's are in the recording


@pytest.mark.parametrize("words", [("nowhere",), (".",), ("bag", "--episode", "9")])
def test_no_walk_is_one_line(
    tmp_path: Path, write_bag: WriteBag, words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    write_bag(tmp_path / "bag")
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty" if words == (".",) else tmp_path)
    done = CliRunner().invoke(app, [*words])
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1), done.output

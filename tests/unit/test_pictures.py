"""What pictures and films show: the ground as it is; files that open."""

import runpy
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import imageio.v3 as imageio
import numpy as np
import pytest
from rabbit_experiments.evaluation import record_walk
from rabbit_experiments.walk_records import RECORDS, WalkRecords, save_records
from rabbit_recording import RecordingError
from rabbit_viewer import video
from rabbit_viewer.commands.video import app
from rabbit_viewer.scene import SIZE, Scene
from rabbit_viewer.walk_pictures import draw_pictures, records_of
from typer.testing import CliRunner
from walked import make_assembly


def walk_on(controller: str) -> WalkRecords:
    """Two steps."""
    return record_walk(make_assembly(controller, stones=2), seed=1)


@pytest.mark.parametrize("controller", ["cbf-clf-qp", "clf-qp"])
def test_every_picture_opens(controller: str, tmp_path: Path) -> None:
    save_records(walk_on(controller), tmp_path / RECORDS)
    pictures = draw_pictures(tmp_path)
    assert [picture.stem for picture in pictures] == ["walk", "swing_foot", "rows", "quantities"]
    for picture in pictures:
        assert imageio.imread(picture).std() > 1  # not blank


def test_a_slope_is_drawn_as_steep_as_it_is() -> None:
    """On flat ground the stance foot's ground is a level line; on a slope of 20 degrees it rises by their tangent."""
    flat = walk_on("clf-qp")
    tops = []
    for slope in (0.0, 20.0):
        picture = Scene(replace(flat, about={**flat.about, "slope": slope}), has_legend=False).frame(0)[260:, :, :3]
        ground = (picture.astype(int) - 0x8C).__abs__().max(axis=2) < 8  # the stones' grey
        tops.append([np.flatnonzero(ground[:, column])[0] for column in (300, 660)])
    assert tops[0][0] == tops[0][1]
    rise = (tops[1][0] - tops[1][1]) / 360
    assert rise == pytest.approx(np.tan(np.radians(20.0)), abs=0.02)


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


def test_an_episode_of_a_run_is_that_of_its_recording(walk: Any, tmp_path: Path, write_bag: WriteBag) -> None:
    save_records(walk_on("clf-qp"), tmp_path / RECORDS)
    with pytest.raises(RecordingError):
        records_of(tmp_path, 1)
    write_bag(tmp_path / "recording")
    assert records_of(tmp_path, 1).tick.tolist() == [record.state.tick for record in walk.records]
    assert len(records_of(tmp_path).tick) != len(walk.records)


def test_walks_with_other_ticks_are_filmed_at_one_pace(monkeypatch: pytest.MonkeyPatch) -> None:
    """The rows of a walk and of one with ticks twice as long, in each frame to the end of the second."""
    shown: dict[float, list[int]] = {0.01: [], 0.02: []}

    def scene(walk: Any, has_legend: bool) -> Any:
        def frame(row: int) -> Any:
            shown[walk.tick_seconds].append(row)
            return np.zeros((1, 1, 4))

        return SimpleNamespace(fall=None, frame=frame)

    monkeypatch.setattr(video, "Scene", scene)
    lengths = ((101, 0.01), (41, 0.02))
    walks: Any = [SimpleNamespace(tick=range(ticks), tick_seconds=seconds) for ticks, seconds in lengths]
    list(video._frames(walks, speed=1.0))
    for row, other in zip(*shown.values(), strict=True):
        assert other == min(row // 2, 40)
    assert shown[0.01][-1] == 100


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

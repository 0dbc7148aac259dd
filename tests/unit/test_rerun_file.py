"""A recording for Rerun's viewer, read back with Rerun's own reader."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rabbit_experiments.evaluation import RecordedWalk
from rabbit_recording.commands.bag import app
from rabbit_viewer.rerun_file import explain_run
from rabbit_viewer.walk_pictures import records_of
from typer.testing import CliRunner
from walked import make_assembly


def test_a_recording_is_written_for_rerun(tmp_path: Path, write_bag: Callable[..., Path]) -> None:
    chunk = pytest.importorskip("rerun.chunk", reason="rerun-sdk is not installed")
    bag, path = write_bag(tmp_path / "bag"), tmp_path / "walk.rrd"
    done = CliRunner().invoke(app, ["rerun", str(bag), "--out", str(path)])
    assert done.exit_code == 0, done.output
    reader, walk = chunk.RrdReader(str(path)), records_of(bag)
    assert [len(reader.recordings()), len(reader.blueprints())] == [1, 1]
    told: dict[str, Any] = {}
    for part in reader.stream():
        columns = part.to_record_batch()
        for name in (name for name in columns.schema.names if ":" in name):
            told.setdefault(part.entity_path, {}).setdefault(name, []).extend(columns.column(name).to_pylist())
    for name, values in zip(walk.barrier_names, walk.barriers.T, strict=True):
        np.testing.assert_array_equal(np.ravel(told[f"/barriers/{name}"]["Scalars:scalars"]), values)
    assert np.ravel(told["/torques/limit1"]["Scalars:scalars"]).tolist() == [200, 200]
    (V,) = [part.to_record_batch() for part in reader.stream() if part.entity_path == "/V/V" and not part.is_static]
    np.testing.assert_allclose(1e-9 * V.column("time").cast("int64").to_numpy(), walk.time, atol=1e-9)
    legs = np.array(told["/side/stance"]["LineStrips2D:strips"])[:, 0]  # ticks; hip, knee, foot; x, -z
    np.testing.assert_allclose(legs[:, 0], np.stack([0 * walk.time, -walk.q[:, 1]], axis=1), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(np.diff(legs, axis=1), axis=2), 0.4, atol=1e-6)  # thigh and shin
    assert "gives way multiplier" in told["/explanation"]["TextDocument:text"][0][0]


def test_a_run_is_explained_where_it_needed_most_slack() -> None:
    job = RecordedWalk(make_assembly("cbf-clf-qp", stones=2, mass_scale=2.0), 1)
    worst = int(job.do().rescue_slack.argmax())
    title, _, *rows = explain_run(job).splitlines()
    assert worst > 0
    assert title.startswith(f"seed 1, tick {worst} ")
    assert any("last resort, gives way" in row for row in rows)


def test_without_rerun_one_line_says_what_to_install(
    tmp_path: Path, write_bag: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    done = CliRunner().invoke(app, ["rerun", str(write_bag(tmp_path / "bag"))])
    assert done.exit_code == 2
    assert "rerun-sdk is not installed: pip install" in done.output

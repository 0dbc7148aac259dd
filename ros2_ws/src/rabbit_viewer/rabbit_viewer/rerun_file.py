"""A run or a recording as a file for Rerun's viewer (`.rrd`): the robot from the side, and in plots what was decided.

The view follows the hip and, as Rerun's flat views do, has y downwards: x from the hip, -z, m. It needs rerun-sdk,
which is imported only here.
"""

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import numpy as np
from rabbit_description.bounded_file import exists
from rabbit_description.state import Array
from rabbit_experiments.evaluation import RecordedWalk, parts
from rabbit_experiments.evaluation import episode as run
from rabbit_experiments.walk_records import RECORDS, WalkRecords
from rabbit_recording import RecordingError
from rabbit_recording.explaining import explain_tick, explain_walk, worst_of
from rl_trainer.rollout import Moment, Record

from rabbit_viewer.geometry import box, force_arrow, legs_of, spans_until, stone_spans, torso_points
from rabbit_viewer.pictures import panels
from rabbit_viewer.walk_pictures import bag_of, place_of, records_of

BLUE, ORANGE, GREEN, PURPLE, RED, GREY = 0x0072B2FF, 0xE69F00FF, 0x009E73FF, 0xCC79A7FF, 0xD55E00FF, 0x8C8C8CFF
COLOURS = {"stance": BLUE, "swing": ORANGE, "torso": GREY, "force": RED, "stones": GREY}
RADII = {"stance": 0.012, "swing": 0.008, "torso": 0.016, "force": 0.006}  # m
CLOCK, SIDE, WHY = "time", "side", "explanation"  # a time line and two entities
LIMIT = "limit"


class RerunError(RuntimeError):
    """The file cannot be written; the message is one line."""


def write_rerun(
    source: Path, out: Path | None = None, episode: int | None = None, job: RecordedWalk | None = None
) -> Path:
    """Write a run's folder or a recording, by default to walk.rrd in the folder or SOURCE.rrd next to a recording.

    `job`: what the folder's run was made by; without it only a recording is explained.

    Raises:
        RerunError: rerun-sdk is not installed.
        RecordsError, RecordingError: as in `draw_pictures`.
    """
    try:
        rr, blueprint = map(import_module, ("rerun", "rerun.blueprint"))
    except ImportError as error:
        raise RerunError("rerun-sdk is not installed: pip install 'rabbit_viewer[rerun]'") from error
    walk, path = records_of(source, episode), out or place_of(source, "walk.rrd", ".rrd")
    plotted = {f"/{panel.title.split()[0]}": panel for panel in panels(walk)}
    views = [blueprint.TimeSeriesView(origin=origin, name=panel.title) for origin, panel in plotted.items()]
    bounds = blueprint.VisualBounds2D(x_range=(-1.2, 1.2), y_range=(-1.6, 0.3))
    side = blueprint.Spatial2DView(origin=SIDE, name=str(walk.about.get("title", "")), visual_bounds=bounds)
    half = (len(views) + 1) // 2
    above = blueprint.Horizontal(side, blueprint.Vertical(*views[:half]), blueprint.Vertical(*views[half:]))
    why = blueprint.TextDocumentView(origin=WHY, name=WHY)  # as wide as its table
    layout = blueprint.Blueprint(blueprint.Vertical(above, why, row_shares=[3, 2]), collapse_panels=True)
    with rr.RecordingStream("rabbit", recording_id=path.stem) as file:
        file.save(path, default_blueprint=layout)
        for row, shapes in enumerate(scenes(walk)):
            file.set_time(CLOCK, duration=walk.time[row])
            for name, lines in shapes.items():
                look = {"radii": RADII.get(name, 0.004), "colors": COLOURS[name]}
                file.log(f"{SIDE}/{name}", rr.LineStrips2D(lines, **look))
        for origin, panel in plotted.items():
            for i, (name, values) in enumerate(panel.curves.items()):
                colour = (BLUE, ORANGE, GREEN, PURPLE)[i % 4]
                file.log(f"{origin}/{name}", rr.SeriesLines(colors=colour, names=name), static=True)
                column = rr.TimeColumn(CLOCK, duration=walk.time)
                file.send_columns(f"{origin}/{name}", [column], rr.Scalars.columns(scalars=values))
            for i, limit in enumerate(panel.limits):
                ends = rr.TimeColumn(CLOCK, duration=walk.time[[0, -1]])
                file.log(f"{origin}/{LIMIT}{i}", rr.SeriesLines(colors=RED, names=LIMIT), static=True)
                file.send_columns(f"{origin}/{LIMIT}{i}", [ends], rr.Scalars.columns(scalars=[limit, limit]))
        text = f"```text\n{explain_run(job) if job else explanation(source, episode)}\n```"
        file.log(WHY, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)
    return path


def scenes(walk: WalkRecords) -> Iterator[dict[str, list[Array]]]:
    """The lines (k, 2) of each tick by name, x from the hip and -z, m."""
    legs, torso, spans = legs_of(walk), torso_points(walk.q), stone_spans(walk)
    for row, stance in enumerate(walk.stance):
        foot = legs[stance, row, 2]
        lines = {
            "stones": [np.array(box(*span)) for span in spans_until(walk, spans, row)],
            "swing": [legs[1 - stance, row]],
            "stance": [legs[stance, row]],
            "torso": [torso[row]],
            "force": [np.stack([foot, foot + force_arrow(walk.stance_force[row])])],
        }
        hip = np.array([walk.q[row, 0], 0.0])
        yield {name: [(line - hip) * (1, -1) for line in several] for name, several in lines.items()}


def explanation(source: Path, episode: int | None) -> str:
    """The tick with the most slack of last resort, in words; why there is none, where it cannot be replayed."""
    bag = bag_of(source)
    if exists(bag / RECORDS):
        return "Only a recording can be explained, not the arrays of a run."
    try:
        return "\n".join(explain_tick(bag, None, episode).lines())
    except RecordingError as error:
        return str(error)


def explain_run(job: RecordedWalk) -> str:
    """Likewise of a run, walked again; why there is none, where no solver answered."""
    moments = dict[int, Moment]()
    with parts(job.assembly) as (simulation, controller):

        def observe(record: Record) -> None:
            moments[record.state.tick] = Moment.of(controller, record)

        run(simulation, controller, job.seed, observe)
        of, worst, seconds = f"seed {job.seed}", worst_of(moments), simulation.tick_seconds
        try:
            return "\n".join(explain_walk(of, controller.qp, moments, worst, seconds).lines())
        except ValueError as error:
            return str(error)

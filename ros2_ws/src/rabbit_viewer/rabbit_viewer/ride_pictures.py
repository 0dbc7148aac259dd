"""Pictures of rides: margins of many, all rows of one with their limits, and a film of what `draw` makes of it."""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from cbf_clf_qp.functions import Array
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from rabbit_description.task import ControlTask, Line, Shape
from rabbit_experiments.task_rides import RideRow
from rl_trainer.rollout import Moment
from rl_trainer.task_episode import Ride

from rabbit_viewer import style
from rabbit_viewer.page.ride import RideRows, pictured
from rabbit_viewer.panels import COLOURS, LINEAR, LOG, Panel, draw_panels
from rabbit_viewer.video import FRAME_RATE, encode

FILM_INCHES, FILM_DPI, FILM_SECONDS = 6.4, 100, 12.0
ROOM = 0.1  # around what is drawn, of its size


def draw_margins(task: ControlTask, rides: Mapping[str, Sequence[RideRow]], path: Path) -> Path:
    """Least values of the barriers in all rides, by controller; rides that failed have none. Impacts, if any."""
    names = [barrier.name for barrier in task.barriers]
    with style.look():
        figure, panels = style.figure(len(names) + (task.impact is not None))
        for i, axes in enumerate(panels):
            for k, ridden in enumerate(rides.values()):
                margins = [ride.margins[i] if ride.outcome == "done" else np.nan for ride in ridden if i < len(names)]
                values = margins or [ride.impacts for ride in ridden]
                places = k + np.linspace(-0.2, 0.2, len(values))
                axes.plot(places, values, "o", color=COLOURS[k % len(COLOURS)], markersize=4)
            if i < len(names):
                axes.set(ylabel=f"{names[i]}, least B")
                style.limit(axes, 0.0, "limit")
            else:
                axes.set(ylabel="impacts")
            axes.set_xticks(range(len(rides)), [Path(name).stem for name in rides])
            style.legend(axes)
        return style.save(figure, path)


def draw_ride(ride: Ride, folder: Path, form: str = "png", video: bool = True) -> Iterator[Path]:
    """Draws a ride's rows, then, of a task that has `draw`, its film if wanted; raises `VideoError`."""
    yield draw_rows(ride, folder / f"rows.{form}")
    if ride.task.draw and video:
        yield from film(ride, folder / "ride.mp4")


def draw_rows(ride: Ride, path: Path) -> Path:
    """The page's panels over time, but for those of one row of the QP."""
    maker = RideRows(ride.task)
    table = np.array([maker.row(k, moment) for k, moment in enumerate(ride.moments)])
    values = dict(zip(maker.columns, table.T, strict=True))
    panels = []
    for panel in maker.panels(ride.has_qp):
        if panel["columns"] and "of" not in panel:
            curves = {re.sub("^(u|x|slack)_", "", name): values[name] for name in panel["columns"]}
            panels.append(Panel(panel["title"], curves, panel.get("limits", ()), LOG if panel.get("log") else LINEAR))
    return draw_panels(panels, np.array([moment.output.step_time for moment in ride.moments]), path, ride.title)


def film(ride: Ride, path: Path) -> list[Path]:
    """What `draw` makes of each state of the first 12 s, in axes that hold all of it; raises `VideoError`."""
    task = ride.task
    step = max(1, round(1 / (FRAME_RATE * task.seconds)))
    shown = [(m, pictured(task, m.x, m.p)) for m in ride.moments[: round(FILM_SECONDS / task.seconds) : step]]
    corners = np.concatenate([corners_of(shape) for _, shapes in shown for shape in shapes])
    low, high = corners.min(axis=0), corners.max(axis=0)
    room = ROOM * (high - low).max()
    (left, bottom), (right, top) = low - room, high + room
    size = round(FILM_INCHES * FILM_DPI)
    with style.look():
        figure, (axes,) = style.figure(1, FILM_INCHES, FILM_INCHES)
        figure.set_dpi(FILM_DPI)

        def frames() -> Iterator[memoryview]:
            for moment, shapes in shown:
                axes.clear()
                axes.set_title(title_of(ride, moment), loc="left")
                axes.set(aspect="equal", xlabel="x (m)", ylabel="z (m)", xlim=(left, right), ylim=(bottom, top))
                draw_shapes(axes, shapes)
                figure.canvas.draw()
                yield memoryview(bytes(figure.canvas.buffer_rgba()))  # type: ignore[attr-defined]  # of Agg

        return encode(frames(), (size, size), path)


def title_of(ride: Ride, moment: Moment) -> str:
    """Which ride, when, and the value of each barrier."""
    values = zip(ride.task.barriers, moment.output.barriers, strict=True)
    told = (f"{barrier.name}: {value:.3f}" for barrier, value in values)
    return "\n".join([f"{ride.task.name}, {ride.controller}, {moment.output.step_time:.1f} s", *told])


def corners_of(shape: Shape) -> Array:
    """Points (k, 2) that a picture must hold."""
    if isinstance(shape, Line):
        return np.asarray(shape.points, dtype=float)
    centre = np.asarray(shape.centre, dtype=float)
    return np.array([centre - shape.radius, centre + shape.radius])


def draw_shapes(axes: Axes, shapes: Sequence[Shape]) -> None:
    """What a task's `draw` gave."""
    for shape in shapes:
        if isinstance(shape, Line):
            axes.plot(*np.asarray(shape.points).T, color=shape.colour, linewidth=shape.width)
        else:
            axes.add_patch(Circle(tuple(shape.centre), shape.radius, color=shape.colour))

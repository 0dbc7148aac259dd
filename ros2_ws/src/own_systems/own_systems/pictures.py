"""Pictures of rides: margins of many, all rows of one with their limits, and a film of what `draw` makes of it."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from cbf_clf_qp.functions import Array
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from rabbit_viewer import style
from rabbit_viewer.video import FRAME_RATE, encode

from own_systems.episode import Moment, Ride
from own_systems.shapes import Line
from own_systems.task import ControlTask

COLOURS = (style.BLUE, style.ORANGE, style.GREEN, style.PURPLE, style.SKY)
FILM_INCHES, FILM_DPI, FILM_SECONDS = 6.4, 100, 12.0
ROOM = 0.1  # around what is drawn, of its size


def draw_margins(task: ControlTask, rides: Mapping[str, Sequence[Ride]], path: Path) -> Path:
    """Each barrier's least value in each ride, by controller; rides that failed have none. Impacts, if any."""
    names = [each.name for each in task.barriers]
    with style.look():
        figure, panels = style.figure(len(names) + (task.impact is not None))
        for i, axes in enumerate(panels):
            for k, each in enumerate(rides.values()):
                margins = [ride.margins[i] if ride.outcome == "done" else np.nan for ride in each if i < len(names)]
                values = margins or [ride.impacts for ride in each]
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


def draw_ride(ride: Ride, path: Path) -> Path:
    """Barriers, V, inputs with their limit, slacks over time."""
    task, time = ride.task, np.array([each.time for each in ride.moments])
    decided = [each.decided.values.slack if each.decided else np.zeros(0) for each in ride.moments]
    has_qp = all(each.decided for each in ride.moments)
    has_clf = has_qp and "V" in task.tick.names
    wanted = {"barriers": bool(task.barriers), "V": has_clf, "u": True, "slack": has_qp}
    rows = [name for name, is_there in wanted.items() if is_there]
    with style.look():
        figure, panels = style.figure(len(rows), height=1.9)
        axes = dict(zip(rows, panels, strict=True))
        if task.barriers:
            plot(axes["barriers"], time, np.array([m.barriers for m in ride.moments]), [b.name for b in task.barriers])
            style.limit(axes["barriers"], 0.0, "limit")
        plot(axes["u"], time, np.array([m.u for m in ride.moments]), task.names_of_u)
        if task.limit is not None:
            style.limit(axes["u"], task.limit, "limit")
            style.limit(axes["u"], -task.limit, "")
        if has_clf:
            plot(axes["V"], time, np.array([m.seen.V for m in ride.moments]), ["V"])
        if has_qp:
            plot(axes["slack"], time, np.array(decided), task.tick.layout.names)
        for name, each in axes.items():
            each.set_ylabel(name)
            style.legend(each, 5)
        panels[-1].set_xlabel("time (s)")
        figure.suptitle(f"{task.name}, {ride.controller}, seed {ride.seed}: {ride.outcome}")
        return style.save(figure, path)


def plot(axes: Axes, time: Array, values: Array, names: Sequence[str]) -> None:
    """Columns over time; of rows with one name, such as slacks of both bounds, the greatest."""
    for i, name in enumerate(dict.fromkeys(names)):
        columns = [k for k, each in enumerate(names) if each == name]
        axes.plot(time, values[:, columns].max(axis=1), color=COLOURS[i % len(COLOURS)], label=name)


def film(ride: Ride, path: Path) -> list[Path]:
    """What `draw` makes of each state of the first 12 s, in axes that hold all of it; raises `VideoError`."""
    task = ride.task
    assert task.draw
    step = max(1, round(1 / (FRAME_RATE * task.seconds)))
    shown = ride.moments[: round(FILM_SECONDS / task.seconds) : step]
    drawn = [task.draw(m.x, dict(zip(task.system.named, m.p, strict=True))) for m in shown]
    titles = [title_of(ride, m) for m in shown]
    corners = np.concatenate([points for shapes in drawn for points in map(corners_of, shapes)])
    low, high = corners.min(axis=0), corners.max(axis=0)
    room = ROOM * (high - low).max()
    size = round(FILM_INCHES * FILM_DPI)
    with style.look():
        figure, (axes,) = style.figure(1, FILM_INCHES, FILM_INCHES)
        figure.set_dpi(FILM_DPI)
        limits: dict[str, Any] = {"xlim": (low[0] - room, high[0] + room), "ylim": (low[1] - room, high[1] + room)}
        return encode(frames(figure, axes, drawn, titles, limits), (size, size), path)


def title_of(ride: Ride, moment: Moment) -> str:
    """Which ride, when, and the value of each barrier."""
    values = zip(ride.task.barriers, moment.barriers, strict=True)
    told = (f"{each.name}: {value:.3f}" for each, value in values)
    return "\n".join([f"{ride.task.name}, {ride.controller}, {moment.time:.1f} s", *told])


def corners_of(shape: Any) -> Array:
    """Points (k, 2) that a picture must hold."""
    if isinstance(shape, Line):
        return np.asarray(shape.points, dtype=float)
    centre = np.asarray(shape.centre, dtype=float)
    return np.array([centre - shape.radius, centre + shape.radius])


def frames(
    figure: Any, axes: Axes, drawn: Sequence[Sequence[Any]], titles: Sequence[str], limits: Mapping[str, Any]
) -> Iterator[memoryview]:
    """A picture of each with its title; RGBA."""
    for shapes, title in zip(drawn, titles, strict=True):
        axes.clear()
        axes.set_title(title, loc="left")
        axes.set(aspect="equal", xlabel="x (m)", ylabel="z (m)", **limits)
        for shape in shapes:
            if isinstance(shape, Line):
                axes.plot(*np.asarray(shape.points).T, color=shape.colour, linewidth=shape.width)
            else:
                axes.add_patch(Circle(tuple(shape.centre), shape.radius, color=shape.colour))
        figure.canvas.draw()
        yield memoryview(bytes(figure.canvas.buffer_rgba()))

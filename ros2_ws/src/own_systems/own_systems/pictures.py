"""Pictures of rides: margins of many, all rows of one with their limits, and a film of what `draw` makes of it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from cbf_clf_qp.functions import Array
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from rabbit_viewer import style
from rabbit_viewer.video import FRAME_RATE, encode

from own_systems.episode import Moment, Ride
from own_systems.shapes import Line, Shape
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


@dataclass(frozen=True)
class Panel:
    """Some rows of a ride: `values` (ticks, k) of `names` (k,), and limits, in their own units."""

    name: str
    names: Sequence[str]
    values: Array
    limits: tuple[float, ...] = ()


def panels_of(ride: Ride) -> list[Panel]:
    """Barriers, V, inputs with their limit, slacks; of rows with one name, such as both bounds', the greatest slack."""
    task, moments = ride.task, ride.moments
    panels = []
    if task.barriers:
        names = [each.name for each in task.barriers]
        panels.append(Panel("barriers", names, np.array([m.barriers for m in moments]), (0.0,)))
    limits = () if task.limit is None else (task.limit, -task.limit)
    inputs = Panel("u", task.names_of_u, np.array([m.u for m in moments]), limits)
    decided = [m.decided for m in moments if m.decided]
    if len(decided) < len(moments):
        return [*panels, inputs]
    if "V" in task.tick.names:
        panels.append(Panel("V", ["V"], np.array([m.seen.V for m in moments])))
    slacks, rows = np.array([each.values.slack for each in decided]), np.array(task.tick.layout.names)
    names = list(dict.fromkeys(rows.tolist()))
    greatest = np.column_stack([slacks[:, rows == name].max(axis=1) for name in names])
    return [*panels, inputs, Panel("slack", names, greatest)]


def draw_ride(ride: Ride, path: Path) -> Path:
    """The panels over time."""
    time, panels = [each.time for each in ride.moments], panels_of(ride)
    with style.look():
        figure, places = style.figure(len(panels), height=1.9)
        for panel, axes in zip(panels, places, strict=True):
            for i, (name, values) in enumerate(zip(panel.names, panel.values.T, strict=True)):
                axes.plot(time, values, color=COLOURS[i % len(COLOURS)], label=name)
            for i, limit in enumerate(panel.limits):
                style.limit(axes, limit, "" if i else "limit")
            axes.set_ylabel(panel.name)
            style.legend(axes, 5)
        places[-1].set_xlabel("time (s)")
        figure.suptitle(ride.title)
        return style.save(figure, path)


def drawn(ride: Ride, seconds: float = np.inf) -> tuple[int, list[Sequence[Shape]]]:
    """What `draw` makes of every so many ticks: how many, and the pictures of the first `seconds`."""
    task = ride.task
    assert task.draw
    step = max(1, round(1 / (FRAME_RATE * task.seconds)))
    shown = ride.moments[: round(min(seconds, task.duration) / task.seconds) : step]
    return step, [task.draw(m.x, dict(zip(task.system.named, m.p, strict=True))) for m in shown]


def box_of(shapes: Sequence[Shape]) -> Array:
    """The corners (2, 2) of what holds all of them, and some room."""
    corners = np.concatenate([corners_of(shape) for shape in shapes])
    low, high = corners.min(axis=0), corners.max(axis=0)
    room = ROOM * (high - low).max()
    return np.array([low - room, high + room])


def film(ride: Ride, path: Path) -> list[Path]:
    """What `draw` makes of each state of the first 12 s, in axes that hold all of it; raises `VideoError`."""
    step, pictures = drawn(ride, FILM_SECONDS)
    titles = [title_of(ride, m) for m in ride.moments[::step][: len(pictures)]]
    (left, bottom), (right, top) = box_of([shape for shapes in pictures for shape in shapes])
    size = round(FILM_INCHES * FILM_DPI)
    with style.look():
        figure, (axes,) = style.figure(1, FILM_INCHES, FILM_INCHES)
        figure.set_dpi(FILM_DPI)
        limits: dict[str, Any] = {"xlim": (left, right), "ylim": (bottom, top)}
        return encode(frames(figure, axes, pictures, titles, limits), (size, size), path)


def title_of(ride: Ride, moment: Moment) -> str:
    """Which ride, when, and the value of each barrier."""
    values = zip(ride.task.barriers, moment.barriers, strict=True)
    told = (f"{each.name}: {value:.3f}" for each, value in values)
    return "\n".join([f"{ride.task.name}, {ride.controller}, {moment.time:.1f} s", *told])


def corners_of(shape: Shape) -> Array:
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

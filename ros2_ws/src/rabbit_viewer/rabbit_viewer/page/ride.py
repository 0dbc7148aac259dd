"""A ride on the page in the browser: ticks as rows of numbers, with the QP's rows and what `draw` makes of a state."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from cbf_clf_qp.functions import Array
from matplotlib.colors import to_rgb
from rabbit_description.task import ControlTask, Line, Shape
from rabbit_recording.explaining import explain_ride
from rl_trainer.rollout import Moment
from rl_trainer.task_episode import Ride

from rabbit_viewer.page.recording import Recorded, show
from rabbit_viewer.page.rows import EVENTS
from rabbit_viewer.state_picture import state_picture

OF_A_ROW = ("margin", "active", "slack", "multiplier")  # of the QP
COMMON = ("tick", "running", "events", "touchdowns")  # of all that the page shows


class RideRows:
    """`row` gives a tick's numbers in the order of `columns`, NaN where there is none; `about` describes the columns.

    Two rows of the QP may share a name, such as the bounds of one input. The page shows the smallest margin and the
    largest slack of the two. `most` numbers hold a picture; the page does not show what a larger picture draws beyond.
    """

    def __init__(self, task: ControlTask, most: int = 0) -> None:
        self.task, self._most = task, most
        self._rows = list(dict.fromkeys(task.tick.layout.names))
        of = np.array(task.tick.layout.names)
        self._places = [np.flatnonzero(of == name) for name in self._rows]
        self._barriers = [barrier.name for barrier in task.barriers]
        self._inputs = [f"u_{name}" for name in task.names_of_u]
        self._states = [] if task.draw else [f"x_{name}" for name in task.names_of_x]
        of_rows = [f"{kind}_{name}" for kind in OF_A_ROW for name in self._rows]
        shapes = [f"shape{i}" for i in range(most)]
        self.columns = [*COMMON, "V", *self._barriers, *self._inputs, *self._states, *of_rows, *shapes]

    def about(self, name: str, title: str, has_qp: bool) -> dict[str, Any]:
        """Describes one controller's rides for the page."""
        known = {"name": name, "title": title, "columns": self.columns, "quantities": [], "barriers": self._barriers}
        note = {} if self.task.draw else {"note": state_picture(self.task).note}
        return {**known, **note, "panels": self.panels(has_qp), "shapes": self._most}

    def panels(self, has_qp: bool) -> list[dict[str, Any]]:
        """What is plotted together: a title, columns, limits; without a QP there is less."""
        limits = [] if self.task.limit is None else [-self.task.limit, self.task.limit]
        slacks = [f"slack_{self._rows[i]}" for i in range(len(self._rows)) if not self._is_limit(i)]
        panels: list[dict[str, Any]] = [
            *([{"title": "state x", "columns": self._states}] if self._states else []),
            {"title": "barriers B", "columns": self._barriers, "limits": [0]},
            {"title": "input u", "columns": self._inputs, "limits": limits},
            {"title": "V", "columns": ["V"] if "V" in self.task.tick.names else [], "log": True},
            {"title": "slack", "columns": slacks},
            {"title": "what a row leaves", "of": "row", "columns": ["margin", "active"], "limits": [0]},
            {"title": "what it costs", "of": "row", "columns": ["multiplier"]},
        ]
        return panels if has_qp else panels[: 2 + bool(self._states)]

    def _is_limit(self, i: int) -> bool:
        return bool(self._places[i][0] >= len(self.task.tick.layout.names) - self.task.tick.limits)

    def row(self, tick: int, moment: Moment, running: bool = True) -> list[float]:
        """The row of a moment."""
        output, events = moment.output, EVENTS["saturated"] * moment.output.saturated
        numbers = [float(tick), float(running), float(events), float(moment.state.touchdowns), output.V]
        numbers += [*output.barriers.tolist(), *output.torque.tolist()]
        numbers += moment.x.tolist() if self._states else []
        if output.rows:
            numbers += [float(output.margins[at].min()) for at in self._places]
            numbers += [0.0 if name in output.active else np.nan for name in self._rows]
            numbers += [float(output.slacks[at].max()) for at in self._places]
            numbers += [float(np.abs(output.multipliers[at]).max()) for at in self._places]
        else:
            numbers += [np.nan] * (len(OF_A_ROW) * len(self._rows))
        return numbers + numbers_of(pictured(self.task, moment.x, moment.p), self._most)


def pictured(task: ControlTask, x: Array, p: Array) -> Sequence[Shape]:
    """What `draw` makes of a state; of a task without, the state in a plane."""
    if task.draw is None:
        return state_picture(task).shapes(x, p)
    return task.draw(x, dict(zip(task.system.named, p, strict=True)))


def numbers_of(shapes: Sequence[Shape], most: int | None = None) -> list[float]:
    """A picture as numbers: of each shape how many points (a disc has none), colour, width or radius, then x, z; NaN
    fills up to `most`."""
    numbers = list[float]()
    for shape in shapes:
        points = np.atleast_2d(np.asarray(shape.points if isinstance(shape, Line) else shape.centre, dtype=float))
        red, green, blue = (round(255 * part) for part in to_rgb(shape.colour))
        count, size = (len(points), shape.width) if isinstance(shape, Line) else (0, shape.radius)
        new = [float(count), float(red << 16 | green << 8 | blue), float(size), *points.ravel().tolist()]
        if most is not None and len(numbers) + len(new) > most:
            break
        numbers += new
    return numbers if most is None else numbers + [np.nan] * (most - len(numbers))


def show_ride(ride: Ride, port: int, opens_browser: bool, export: Path | None) -> None:
    """Serve a ride until Ctrl-C, or write it to the file `export`; raises `PageError`."""
    task = ride.task
    maker = RideRows(task, max(len(numbers_of(pictured(task, m.x, m.p))) for m in ride.moments))
    rows = [maker.row(k, moment) for k, moment in enumerate(ride.moments)]
    walker = maker.about(ride.controller, ride.title, ride.has_qp)
    walk = Recorded(ride.title, task.seconds, walker, rows, ended_of(ride))
    show(walk, lambda tick: explain_ride(ride, tick).lines(), port, opens_browser, export)


def ended_of(ride: Ride) -> dict[str, Any]:
    """How a ride ended, for the page: in words, and in which tick a barrier was least."""
    how: dict[str, Any] = {"outcome": ride.outcome, "stones": ride.impacts}
    if not ride.moments:
        return how
    sentences = [f"{ride.controller}: {ride.outcome}" + (f", {ride.reason}" if ride.reason else "")]
    values = ride.barriers
    for barrier, of in zip(ride.task.barriers, values.T, strict=True):
        least, tick = float(of.min()), int(of.argmin())
        word = "kept" if least >= -ride.task.tolerance else "broken"
        sentences.append(f"{barrier.name} {word}, at least {least:.3g} at {tick * ride.task.seconds:.2f} s")
    worst, newest = int(values.min(axis=1).argmin()) if values.size else len(ride.moments), len(ride.moments) - 1
    return {**how, "reason": "; ".join(sentences) + ".", "tick": min(worst, newest)}

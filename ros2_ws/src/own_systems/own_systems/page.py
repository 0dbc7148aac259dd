"""A ride as one HTML file that opens from disk: its rows with their limits, and what `draw` makes of each state."""

import json
from importlib.resources import files
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import to_hex
from rabbit_viewer.page.files import text

from own_systems.episode import Ride
from own_systems.pictures import COLOURS, box_of, drawn, panels_of
from own_systems.shapes import Line, Shape

DIGITS = 6  # of a number on the page


def write_page(ride: Ride, path: Path) -> Path:
    """Raises OSError where it cannot be written."""
    page = (files("own_systems") / "ride.html").read_text(encoding="utf-8")
    data = json.dumps(page_data(ride), allow_nan=False).replace("<", "\\u003c")
    parts = {"uplot.css": text("uplot/uPlot.min.css"), "uplot.js": text("uplot/uPlot.iife.min.js"), "ride": data}
    for name, part in parts.items():
        page = page.replace(f"/*{name}*/", part)
    path.write_text(page, encoding="utf-8")
    return path


def page_data(ride: Ride) -> dict[str, Any]:
    """All that the page shows: a column for each curve, a picture for every `step` ticks."""
    step, pictures = drawn(ride) if ride.task.draw else (1, [])
    corners = box_of(list(chain(*pictures))) if pictures else np.zeros((2, 2))
    panels = [
        {
            "name": panel.name,
            "names": list(panel.names),
            "values": [column(values) for values in panel.values.T],
            "limits": panel.limits,
            "colours": [COLOURS[k % len(COLOURS)] for k in range(len(panel.names))],
        }
        for panel in panels_of(ride)
    ]
    return {
        "title": ride.title,
        "time": column(np.array([moment.time for moment in ride.moments])),
        "panels": panels,
        "step": step,
        "pictures": [[shape_of(shape) for shape in shapes] for shapes in pictures],
        "box": column(corners.ravel()),
    }


def column(values: np.ndarray[Any, Any]) -> list[float | None]:
    """Numbers as JSON has them; None where there is none."""
    return [float(f"{value:.{DIGITS}g}") if np.isfinite(value) else None for value in values.tolist()]


def shape_of(shape: Shape) -> dict[str, Any]:
    """With a colour that a browser knows."""
    colour = to_hex(shape.colour)
    if isinstance(shape, Line):
        return {"points": [column(p) for p in np.asarray(shape.points, float)], "colour": colour, "width": shape.width}
    return {"centre": column(np.asarray(shape.centre, float)), "radius": float(shape.radius), "colour": colour}

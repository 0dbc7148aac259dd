"""How pictures look: the colours, units on every axis."""

from contextlib import AbstractContextManager
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rabbit_description.atomic_file import replacing

from rabbit_viewer.colours import AREA, BLACK, BLUE, GREEN, ORANGE, PURPLE, RED, SKY, STONE, YELLOW

__all__ = ["AREA", "BLACK", "BLUE", "GREEN", "ORANGE", "PURPLE", "RED", "SKY", "STONE", "YELLOW"]

PAGE = 9.0  # inches, of a picture on a page
LOOK: Any = {
    "figure.figsize": (PAGE, 2.4),
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
}


def look() -> AbstractContextManager[None]:
    """Draw inside this."""
    return mpl.rc_context(LOOK)


def figure(
    rows: int = 1, height: float = 2.4, width: float = PAGE, sharex: bool = True, **options: Any
) -> tuple[Figure, list[Axes]]:
    """A figure of `rows` panels, which share their x axis unless `sharex` is False; sizes in inches."""
    drawing = Figure(figsize=(width, height * rows), layout="constrained")
    FigureCanvasAgg(drawing)
    axes = drawing.subplots(rows, 1, sharex=sharex, squeeze=False, **options)
    return drawing, list(axes[:, 0])


def save(drawing: Figure, path: Path, dpi: int = 150) -> Path:
    """Write a figure; the suffix says as what."""
    path.parent.mkdir(parents=True, exist_ok=True)
    drawn = BytesIO()  # matplotlib's PDF writer hides what a full disk says
    drawing.savefig(drawn, format=path.suffix[1:], dpi=dpi)
    with replacing(path) as partial:
        partial.write_bytes(drawn.getbuffer())
    return path


def limit(axes: Axes, value: float, label: str) -> None:
    """A limit's line, labelled."""
    axes.axhline(value, color=RED, linestyle="--", linewidth=1, label=label)


def legend(axes: Axes, columns: int = 4) -> None:
    """Above the panel, where it hides nothing; none where nothing is labelled."""
    if axes.get_legend_handles_labels()[1]:
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=columns, borderaxespad=0.2)

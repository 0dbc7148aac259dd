"""The learning curves of end-to-end sessions in one picture: steps of 20 over the ticks of training."""

import csv
import io
from pathlib import Path

from matplotlib.figure import Figure
from rabbit_description.bounded_file import one_line, read_text
from rabbit_viewer import style

MOST_BYTES = 10_000_000
PANELS = {"stones": "stones of 20, 5 cm", "flat_steps": "steps of 20, flat ground"}
LOOKS = ((style.BLUE, "o"), (style.ORANGE, "s"), (style.GREEN, "^"), (style.PURPLE, "v"))


class CurveError(ValueError):
    """A file that is no learning curve."""


def draw(files: list[Path]) -> Figure:
    """A line for each `curve.csv`, called as its file; raises `CurveError`."""
    with style.look():
        figure, panels = style.figure(len(PANELS), height=1.7, width=6.0)
        for i, path in enumerate(files):
            found, (colour, marker) = read(path), LOOKS[i % len(LOOKS)]
            thousands = [ticks / 1000 for ticks in found["steps"]]
            for axes, column in zip(panels, PANELS, strict=True):
                axes.plot(thousands, found[column], color=colour, marker=marker, label=path.stem)
        for axes, title in zip(panels, PANELS.values(), strict=True):
            axes.set(ylabel=title.replace(", ", "\n"), ylim=(0, 21), yticks=range(0, 21, 5))
        panels[-1].set_xlabel("ticks of training (thousand)")
        panels[0].legend(loc="lower right")
    return figure


def read(path: Path) -> dict[str, list[float]]:
    """The columns that are drawn."""
    try:
        rows = list(csv.DictReader(io.StringIO(read_text(path, MOST_BYTES), newline="")))
        return {name: [float(row[name]) for row in rows] for name in ("steps", *PANELS)}
    except (csv.Error, KeyError, TypeError, ValueError) as error:
        raise CurveError(f"{path}: not a learning curve: {one_line(repr(error))}") from error

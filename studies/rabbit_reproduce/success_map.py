"""The picture of a table of rates: a colour and a number for each row and column, blank where there is none."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from rabbit_experiments.summary import Walks
from rabbit_viewer import style

LINE = 0.26  # inches


def success_map(
    rows: Sequence[str], columns: Sequence[str], walks: Sequence[Sequence[Walks | None]], width: float = 7.2
) -> tuple[Figure, Axes]:
    """Share of courses walked as colour, their count as number; `walks` has a sequence for each row."""
    figure, (axes,) = style.figure(1, height=0.6 + LINE * len(rows), width=width)
    image = draw(axes, rows, columns, walks)
    figure.colorbar(image, ax=axes, label="share of courses walked", fraction=0.03, pad=0.01)
    return figure, axes


def side_by_side(
    panels: Mapping[str, tuple[Sequence[str], Sequence[Sequence[Walks | None]]]], columns: Sequence[str]
) -> Figure:
    """A map for each title of `panels`, which has its rows and their walks."""
    longest = max(len(rows) for rows, _ in panels.values())
    figure = Figure(figsize=(len(panels) * (2.4 + 0.5 * len(columns)), 1.2 + LINE * longest), layout="constrained")
    for axes, (title, (rows, walks)) in zip(
        figure.subplots(1, len(panels), squeeze=False)[0], panels.items(), strict=True
    ):
        draw(axes, rows, columns, walks)
        axes.set_title(title)
        axes.tick_params(top=True, labeltop=True, bottom=False, labelbottom=False)
        axes.set_ylim(longest - 0.5, -0.5)  # rows of one height in all panels
        for edge in axes.spines.values():
            edge.set_visible(False)
    return figure


def draw(axes: Axes, rows: Sequence[str], columns: Sequence[str], walks: Sequence[Sequence[Walks | None]]) -> AxesImage:
    """A map in a panel."""
    rates = np.array([[each.walked / each.runs if each else np.nan for each in row] for row in walks])
    image = axes.imshow(rates, cmap="cividis", vmin=0, vmax=1, aspect="auto")
    for i, row in enumerate(walks):
        for j, each in enumerate(row):
            if each:
                colour = "black" if rates[i, j] > 0.5 else "white"
                axes.text(j, i, str(each.walked), ha="center", va="center", fontsize=7, color=colour)
    axes.set_yticks(range(len(rows)), rows)
    axes.set_xticks(range(len(columns)), columns, fontsize=7, rotation=45)
    axes.grid(visible=False)
    return image

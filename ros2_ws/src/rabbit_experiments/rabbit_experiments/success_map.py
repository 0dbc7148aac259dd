"""The picture of a table of rates: a colour and a number for each row and column, blank where there is none."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rabbit_viewer import style

from rabbit_experiments.summary import Walks

LINE = 0.26  # inches


def success_map(
    rows: Sequence[str], columns: Sequence[str], walks: Sequence[Sequence[Walks | None]], width: float = 7.2
) -> tuple[Figure, Axes]:
    """Share of courses walked as colour, their count as number; `walks` has a sequence for each row."""
    rates = np.array([[each.walked / each.runs if each else np.nan for each in row] for row in walks])
    figure, (axes,) = style.figure(1, height=0.6 + LINE * len(rows), width=width)
    image = axes.imshow(rates, cmap="cividis", vmin=0, vmax=1, aspect="auto")
    for i, row in enumerate(walks):
        for j, each in enumerate(row):
            if each:
                colour = "black" if rates[i, j] > 0.5 else "white"
                axes.text(j, i, str(each.walked), ha="center", va="center", fontsize=7, color=colour)
    axes.set_yticks(range(len(rows)), rows)
    axes.set_xticks(range(len(columns)), columns, fontsize=7, rotation=45)
    axes.grid(visible=False)
    figure.colorbar(image, ax=axes, label="share of courses walked", fraction=0.03, pad=0.01)
    return figure, axes

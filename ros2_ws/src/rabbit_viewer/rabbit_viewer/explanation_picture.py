"""What the rows of a tick leave of its two inputs that matter: half-planes with names, and the input that was taken.

It is a cut: the other inputs stay as they were taken. Rows that exclude each other leave nothing, in any cut.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rabbit_description.state import Array
from rl_cbf_clf_controller.explanation import Explanation, Row, Words, in_words, meaning_of

from rabbit_viewer import style

POINTS = 400  # a side, of the grid on which rows are drawn
FARTHEST = 3.0  # times the input's limit, or its size, that is drawn
ROUNDING = 1e-9  # of a row that no input of the cut moves, over its norm
ACTIVE = 1e-5  # as far beyond a row as it may be that the cut lies along, over 1 + |w|
BAND = 0.04  # on the side that a row forbids, over what is drawn
COLOURS = (style.RED, style.BLUE, style.ORANGE, style.PURPLE, style.SKY, style.BLACK, style.YELLOW)


def draw_explanation(
    explained: Explanation, path: Path, title: str = "", words: Words | None = None, names: Sequence[str] = ()
) -> Path:
    """Draw into the file `path`, and return it; `names` of the inputs (m,)."""
    words, chosen, w = words or {}, explained.inputs_that_matter(), explained.w
    names = names or [f"input {i + 1}" for i in range(len(w))]
    rows = [row for row in explained.rows if row.kind != "soft"]
    told = [row for row in rows if row.name in explained.excluding or row.state]
    reach = _reach(explained, told, chosen)
    axis = np.linspace(-reach, reach, POINTS)
    points = np.stack(np.meshgrid(axis, axis)[: len(chosen)], axis=-1)
    with style.look():
        figure, (axes,) = style.figure(1, height=6.0, width=6.4)
        worst = np.max([_beyond(row, w, chosen, points) for row in rows], axis=0)
        if worst.min() <= 0:
            axes.contourf(axis, axis, worst, [-np.inf, 0], colors=[style.GREEN], alpha=0.35)
            axes.plot([], [], color=style.GREEN, alpha=0.35, linewidth=8, label="meets all rows that are not soft")
        for row, colour in zip(told, COLOURS * len(told), strict=False):
            width = 2.5 if row.name in explained.excluding else 1
            beyond = _beyond(row, w, chosen, points)
            if beyond.min() < 0 < beyond.max():
                axes.contour(axis, axis, beyond, [0], colors=[colour], linewidths=width)
                axes.contourf(axis, axis, beyond, [0, 2 * BAND * reach], colors=[colour], alpha=0.3)
            label = in_words(row.name, explained.excluding.get(row.name, row.asks), words)
            label += "" if _is_in(row, chosen) else ", not in this cut"
            axes.plot([], [], color=colour, linewidth=width, label=label)
        axes.plot(*w[chosen], *[0.0] * (2 - len(chosen)), "o", color=style.BLACK, label="taken")
        units = [meaning_of(f"u{i + 1}", words)[1] for i in chosen]
        labels = [f"{names[i]} ({unit})" if unit else names[i] for i, unit in zip(chosen, units, strict=True)]
        axes.set(xlabel=labels[0], ylabel=labels[1] if len(labels) > 1 else "", aspect="equal")
        others = ", ".join(f"{names[i]} {w[i]:.0f}" for i in range(len(w)) if i not in chosen)
        axes.set_title(f"{title}\n{others and f'cut at {others}'}".strip(), fontsize=9, loc="left")
        axes.legend(loc="upper left", bbox_to_anchor=(0, -0.12))
        return style.save(figure, path)


def _is_in(row: Row, chosen: list[int]) -> bool:
    """Whether the inputs of the cut move it."""
    return bool(np.linalg.norm(row.normal[chosen]) > ROUNDING * np.linalg.norm(row.normal))


def _beyond(row: Row, w: Array, chosen: list[int], points: Array) -> Array:
    """How far points (..., 1 or 2) of the cut are beyond the row, in units of the input; negative: they meet it."""
    normal = row.normal[chosen] * _is_in(row, chosen)
    value = points @ normal + (row.normal @ w - normal @ w[chosen])
    size = np.linalg.norm(normal) or np.linalg.norm(row.normal) or 1.0
    beyond: Array = np.maximum(value - row.bounds[1], row.bounds[0] - value) / size
    return beyond - ACTIVE * (1 + np.linalg.norm(w)) * (not normal.any())


def _reach(explained: Explanation, told: list[Row], chosen: list[int]) -> float:
    """How far from zero is drawn: the limit, the input that was taken, and the nearest of each row, within bounds."""
    w = explained.w
    size = max(float(np.abs(w).max()), explained.rows[-1].upper if explained.factor is not None else 0.0) or 1.0
    lines = [row for row in told if row.kind != "hard" and _is_in(row, chosen)]
    away = [abs(float(_beyond(row, w, chosen, w[chosen]))) for row in lines]
    return min(1.15 * (size + max(away, default=0.0)), FARTHEST * size)

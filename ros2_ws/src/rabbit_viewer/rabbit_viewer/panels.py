"""Curves over one axis in panels, their limits in red: how a walk, a ride and a training are drawn."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from rabbit_description.state import Array

from rabbit_viewer import style

COLOURS = (style.BLUE, style.ORANGE, style.GREEN, style.PURPLE, style.SKY)
LINEAR: dict[str, Any] = {"value": "linear"}
LOG: dict[str, Any] = {"value": "log"}


@dataclass(frozen=True)
class Panel:
    """What is plotted together: a title, curves (n,) by name, limits; `scale` as `Axes.set_yscale` takes it."""

    title: str
    curves: Mapping[str, Array]
    limits: Sequence[float] = ()
    scale: Mapping[str, Any] = field(default_factory=lambda: LINEAR)
    ends: tuple[float, float] | None = None  # of what is shown


def draw_panels(
    panels: Sequence[Panel],
    x: Array,
    path: Path,
    title: str = "",
    xlabel: str = "time (s)",
    starts: Sequence[int] = (),
    shaded: float = 0.0,
    line: str = "-",
) -> Path:
    """Draw into the file `path`, and return it. Curves are broken where a row is one of `starts`, and so much from
    there on is shaded."""
    with style.look():
        figure, places = style.figure(len(panels), height=1.9)
        for panel, axes in zip(panels, places, strict=True):
            for start in x[list(starts)]:
                axes.axvspan(start, start + shaded, color=style.AREA, linewidth=0)
            for (name, values), colour in zip(panel.curves.items(), cycle(COLOURS)):
                broken = (np.insert(of.astype(float), starts, np.nan) for of in (x, values))
                axes.plot(*broken, line, color=colour, label=name)
            for i, limit in enumerate(panel.limits):
                style.limit(axes, limit, "" if i else "limit")
            axes.set_yscale(**panel.scale)
            axes.set_ylim(panel.ends)
            axes.set_ylabel(panel.title)
            style.legend(axes, 5)
        places[-1].set_xlabel(xlabel)
        figure.suptitle(title, fontsize=10)
        return style.save(figure, path)

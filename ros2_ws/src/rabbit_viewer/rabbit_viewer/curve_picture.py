"""A training's curve as a picture: how far each episode walked, its reward, the losses."""

import csv
from pathlib import Path

from matplotlib.ticker import MaxNLocator

from rabbit_viewer import style

CURVE, PICTURE = "curve.csv", "curve.png"
PANELS = {"episode/": "steps", "reward/": "mean reward (1)", "losses/": "mean loss (1)"}


def draw_curve(folder: Path) -> Path:
    """Draw curve.png beside the curve.csv of a training's folder; raises `OSError`."""
    with (folder / CURVE).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    episodes = [int(row["episode"]) + 1 for row in rows]
    with style.look():
        figure, axes = style.figure(len(PANELS), height=1.9)
        for panel, (prefix, label) in zip(axes, PANELS.items(), strict=True):
            names = ["episode/steps"] if prefix == "episode/" else [n for n in rows[0] if n.startswith(prefix)]
            for name in names:
                values = [float(row[name] or "nan") for row in rows]
                panel.plot(episodes, values, ".-", label=name.removeprefix(prefix) if len(names) > 1 else "")
            panel.set_ylabel(label)
            style.legend(panel, 6)
        axes[-1].set_yscale("symlog", linthresh=1e-3)
        axes[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
        axes[-1].set_xlabel("episode")
        return style.save(figure, folder / PICTURE)

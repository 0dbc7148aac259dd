"""A training's curve as a picture: how far each episode walked, its reward, the losses."""

import csv
from pathlib import Path

import numpy as np

from rabbit_viewer.panels import LINEAR, Panel, draw_panels

CURVE, PICTURE = "curve.csv", "curve.png"
PANELS = {"episode/steps": "steps", "reward/": "mean reward (1)", "losses/": "mean loss (1)"}
LOSSES = {"value": "symlog", "linthresh": 1e-3}


def draw_curve(folder: Path) -> Path:
    """Draw curve.png beside the curve.csv of a training's folder; raises `OSError`."""
    with (folder / CURVE).open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        columns, rows = reader.fieldnames or (), list(reader)
    panels = []
    for prefix, title in PANELS.items():
        names = [name for name in columns if name.startswith(prefix)]
        curves = {name.partition("/")[2]: np.array([float(row[name] or "nan") for row in rows]) for name in names}
        panels.append(Panel(title, curves, scale=LOSSES if prefix == "losses/" else LINEAR))
    episodes = np.array([int(row["episode"]) + 1 for row in rows])
    return draw_panels(panels, episodes, folder / PICTURE, xlabel="episode", line=".-")

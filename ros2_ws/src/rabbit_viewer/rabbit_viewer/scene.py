"""One moment of a walk: stick robot, stones and gaps, the area the barriers allow, the ground's force.

The camera follows the hip; everything is drawn relative to it, so axes and ground never change between frames.
"""

from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import Affine2D
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from rabbit_experiments.walk_records import WalkRecords

from rabbit_viewer import style
from rabbit_viewer.geometry import area_at, box, fall_of, force_arrow, legs_of, spans_until, stone_spans, torso_points

VIEW = (-1.2, 1.2, -0.25, 1.6)  # m: left, right, bottom, top, from below the hip
SIZE = (960, 740)  # pixels, as the view
LEFT = 19  # pixels, of all words
TITLE, NUMBERS, REASON, WORDS_END = 14, 58, 124, 260  # pixels from the top
LETTERS = 66  # of a reason's line
SMALL, LARGE, LINE_SPACING = 15, 24, 5  # pixels
BOXES: dict[str, dict[str, Any]] = {  # in the order in which they are drawn, before the lines
    "area": {"facecolor": style.AREA, "edgecolor": "none"},
    "ground": {"facecolor": style.STONE, "edgecolor": style.BLACK, "linewidth": 0.5},
    "next": {"facecolor": style.GREEN, "edgecolor": style.BLACK, "linewidth": 0.5},
}
LINES: dict[str, dict[str, Any]] = {
    "trail": {"color": style.ORANGE, "linewidth": 1, "linestyle": ":"},
    "swing": {"color": style.ORANGE, "linewidth": 5, "marker": "o", "markersize": 6},
    "stance": {"color": style.BLUE, "linewidth": 5, "marker": "o", "markersize": 6},
    "torso": {"color": style.BLACK, "linewidth": 7, "solid_capstyle": "round"},
    "force": {"color": style.RED, "linewidth": 2},
    "tip": {"color": style.RED, "marker": "^", "markersize": 7},
}


class Scene:
    """Draws any tick of `walk` into one canvas. `fall`: the row from which the robot falls, if it does."""

    def __init__(self, walk: WalkRecords, has_legend: bool = True) -> None:
        self._walk, self._starts = walk, walk.step_starts
        self._legs, self._torso = legs_of(walk), torso_points(walk.q)
        self.fall = fall_of(walk)
        self._spans = stone_spans(walk)
        figure = Figure(figsize=(SIZE[0] / 100, SIZE[1] / 100), dpi=100)
        self._canvas: Any = FigureCanvasAgg(figure)  # its drawing methods have no types
        axes = figure.add_axes((0, 0, 1, 1))
        axes.set(xlim=VIEW[:2], ylim=VIEW[2:])
        axes.set_axis_off()
        if has_legend:
            axes.legend(handles=self._legend(), loc="upper right", bbox_to_anchor=(1, 0.94), fontsize=9, frameon=False)
        self._boxes = {name: PolyCollection([], **look) for name, look in BOXES.items()}
        for boxes in self._boxes.values():
            axes.add_collection(boxes)
        self._lines = {name: axes.plot([], [], **look)[0] for name, look in LINES.items()}
        slope = float(walk.about.get("slope", 0.0))  # the ground is level in the plant's frame
        tilted = Affine2D().rotate_deg(slope) + axes.transData
        for artist in (*self._boxes.values(), *self._lines.values()):
            artist.set_transform(tilted)
        self._small = ImageFont.truetype(findfont("monospace"), SMALL)
        self._large = ImageFont.truetype(findfont("DejaVu Sans"), LARGE)
        self._canvas.draw()
        self._background = self._canvas.copy_from_bbox(figure.bbox)  # what stays, drawn once

    def frame(self, row: int) -> NDArray[np.uint8]:
        """The picture at `row`, (height, width, 4)."""
        self._place_boxes(row)
        self._place_lines(row)
        self._canvas.restore_region(self._background)
        for artist in (*self._boxes.values(), *self._lines.values()):
            artist.draw(self._canvas.get_renderer())
        picture = np.array(self._canvas.buffer_rgba())
        picture[:WORDS_END] = self._with_words(row, picture[:WORDS_END])
        return picture

    def _legend(self) -> list[Artist]:
        handles: list[Artist] = [
            Line2D([], [], color=style.BLUE, linewidth=4, label="stance leg"),
            Line2D([], [], color=style.ORANGE, linewidth=4, label="swing leg"),
            Line2D([], [], color=style.RED, linewidth=2, label="ground force (1 m = 1000 N)"),
        ]
        if np.isfinite(self._walk.preview).any():
            handles.append(Patch(color=style.GREEN, label="next stone"))
            handles.append(Patch(color=style.AREA, label="barriers: swing foot may be here"))
        return handles

    def _place_boxes(self, row: int) -> None:
        """The platform, a stone for each step begun, and the area that the barriers allow."""
        camera, spans = self._walk.q[row, 0], spans_until(self._walk, self._spans, row)
        boxes = [box(near - camera, far - camera, top) for near, far, top in spans]
        self._boxes["ground"].set_verts(boxes or [box(VIEW[0] - 1, VIEW[1] + 1)])
        self._boxes["next"].set_verts(boxes[-1:] if np.isfinite(self._walk.preview[row, 0]) else [])
        area = area_at(self._walk, row)
        foot = self._legs[self._walk.stance[row], row, 2, 0]
        # its height counts from the stone in sight
        self._boxes["area"].set_verts([] if area is None else [area + (foot - camera, spans[-1][2])])

    def _place_lines(self, row: int) -> None:
        stance = int(self._walk.stance[row])
        swing, foot = self._legs[1 - stance], self._legs[stance, row, 2]
        first = self._starts[self._starts <= row][-1]
        arrow = force_arrow(self._walk.stance_force[row])
        points = {
            "trail": swing[first : row + 1, 2],
            "swing": swing[row],
            "stance": self._legs[stance, row],
            "torso": self._torso[row],
            "force": np.stack([foot, foot + arrow]),
            "tip": (foot + arrow)[None][: int(arrow.any())],
        }
        for name, line in points.items():
            self._lines[name].set_data(line[:, 0] - self._walk.q[row, 0], line[:, 1])

    def _with_words(self, row: int, picture: NDArray[np.uint8]) -> Image.Image:
        """Writes the words by Pillow: matplotlib takes four times as long for the letters as for all the rest."""
        walk = self._walk
        tangential, normal = walk.stance_force[row]
        ratio = f"{abs(tangential) / normal:4.2f}" if normal > 1 else "   -"
        total, slack = walk.about.get("stones"), walk.clf_slack[row]
        lines = [
            f"t {walk.time[row]:6.2f} s   step {walk.step_index[row] + 1}" + (f" of {total}" if total else ""),
            f"|F_T|/F_N {ratio}" + (f"   d {slack:6.2f}" if np.isfinite(slack) else ""),
        ]
        B = zip(walk.barrier_names, walk.barriers[row].tolist(), strict=True)
        if known := [f"{name} {value:6.3f}" for name, value in B if np.isfinite(value)]:
            lines.append("   ".join(known))
        image = Image.fromarray(picture)
        draw = ImageDraw.Draw(image)
        draw.text((LEFT, TITLE), str(walk.about.get("title", "")), "black", self._large)
        draw.multiline_text((LEFT, NUMBERS), "\n".join(lines), "black", self._small, spacing=LINE_SPACING)
        if self.fall is not None and row >= self.fall:
            why = "\n".join(wrap(str(walk.about.get("reason", "")), LETTERS))
            draw.multiline_text((LEFT, REASON), why, style.RED, self._large, spacing=LINE_SPACING)
        return image

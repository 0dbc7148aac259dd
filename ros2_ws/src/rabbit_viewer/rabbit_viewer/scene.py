"""One moment of a walk: stick robot, stones and gaps, the area the barriers allow, the ground's force.

The camera follows the hip; everything is drawn relative to it, so axes and ground never change between frames.
"""

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from rabbit_description.state import TICK_SECONDS, Array, Leg
from rabbit_experiments.walk_records import WalkRecords

from rabbit_viewer import style
from rabbit_viewer.geometry import DEPTH, PLATFORM, area_at, force_arrow, leg_points, torso_points

VIEW = (-1.2, 1.2, -0.25, 1.6)  # m: left, right, bottom, top, from below the hip
SIZE = (960, 740)  # pixels, the view's own shape
CAPTION = (19, 22)  # pixels of its left top corner
CAPTION_END = 110  # pixels from the top
FONT_SIZE, LINE_SPACING = 15, 5  # pixels
LOOKS: dict[str, dict[str, Any]] = {
    "trail": {"color": style.ORANGE, "linewidth": 1, "linestyle": ":"},
    "swing": {"color": style.ORANGE, "linewidth": 5, "marker": "o", "markersize": 6},
    "stance": {"color": style.BLUE, "linewidth": 5, "marker": "o", "markersize": 6},
    "torso": {"color": style.BLACK, "linewidth": 7, "solid_capstyle": "round"},
    "force": {"color": style.RED, "linewidth": 2},
}


class Scene:
    """Draws any tick of `walk` into one canvas."""

    def __init__(self, walk: WalkRecords) -> None:
        self._walk = walk
        bend = float(walk.about.get("link_bend", 0.0))
        self._legs = [leg_points(walk.q, leg, bend) for leg in Leg]
        self._torso = torso_points(walk.q)
        self._spans = stone_spans(walk, np.stack([leg[:, 2] for leg in self._legs], axis=1))
        self._starts = walk.step_starts
        self._figure = Figure(figsize=(SIZE[0] / 100, SIZE[1] / 100), dpi=100)
        self._canvas: Any = FigureCanvasAgg(self._figure)  # its drawing methods have no types
        axes = self._figure.add_axes((0, 0, 1, 1))
        axes.set(xlim=VIEW[:2], ylim=VIEW[2:])
        axes.set_axis_off()
        self._make_artists(axes)
        self._add_legend(axes)
        self._font = ImageFont.truetype(findfont("monospace"), FONT_SIZE)
        self._background = self._draw_background()

    def frame(self, row: int) -> NDArray[np.uint8]:
        """The picture at `row`, (height, width, 4)."""
        walk = self._walk
        camera = float(walk.q[row, 0])
        stance = int(walk.stance[row])
        for line, points in (
            (self._lines["torso"], self._torso[row]),
            (self._lines["stance"], self._legs[stance][row]),
            (self._lines["swing"], self._legs[1 - stance][row]),
        ):
            line.set_data(points[:, 0] - camera, points[:, 1])
        self._move_ground(row, camera)
        self._move_area(row, camera, self._legs[stance][row, 2])
        self._move_force(row, camera, self._legs[stance][row, 2])
        first = self._starts[self._starts <= row][-1]
        trail = self._legs[1 - stance][first : row + 1, 2]
        self._lines["trail"].set_data(trail[:, 0] - camera, trail[:, 1])
        self._canvas.restore_region(self._background)
        for artist in self._moving:
            artist.draw(self._canvas.get_renderer())
        picture = np.array(self._canvas.buffer_rgba())
        picture[:CAPTION_END] = self._with_caption(row, picture[:CAPTION_END])
        return picture

    def _make_artists(self, axes: Axes) -> None:
        """All that moves."""
        self._area = PolyCollection([], facecolor=style.AREA, edgecolor="none")
        self._ground = PolyCollection([], facecolor=style.STONE, edgecolor=style.BLACK, linewidth=0.5)
        self._next = PolyCollection([], facecolor=style.GREEN, edgecolor=style.BLACK, linewidth=0.5)
        for boxes in (self._area, self._ground, self._next):
            axes.add_collection(boxes)
        self._lines = {name: axes.plot([], [], **look)[0] for name, look in LOOKS.items()}
        self._tip = axes.plot([], [], marker="^", color=style.RED, markersize=7)[0]
        self._moving = [self._area, self._ground, self._next, *self._lines.values(), self._tip]

    def _add_legend(self, axes: Axes) -> None:
        handles: list[Artist] = [
            Line2D([], [], color=style.BLUE, linewidth=4, label="stance leg"),
            Line2D([], [], color=style.ORANGE, linewidth=4, label="swing leg"),
            Line2D([], [], color=style.RED, linewidth=2, label="ground force (1 m = 1000 N)"),
        ]
        if np.isfinite(self._walk.preview).any():
            handles.append(Patch(color=style.GREEN, label="next stone"))
            handles.append(Patch(color=style.AREA, label="barriers: swing foot may be here"))
        axes.legend(handles=handles, loc="upper right", fontsize=9, frameon=False)

    def _draw_background(self) -> Any:
        """What stays, drawn once."""
        for artist in self._moving:
            artist.set_visible(False)
        self._canvas.draw()
        for artist in self._moving:
            artist.set_visible(True)
        return self._canvas.copy_from_bbox(self._figure.bbox)

    def _move_ground(self, row: int, camera: float) -> None:
        if not self._spans:
            self._ground.set_verts([_box(VIEW[0] - 1, VIEW[1] + 1)])
            return
        boxes = [_box(near - camera, far - camera, top) for near, far, top in self._placed(row)]
        self._ground.set_verts(boxes)
        seen = np.isfinite(self._walk.preview[row, 0])
        self._next.set_verts(boxes[-1:] if seen else [])

    def _placed(self, row: int) -> list[tuple[float, float, float]]:
        """The platform, and a stone for each step begun."""
        return self._spans[: int(self._walk.step_index[row]) + 2]

    def _move_area(self, row: int, camera: float, foot: Array) -> None:
        area = area_at(self._walk, row)
        # its height counts from the stone in sight
        self._area.set_verts([] if area is None else [area + (foot[0] - camera, self._placed(row)[-1][2])])

    def _move_force(self, row: int, camera: float, foot: Array) -> None:
        arrow = force_arrow(self._walk.stance_force[row])
        tip = foot + arrow
        self._lines["force"].set_data([foot[0] - camera, tip[0] - camera], [foot[1], tip[1]])
        self._tip.set_data([tip[0] - camera], [tip[1]])
        self._tip.set_visible(bool(arrow.any()))

    def _with_caption(self, row: int, picture: NDArray[np.uint8]) -> Image.Image:
        """By Pillow: matplotlib takes four times as long for the letters as for all the rest."""
        image = Image.fromarray(picture)
        ImageDraw.Draw(image).multiline_text(CAPTION, self._caption(row), "black", self._font, spacing=LINE_SPACING)
        return image

    def _caption(self, row: int) -> str:
        walk = self._walk
        tangential, normal = walk.stance_force[row]
        ratio = f"{abs(tangential) / normal:4.2f}" if normal > 1 else "   -"
        total = walk.about.get("stones")
        lines = [
            str(walk.about.get("title", "")),
            f"t {walk.tick[row] * TICK_SECONDS:6.2f} s   step {walk.step_index[row] + 1}"
            + (f" of {total}" if total else ""),
            f"|F_T|/F_N {ratio}   d {walk.clf_slack[row]:6.2f}",
        ]
        if np.isfinite(walk.barriers[row]).all():
            lines.append(f"B1 {walk.barriers[row, 0] * 1e3:5.0f} mm   B2 {walk.barriers[row, 1] * 1e3:5.0f} mm")
        return "\n".join(lines)


def stone_spans(walk: WalkRecords, feet: Array) -> list[tuple[float, float, float]]:
    """World edges and top, as previewed, of the platform and each step's stone, m; empty on flat ground.

    `feet` (n, 2, 2).
    """
    if not np.isfinite(walk.preview).any():
        return []
    starts = walk.step_starts
    seen = starts[np.isfinite(walk.preview[starts, 0])]
    origin = feet[seen, walk.stance[seen], 0]
    edges = origin[:, None] + walk.preview[seen]
    half = float(np.diff(walk.preview[seen[0]])[0]) / 2
    tops = np.cumsum(walk.stone_height[seen])
    return [(PLATFORM, half, 0.0), *map(tuple, np.column_stack([edges, tops]).tolist())]


def _box(near: float, far: float, top: float = 0.0) -> list[tuple[float, float]]:
    return [(near, top - DEPTH), (near, top), (far, top), (far, top - DEPTH)]

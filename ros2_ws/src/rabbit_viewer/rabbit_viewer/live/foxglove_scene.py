"""Shapes and frames as Foxglove's messages: one scene entity a group, which replaces the one before."""

import math
from collections.abc import Iterable

from foxglove import messages as fox
from rabbit_description.state import Array

from rabbit_viewer.colours import BLACK, rgb
from rabbit_viewer.geometry import DEPTH
from rabbit_viewer.live.frames import WORLD, Frame, turn_about_y
from rabbit_viewer.live.shapes import (
    FONT,
    HEAD,
    SHAFT,
    STONE_BREADTH,
    Arrow,
    Box,
    Drawing,
    Line,
    Shape,
    Sheet,
    Words,
)


def scene_update(drawing: Drawing, at: fox.Timestamp) -> fox.SceneUpdate:
    """A drawing as one update."""
    return fox.SceneUpdate(entities=[_entity(group, shapes, at) for group, shapes in drawing.items()])


def transforms(frames: Iterable[Frame], at: fox.Timestamp) -> fox.FrameTransforms:
    """Link frames as one message."""
    return fox.FrameTransforms(transforms=[_transform(frame, at) for frame in frames])


def color(colour: str, opacity: float = 1.0) -> fox.Color:
    """From `#rrggbb`."""
    red, green, blue = rgb(colour)
    return fox.Color(r=red, g=green, b=blue, a=opacity)


def _entity(group: str, shapes: list[Shape], at: fox.Timestamp) -> fox.SceneEntity:
    return fox.SceneEntity(
        timestamp=at,
        frame_id=WORLD,
        id=group,
        lines=[_line(shape) for shape in shapes if isinstance(shape, Line)],
        cubes=[_cube(shape) for shape in shapes if isinstance(shape, Box)],
        triangles=[_triangles(shape) for shape in shapes if isinstance(shape, Sheet)],
        arrows=[_arrow(shape) for shape in shapes if isinstance(shape, Arrow)],
        texts=[_text(shape) for shape in shapes if isinstance(shape, Words)],
    )


def _line(line: Line) -> fox.LinePrimitive:
    return fox.LinePrimitive(points=_points(line.points), thickness=line.width, color=color(line.colour))


def _cube(box: Box) -> fox.CubePrimitive:
    return fox.CubePrimitive(
        pose=_pose((box.near + box.far) / 2, -DEPTH / 2),
        size=fox.Vector3(x=box.far - box.near, y=STONE_BREADTH, z=DEPTH),
        color=color(box.colour),
    )


def _triangles(sheet: Sheet) -> fox.TriangleListPrimitive:
    tint = color(sheet.colour, sheet.opacity)
    return fox.TriangleListPrimitive(points=_points(sheet.triangles.reshape(-1, 2)), color=tint)


def _arrow(arrow: Arrow) -> fox.ArrowPrimitive:
    x, z = (arrow.tip - arrow.start).tolist()
    length = math.hypot(x, z)
    head = min(2 * HEAD, length)
    return fox.ArrowPrimitive(
        pose=_pose(float(arrow.start[0]), float(arrow.start[1]), -math.atan2(z, x)),  # about +y, from +x
        shaft_length=length - head,
        shaft_diameter=SHAFT,
        head_length=head,
        head_diameter=HEAD,
        color=color(arrow.colour),
    )


def _text(words: Words) -> fox.TextPrimitive:
    pose = _pose(*words.at.tolist())
    return fox.TextPrimitive(pose=pose, billboard=True, font_size=FONT, color=color(BLACK), text=words.text)


def _transform(frame: Frame, at: fox.Timestamp) -> fox.FrameTransform:
    return fox.FrameTransform(
        timestamp=at,
        parent_frame_id=frame.parent,
        child_frame_id=frame.child,
        translation=fox.Vector3(x=frame.x, y=0.0, z=frame.z),
        rotation=_turn(frame.angle),
    )


def _pose(x: float, z: float, angle: float = 0.0) -> fox.Pose:
    return fox.Pose(position=fox.Vector3(x=x, y=0.0, z=z), orientation=_turn(angle))


def _turn(angle: float) -> fox.Quaternion:
    x, y, z, w = turn_about_y(angle)
    return fox.Quaternion(x=x, y=y, z=z, w=w)


def _points(points: Array) -> list[fox.Point3]:
    return [fox.Point3(x=x, y=0.0, z=z) for x, z in points.tolist()]

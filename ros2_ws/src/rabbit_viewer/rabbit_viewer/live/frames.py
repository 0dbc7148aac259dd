"""Where the URDF's links are: each link's frame in its parent's, as tf wants them."""

import math
from typing import NamedTuple

from rabbit_description.state import Array

from rabbit_viewer.skeleton import LEG_LINK

WORLD, FOLLOWED = "world", "slide_x"  # `slide_x` moves with the hip, forward only: what a camera follows


class Frame(NamedTuple):
    """`child` in `parent`: moved by x, z (m), then turned by `angle` (rad) about +y."""

    parent: str
    child: str
    x: float = 0.0
    z: float = 0.0
    angle: float = 0.0


def link_frames(q: Array) -> list[Frame]:
    """All links of the URDF at `q` (7,)."""
    x, z, pitch, *joints = (float(value) for value in q)
    frames = [Frame(WORLD, FOLLOWED, x=x), Frame(FOLLOWED, "slide_z", z=z), Frame("slide_z", "torso", angle=pitch)]
    for side, (hip, knee) in (("left", joints[:2]), ("right", joints[2:])):
        thigh, shin = f"{side}_thigh", f"{side}_shin"
        frames.append(Frame("torso", thigh, angle=hip))
        frames.append(Frame(thigh, shin, z=-LEG_LINK, angle=knee))
        frames.append(Frame(shin, f"{side}_foot", z=-LEG_LINK))
    return frames


def turn_about_y(angle: float) -> tuple[float, float, float, float]:
    """The quaternion x, y, z, w of a turn by `angle`, rad."""
    return 0.0, math.sin(angle / 2), 0.0, math.cos(angle / 2)

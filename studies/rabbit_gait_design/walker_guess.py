"""Where the search for a walker's gait begins if its file has no path: from one double support to the next.

support    both feet on the ground, a step length apart, the hip midway between them, the torso upright, knees bent
path       from the support with the legs exchanged to the support; in between the swing knee bends further
"""

from collections.abc import Iterator

import numpy as np
from rabbit_description.planar_urdf import BASE, SLIDES
from rabbit_description.state import Array
from rl_cbf_clf_controller.virtual_constraints import StepPath
from scipy.optimize import least_squares

from rabbit_gait_design.hybrid_zero_dynamics import Walker
from rabbit_gait_design.planar_design import PlanarDesignError

BEND, FLEXIONS = 0.15, (0.6, 1.0, 0.3)  # rad: of both knees in double support; of the swing knee besides
POINTS = 6  # control points
SHARES = np.array([0.0, 0.3, 1.0, 1.0, 0.3, 0.0])  # of the flexion, at the control points
FEET, HIP, FREE = 10.0, 3.0, 0.01  # weights of what a double support must be, and of angles that nothing decides


def guesses(walker: Walker, step_length: float) -> Iterator[StepPath]:
    """Paths to begin with, the likeliest first; raises `PlanarDesignError` where the phase would fall."""
    end, knees = double_support(walker, step_length), bends(walker)
    begin, is_swing = end[walker.swap], np.arange(len(end)) >= BASE + (len(end) - BASE) // 2
    first, last = (float(walker.angles.phase_angle @ q) for q in (begin, end))
    if first >= last:
        raise PlanarDesignError(f"phase: from {first:.3g} to {last:.3g} rad over a step; expected a sum that grows")
    straight = np.linspace(begin, end, POINTS)
    for flexion in FLEXIONS:
        row = straight + SHARES[:, None] * flexion * np.sign(knees) * is_swing
        yield StepPath(walker.angles.controlled @ row.T, first, last)
        if not knees.any():
            return


def double_support(walker: Walker, step_length: float) -> Array:
    """q (n,), rad, base at the origin: the swing foot a step length ahead of the stance foot."""
    knees, still = bends(walker), np.zeros(walker.model.model.nv)

    def off(angles: Array) -> Array:
        q = np.append(np.zeros(SLIDES), angles)
        feet = walker.model.update(q, still)
        ground = FEET * (feet.swing - [step_length, 0.0])
        return np.concatenate(
            [ground, [HIP * (feet.hip[0] - step_length / 2), q[SLIDES]], (q - knees)[knees != 0], FREE * q]
        )

    return np.append(np.zeros(SLIDES), least_squares(off, np.zeros(len(still) - SLIDES)).x)


def bends(walker: Walker) -> Array:
    """(n,), rad: each knee's `BEND` to the side on which its limits leave more room; 0 for what is no knee."""
    model = walker.model.model
    bends = np.zeros(model.nv)
    for joint in range(1, model.njoints):
        place = model.idx_vs[joint]
        if place >= BASE and model.idx_vs[model.parents[joint]] >= BASE:
            room = model.lowerPositionLimit[place] + model.upperPositionLimit[place]
            bends[place] = -BEND if room < 0 else BEND
    return bends

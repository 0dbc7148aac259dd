"""Where the optimisation starts: inverse kinematics of a plain walk, fitted by Bézier curves."""

import numpy as np
from rabbit_description.state import Array
from scipy.special import comb

from rabbit_gait_design.specification import GaitSpecification

DEGREE = 5
LEG_SEGMENT = 0.4  # m
HIP_HEIGHT = 0.74  # m
TORSO_PITCH = 0.1  # rad
FOOT_HEIGHT = 0.06  # m


def basis(s: Array) -> Array:
    """Bernstein polynomials of degree 5 at `s` (n,), shape (n, 6)."""
    k = np.arange(DEGREE + 1)
    return np.asarray(comb(DEGREE, k) * s[:, None] ** k * (1 - s[:, None]) ** (DEGREE - k))


def leg_angles(hip_to_foot: Array, pitch: float) -> Array:
    """Hip and knee of a leg reaching `hip_to_foot` (n, 2), the knee flexed backward, shape (n, 2), rad."""
    reach = np.linalg.norm(hip_to_foot, axis=1) / (2 * LEG_SEGMENT)
    knee = 2 * np.arccos(np.clip(reach, -1, 1))
    hip = np.arctan2(-hip_to_foot[:, 0], -hip_to_foot[:, 1]) - knee / 2 - pitch
    return np.column_stack([hip, knee])


def initial_guess(specification: GaitSpecification) -> tuple[Array, Array]:
    """Bézier coefficients (4, 6) and phase range (2,), rad."""
    step, s = specification.step_length, np.linspace(0, 1, 30)
    hip_x = step * (s - 0.5)
    stance = np.column_stack([-hip_x, np.full_like(s, -HIP_HEIGHT)])
    swing_x, swing_z = -step * np.cos(np.pi * s), FOOT_HEIGHT * np.sin(np.pi * s)
    swing = np.column_stack([swing_x - hip_x, swing_z - HIP_HEIGHT])
    joints = np.column_stack([leg_angles(stance, TORSO_PITCH), leg_angles(swing, TORSO_PITCH)])
    coeffs = np.linalg.lstsq(basis(s), joints, rcond=None)[0].T
    half = np.arctan2(step / 2, HIP_HEIGHT)
    return coeffs, np.array([-half, half])

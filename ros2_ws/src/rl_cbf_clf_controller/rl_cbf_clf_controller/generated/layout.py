"""The generated functions and the layout of their arguments and results: plain numbers, one row of doubles each.

Robots are planar: base slides x, z and pitch, a torso, two legs of thigh and shin. What distinguishes one from another
is an argument, `ROBOT`, so that nominal, identified and true robot share the same function. Arrays are row-major.
"""

from typing import TypeAlias

Layout: TypeAlias = dict[str, tuple[int, ...]]  # names and shapes, in order

COORDINATES, MOTORS = 7, 4
LINKS = ("torso", "stance_thigh", "stance_shin", "swing_thigh", "swing_shin")
POWERS = 8  # coefficients of a desired angle's polynomial in the phase, highest ones zero where the gait has fewer
CORRECTION_POWERS = 5  # the same of the correction

STATE: Layout = {"q": (COORDINATES,), "dq": (COORDINATES,)}
ROBOT: Layout = {
    "links": (len(LINKS), 4),  # m, m c_x, m c_z, I_yy in the frame of the joint that carries it, see link_parameters.py
    "legs": (2, 3, 2),  # stance, swing; hip, knee, foot; x, z in the frame of the joint above, m
    "motor_gain": (1,),
    "joint_damping": (1,),  # 1/s
}
PATH: Layout = {
    "gradient": (COORDINATES,),  # of the phase in q
    "phase_start": (1,),  # phase = gradient' q - phase_start
    "powers": (MOTORS, POWERS),  # desired angles: coefficients of 1, s, s^2, ...
    "fading": (1,),  # of their curvature beyond the phase's ends
    "correction": (MOTORS, CORRECTION_POWERS),  # of `step_outputs.py`, as `powers`, over x; zero for none
    "correction_begin": (1,),
    "correction_width": (1,),
    "descent": (MOTORS,),  # D of `step_outputs.py`; zero for none
}

PINNED = "pinned_dynamics"
OUTPUTS = "outputs"
REGRESSOR = "motion_regressor"
FOOT_VELOCITY = "foot_velocity"

FUNCTIONS: dict[str, tuple[Layout, Layout]] = {
    PINNED: (
        STATE | ROBOT,
        {
            "swing": (2,),
            "swing_rate": (2,),
            "swing_jacobian": (2, COORDINATES),
            "swing_bias": (2,),
            "hip": (2,),
            "hip_rate": (2,),
            "acceleration_a": (COORDINATES, MOTORS),
            "acceleration_b": (COORDINATES,),
            "force_a": (2, MOTORS),
            "force_b": (2,),
        },
    ),
    OUTPUTS: (
        STATE | PATH,
        {
            "eta": (2, MOTORS),  # y, dy
            "jacobian": (MOTORS, COORDINATES),
            "bias": (MOTORS,),
            "phase": (1,),
            "phase_rate": (1,),
        },
    ),
    REGRESSOR: (
        STATE | {"ddq": (COORDINATES,), "theta": (12,), "legs": ROBOT["legs"]},  # theta: of torso, thighs, shins
        {
            "regressor": (COORDINATES, 12),
            "mass": (COORDINATES, COORDINATES),
            "jacobians": (2, 2, COORDINATES),  # stance, swing
        },
    ),
    FOOT_VELOCITY: (
        STATE | {"legs": ROBOT["legs"]},
        {"velocity": (2,), "slope": (2, 2)},  # of the stance foot; its slope over the stance leg's hip and knee
    ),
}

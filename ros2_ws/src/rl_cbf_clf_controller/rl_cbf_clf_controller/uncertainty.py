"""The paper's three learning problems: which quantities' errors are learned, from what, in which units.

Quantities: `V` (V-dot, rad^2/s^3), `B1`, `B2` (second derivatives of the barriers, m/s^2), `C1` (normal force F_N of
the stance foot, N), `C2` (its tangential force F_T, N). The rows of the unilateral and the friction constraint are
built from F_N and F_T; see docs/differences_from_paper.md.

In the first approach the quantities are the outputs' accelerations `y1` to `y4` (rad/s^2), and alpha, beta are not an
estimate but an input: u = u~(mu) + (LgLfh)^-1 (alpha mu + beta) [approach1_input].
"""

from rabbit_description.state import JOINTS

from rl_cbf_clf_controller.problem import Problem

STEP_LENGTH = "step_length"  # what a gait library steps at; seen after l_min
STATE_OBSERVATION = (
    *(f"y{i}" for i in range(1, JOINTS + 1)),
    *(f"dy{i}" for i in range(1, JOINTS + 1)),
    *("hip_x", "hip_z", "phase"),
    *("hip_dx", "hip_dz", "dphase"),
)
UNITS = (  # centre and scale: what a walk of this robot spans
    *((f"y{i}", 0.0, 0.1) for i in range(1, JOINTS + 1)),  # rad
    *((f"dy{i}", 0.0, 1.5) for i in range(1, JOINTS + 1)),  # rad/s
    ("hip_x", 0.0, 0.12),  # m, from the stance foot
    ("hip_z", 0.75, 0.03),  # m
    ("phase", 0.5, 0.35),  # 1
    ("hip_dx", 0.6, 0.25),  # m/s
    ("hip_dz", 0.0, 0.2),  # m/s
    ("dphase", 1.7, 0.7),  # 1/s
    ("l_min", 0.35, 0.03),  # m
    (STEP_LENGTH, 0.4, 0.1),  # m
)

IO_RL_CLF_QP = Problem(
    "io-rl-clf-qp",
    JOINTS,
    quantities=tuple(f"y{i}" for i in range(1, JOINTS + 1)),
    observation=STATE_OBSERVATION,
    units=UNITS,
    alpha_scale=(2.0,) * JOINTS,
    beta_scale=(400.0,) * JOINTS,
    error_scale=(50.0,) * JOINTS,
    corrects_input=True,
)
RL_CLF_QP = Problem(
    "rl-clf-qp",
    JOINTS,
    quantities=("V",),
    observation=STATE_OBSERVATION,
    units=UNITS,
    alpha_scale=(1.5,),
    beta_scale=(250.0,),
    error_scale=(15.0,),
)
RL_CBF_CLF_QP = Problem(
    "rl-cbf-clf-qp",
    JOINTS,
    quantities=("V", "B1", "B2", "C1", "C2"),
    observation=(*STATE_OBSERVATION, "l_min"),
    units=UNITS,
    alpha_scale=(1.5, 1.0, 1.0, 4.0, 4.0),
    beta_scale=(250.0, 60.0, 60.0, 800.0, 200.0),
    error_scale=(15.0, 10.0, 5.0, 150.0, 30.0),
    omissible=("l_min",),
    optional=(STEP_LENGTH,),
)
PAPER = (IO_RL_CLF_QP, RL_CLF_QP, RL_CBF_CLF_QP)

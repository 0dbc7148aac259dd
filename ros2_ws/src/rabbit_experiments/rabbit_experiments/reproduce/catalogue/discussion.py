"""Imperfections of the robot that the paper's discussion names, and dead time."""

from rabbit_experiments.reproduce.perturbation import Perturbation
from rabbit_experiments.reproduce.tolerance import Tolerance

MOTOR_POWER = Perturbation(
    name="motor-power",
    title="Motor power -15%",
    paper="Joint friction as a loss of 15% of motor power: successful results.",
    why="At scale 1 a loss of 15% does not stop the nominal controllers. The policies, trained at scale 2, err by "
    "half the mass there besides: over stones they leave the cone and the stones in PyBullet; on `rigid`, "
    "whose stance foot is pinned, they walk.",
    field="motor_loss",
    value=0.15,
    what="15% less power",
)
JOINT_DAMPING = Perturbation(
    name="joint-damping",
    title="Joint damping 1 (rad/s²)/(rad/s)",
    paper="Joint damping of up to 1 (rad/s²)/(rad/s): successful results.",
    why="Damping alone does not stop the nominal controller on flat ground. At scale 1 the policies, trained at "
    "scale 2, err by half the mass besides: in PyBullet their stance foot leaves the ground, on `rigid`, "
    "where it is pinned, it cannot.",
    field="joint_damping",
    value=1.0,
    what="joints damped by 1/s",
)
LINK_BENDING = Perturbation(
    name="link-bending",
    title="Links bent by 5% of their length",
    paper="Bending of links by up to 5% of their length: successful results.",
    why="A bend of thigh and shin is, to first order, a hip that is turned and does not tell: the outputs are "
    "wrong by it, and so is where the foot lands. The rows do not say so: the oracle, exact in all of them, "
    "falls on stones as well (every-plant-stones), and what walks there calibrates its joints from the stance "
    "foot. How the paper bent its links, and what its outputs knew of it, is not told.",
    field="link_bend",
    value=0.05,
    what="links bent 5%",
)
VELOCITY_NOISE = Tolerance(
    name="velocity-noise",
    title="Noise of the measured rates, stepping stones",
    label="sec:discussion",
    paper="Measured derivatives could be noisy in experiments; no figure is given.",
    field="velocity_noise",
    values=(0.0, 0.02, 0.05, 0.1, 0.2, 0.4),
    axis="standard deviation of the measured rates (rad/s)",
    what="noise",
)
DELAY = Tolerance(
    name="delay",
    title="Delay of the torque, stepping stones",
    label="further",
    paper="nothing; it has a motor lag of 4 ms.",
    field="torque_delay",
    values=(0.0, 0.002, 0.004, 0.006, 0.008),
    axis="delay of the torque (ms)",
    scale=1e3,
    what="delay",
)

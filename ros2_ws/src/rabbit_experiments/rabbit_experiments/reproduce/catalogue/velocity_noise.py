"""Noise of the measured joint rates (Discussion: numerical differentiation "could be noisy in experiments")."""

from rabbit_experiments.reproduce.tolerance import Tolerance


class VelocityNoise(Tolerance):
    """White, drawn anew each tick."""

    name = "velocity-noise"
    title = "Noise of the measured rates, stepping stones"
    label = "sec:discussion"
    paper = "Measured derivatives could be noisy in experiments; no figure is given."
    field = "velocity_noise"
    values = (0.0, 0.02, 0.05, 0.1, 0.2, 0.4)
    axis = "standard deviation of the measured rates (rad/s)"
    what = "noise"
    caption = (
        "Courses of 20 stones walked over the noise; learned and oracle at scale 2, nominal at scale 1; 95% intervals."
    )

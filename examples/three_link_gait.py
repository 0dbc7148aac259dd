"""A gait for the three-link walker: half a metre a step, a metre a second, found in a minute.

    python examples/three_link_gait.py

Outputs are the torso's pitch and the sum of the legs' angles, over the stance leg's angle. The swing foot is below the
ground in mid-swing, as straight legs are, and above it from 0.6 of the step on.
"""

import numpy as np
from rabbit_gait_design.planar_design import PlanarSpecification, design
from rl_cbf_clf_controller.step_paths import StepPath
from three_link_walker import WALKER

GUESS = StepPath(np.array([[0.15] * 6, [0.0, 0.0, 0.0, -0.1, -0.05, 0.0]]), phase_angle_start=0.0, phase_angle_end=0.25)


def main() -> None:
    """Print the control points from the third on; the first two follow from the impact."""
    wanted = PlanarSpecification(step_length=0.5, speed=1.0)
    gait = design(WALKER, wanted, GUESS, lambda iteration, cost: print(f"{iteration}: cost {cost:.5f}", flush=True))
    print(f"LATER = {gait.path.coeffs[:, 2:].round(4).tolist()}, phase_angle_end = {gait.path.phase_angle_end:.4f}")
    torque = np.abs(gait.series("torque")).max()
    print(f"eigenvalue {gait.eigenvalue:.2f}, torque at most {torque:.0f} Nm, step time {gait.duration:.2f} s")


if __name__ == "__main__":
    main()

"""A gait of a walker, near the path in its file: prints what goes there. It takes a minute or a few.

    make studies
    python examples/walker_gait.py examples/three_link_walker.yaml --step-length 0.5 --speed 1

The first two control points of the path follow from its end through the impact; the rest is optimised.
"""

import sys
from pathlib import Path

import numpy as np
import typer
from rl_cbf_clf_controller.planar_walker import read_walker

try:
    from rabbit_gait_design.hybrid_zero_dynamics import Walker
    from rabbit_gait_design.pinocchio_model import PinocchioModel
    from rabbit_gait_design.planar_design import PlanarSpecification, design
except ModuleNotFoundError as error:
    sys.exit(f"{error.name} is not installed: call make studies, or pip install ./studies")

DIGITS = 4  # after the point


def tell(iteration: int, cost: float) -> None:
    """Print how far the optimisation is."""
    print(f"# {iteration}: cost {cost:.5f}", flush=True)


def main(
    file: Path, step_length: float = 0.5, speed: float = 1.0, torque_limit: float = 100.0, clear_from: float = 0.6,
    clearance: float = 0.01, max_eigenvalue: float = 0.9,
) -> None:  # fmt: skip
    """Print path, phase range and phase rate."""
    own = read_walker(file)
    walker = Walker(PinocchioModel(own.urdf, feet=own.feet), own.angles, own.order)
    wanted = PlanarSpecification(
        step_length, speed, clear_from, clearance, torque_limit=torque_limit, max_eigenvalue=max_eigenvalue
    )
    gait = design(walker, wanted, own.path, tell)
    rows = zip(own.outputs, gait.path.coeffs.round(DIGITS).tolist(), strict=True)
    print("path:", *(f"  {name}: {row}" for name, row in rows), sep="\n")
    begin, end, rate = gait.path.phase_angle_start, gait.path.phase_angle_end, gait.rates[0]
    print(f"phase_range: [{begin:.{DIGITS}f}, {end:.{DIGITS}f}]", f"phase_rate: {rate:.{DIGITS}f}", sep="\n")
    torque = np.abs(gait.series("torque")).max()
    print(f"# {wanted}: eigenvalue {gait.eigenvalue:.2f}, torque at most {torque:.0f} N m, {gait.duration:.2f} s")


if __name__ == "__main__":
    typer.run(main)

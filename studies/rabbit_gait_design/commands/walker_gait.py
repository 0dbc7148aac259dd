"""`rabbit gait --task WALKER`: a gait for a walker of your own, written into a copy of its file."""

import os
from itertools import chain
from pathlib import Path
from typing import Annotated, Any

import typer
from rabbit_common.options import complaints, fail

from rabbit_gait_design.commands.gait import NOT_FOUND

DIGITS = 4  # after the point

Positive = {"min": 0.01}


def gait(
    task: Annotated[Path, typer.Option(help="a walker's .yaml; path, phase_range and phase_rate may be missing")],
    out: Annotated[Path | None, typer.Option(help="file to write (default: beside TASK, NAME_gait.yaml)")] = None,
    step_length: Annotated[float, typer.Option(help="m", **Positive)] = 0.35,
    speed: Annotated[float, typer.Option(help="m/s", **Positive)] = 0.7,
    torque_limit: Annotated[float | None, typer.Option(help="N m (default: the file's limit)", **Positive)] = None,
    friction_limit: Annotated[float, typer.Option(help="|F_T| / F_N at most", **Positive)] = 0.6,
    least_force: Annotated[float, typer.Option(help="normal to the ground, N", **Positive)] = 50.0,
    clear_from: Annotated[float, typer.Option(help="phase from which the swing foot is above the ground")] = 0.6,
    clearance: Annotated[float, typer.Option(help="its height midway from there to the landing, m")] = 0.01,
    max_eigenvalue: Annotated[float, typer.Option(help="of the step-to-step map", **Positive)] = 0.9,
) -> None:
    """Find a walker's gait by optimisation on its hybrid zero dynamics: a minute or a few.

    The path of the file is where the search begins, if it has one; else two supports on both feet and a bent knee.
    """
    from rabbit_common.own_folder import new_file
    from rabbit_description.atomic_file import replace_text
    from rabbit_description.yaml_file import dump_yaml, read_mapping
    from rich.console import Console
    from rl_cbf_clf_controller.planar_walker import read_walker

    from rabbit_gait_design.hybrid_zero_dynamics import Walker
    from rabbit_gait_design.pinocchio_model import PinocchioModel
    from rabbit_gait_design.planar_design import PlanarDesignError, PlanarSpecification, search
    from rabbit_gait_design.walker_guess import guesses

    target = new_file(out or task.with_name(f"{task.stem}_gait.yaml"))
    with complaints(ValueError):
        said = read_mapping(task)
        flat = {name: [0.0, 0.0] for name in said.get("outputs") or ()}
        read = read_walker(task, {"path": flat, "phase_range": [0, 1], "phase_rate": 1})
    walker = Walker(PinocchioModel(read.urdf, feet=read.feet), read.angles, read.order)
    limits: dict[str, Any] = {"friction_limit": friction_limit, "min_normal_force": least_force}
    limits |= {"max_eigenvalue": max_eigenvalue, "stones": read.file.stones}
    limit = torque_limit or read.file.limit
    wanted = PlanarSpecification(step_length, speed, clear_from, clearance, torque_limit=limit, **limits)
    given = [read.path] if "path" in said else []
    try:
        with Console().status("begins") as status:
            tell = lambda iteration, cost: status.update(f"iteration {iteration}: cost {cost:.5f}")  # noqa: E731
            step = search(walker, wanted, chain(given, guesses(walker, step_length)), tell)
    except PlanarDesignError as error:
        fail(error, NOT_FOUND)
    path, rows = step.path, step.path.coeffs.round(DIGITS).tolist()
    said |= {"urdf": os.path.relpath(task.parent / read.file.urdf, target.parent)}
    said |= {"path": dict(zip(read.outputs, rows, strict=True)), "phase_rate": round(float(step.rates[0]), DIGITS)}
    said["phase_range"] = [round(angle, DIGITS) for angle in (path.phase_angle_start, path.phase_angle_end)]
    with complaints(OSError):
        replace_text(target, dump_yaml(said))
    torque = abs(step.series("torque")).max()
    print(f"eigenvalue {step.eigenvalue:.2f}, torque at most {torque:.0f} N m, {step.duration:.2f} s a step")
    print(f"written {target}")

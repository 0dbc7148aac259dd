"""From a specification to a gait: solve, check, describe."""

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import version
from typing import Any

import casadi as ca
import numpy as np
from rabbit_description.gait import Gait

from rabbit_gait_design.orbit import Orbit
from rabbit_gait_design.specification import GaitSpecification
from rabbit_gait_design.transcription import Transcription, broken
from rabbit_gait_design.zero_dynamics import ZeroDynamics

Progress = Callable[[int, float, float], None]  # iteration, cost, largest constraint violation


class GaitDesignError(RuntimeError):
    """IPOPT found no gait: names the status and the constraints that stayed broken."""


def design_gait(specification: GaitSpecification, progress: Progress | None = None, guess: Gait | None = None) -> Gait:
    """Find the cheapest gait that keeps the specification.

    `progress(iteration, cost, violation)` is called at every iteration of IPOPT, which begins with the path of `guess`.

    Raises:
        GaitDesignError: IPOPT did not converge.
    """
    programme = Transcription(specification, guess)
    with _held_signals() as held:

        def watch(iteration: int) -> None:
            cost, excess = programme.latest()
            if progress:
                progress(iteration, cost, max(float(excess.max()), 0.0))
            if held:
                raise KeyboardInterrupt  # which stops IPOPT

        programme.callback(watch)
        of_ipopt: dict[str, Any] = {"print_level": 0, "sb": "yes", "tol": 1e-9}
        of_ipopt["max_iter"] = specification.max_iterations
        programme.solver("ipopt", {"print_time": False, "expand": True, "detect_simple_bounds": True}, of_ipopt)
        try:
            solution = programme.solve()
        except RuntimeError as error:
            raise GaitDesignError(_complaint(programme)) from error
    return _as_gait(programme, solution)


def _complaint(programme: Transcription) -> str:
    spec, (_, excess) = programme.specification, programme.latest()
    worst = list(broken(programme.rows, excess).items())[:3]
    return (
        f"gait {spec.name}: no gait of {spec.step_length} m at {spec.speed} m/s found "
        f"(IPOPT: {programme.return_status()}); constraints still broken: "
        f"{', '.join(f'{name} by {value:.3g}' for name, value in worst) or 'none'}; "
        "loosen those, or change speed or step_length"
    )


def _as_gait(programme: Transcription, solution: ca.OptiSol) -> Gait:
    spec, (coeffs, phase_range) = programme.specification, (np.array(solution.value(part)) for part in programme.path)
    fields: dict[str, Any] = {
        "name": spec.name,
        "step_length": spec.step_length,
        "step_time": spec.step_time,
        "slope": spec.slope,
        "phase_angle_start": float(phase_range[0]),
        "phase_angle_end": float(phase_range[1]),
        "bezier_coeffs": coeffs.tolist(),
    }
    shape = Gait(**fields, q_start=[0.0] * 7, dq_start=[0.0] * 7)
    q, dq = ZeroDynamics(shape).state(0.0, float(np.sqrt(2 * solution.value(programme.sigma[0]))))
    gait = Gait(**fields, q_start=q.tolist(), dq_start=dq.tolist())
    metadata = {
        "command": "rabbit gait",
        "specification": spec.model_dump(mode="json"),
        "figures": Orbit(gait).figures().rounded(),
        "iterations": int(solution.stats()["iter_count"]),
        "versions": {
            "casadi": version("casadi"),
            "pinocchio": version("pin"),
            "numpy": version("numpy"),
            "python": ".".join(map(str, sys.version_info[:3])),
        },
    }
    return gait.model_copy(update={"metadata": metadata})


@contextmanager
def _held_signals() -> Iterator[list[int]]:
    """SIGINT and SIGTERM that come meanwhile, heard at the end: CasADi may lose the exception that a handler raises."""
    held: list[int] = []
    in_main = threading.current_thread() is threading.main_thread()  # where Python hears signals
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM) if in_main}
    handlers = {number: handler for number, handler in handlers.items() if callable(handler)}
    for number in handlers:
        signal.signal(number, lambda got, _: held.append(got))
    try:
        yield held
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        if held:
            signal.raise_signal(held[0])

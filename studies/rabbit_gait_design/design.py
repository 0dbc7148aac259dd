"""From a specification to a gait: solve, check, describe."""

import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from typing import Any

import casadi as ca
import numpy as np
from rabbit_description.gait import Gait
from rabbit_description.state import Array

from rabbit_gait_design.orbit import Orbit
from rabbit_gait_design.specification import GaitSpecification
from rabbit_gait_design.transcription import Transcription
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
    nlp, bounds = programme.nlp(), programme.bounds()
    options: dict[str, Any] = {
        "print_time": False,
        "ipopt": {"print_level": 0, "sb": "yes", "max_iter": specification.max_iterations, "tol": 1e-9},
    }
    with _held_signals() as held:
        options["iteration_callback"] = _Watch(nlp, bounds, progress or (lambda *_: None), held)
        solver = ca.nlpsol("gait", "ipopt", nlp, options)
        solution = solver(**bounds)
    stats = solver.stats()
    if not stats["success"]:
        raise GaitDesignError(_complaint(programme, stats["return_status"], solution["g"]))
    return _as_gait(programme, solution, int(stats["iter_count"]))


def _complaint(programme: Transcription, status: str, rows: ca.DM) -> str:
    spec, broken = programme.specification, programme.rows.broken(np.asarray(rows).ravel())
    worst = ", ".join(f"{name} by {value:.3g}" for name, value in list(broken.items())[:3]) or "none"
    return (
        f"gait {spec.name}: no gait of {spec.step_length} m at {spec.speed} m/s found (IPOPT: {status}); "
        f"constraints still broken: {worst}; loosen those, or change speed or step_length"
    )


def _as_gait(programme: Transcription, solution: dict[str, ca.DM], iterations: int) -> Gait:
    spec, x = programme.specification, np.asarray(solution["x"]).ravel()
    coeffs, phase_range, rate = programme.unpack(x)
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
    q, dq = ZeroDynamics(shape).state(0.0, rate)
    gait = Gait(**fields, q_start=q.tolist(), dq_start=dq.tolist())
    metadata = {
        "command": "rabbit gait",
        "specification": spec.model_dump(mode="json"),
        "figures": Orbit(gait).figures().rounded(),
        "iterations": iterations,
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


class _Watch(ca.Callback):
    """Hands IPOPT's iterates to a progress function; a signal that is `held` stops the solver."""

    def __init__(
        self, nlp: dict[str, ca.SX], bounds: dict[str, Array], progress: Progress, held: Sequence[int]
    ) -> None:
        ca.Callback.__init__(self)
        self._held = held
        self._sizes = {"x": nlp["x"].numel(), "f": 1, "g": nlp["g"].numel(), "p": 0}
        self._bounds, self._progress, self._iteration = bounds, progress, 0
        self.construct("watch", {})

    def get_n_in(self) -> int:
        return int(ca.nlpsol_n_out())

    def get_name_in(self, i: int) -> str:
        return str(ca.nlpsol_out(i))

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        name = ca.nlpsol_out(i).removeprefix("lam_")
        return ca.Sparsity.dense(self._sizes[name], 1) if self._sizes[name] else ca.Sparsity(0, 0)

    def eval(self, arguments: Sequence[ca.DM]) -> list[int]:
        values = dict(zip(map(ca.nlpsol_out, range(ca.nlpsol_n_out())), arguments, strict=True))
        rows = np.asarray(values["g"]).ravel()
        violation = np.maximum(self._bounds["lbg"] - rows, rows - self._bounds["ubg"]).max()
        self._progress(self._iteration, float(values["f"]), float(max(violation, 0.0)))
        self._iteration += 1
        return [len(self._held)]

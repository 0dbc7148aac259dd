"""GP-CBF-CLF-SOCP (Castañeda, Choi, Zhang, Tomlin, Sreenath 2021): the walking controller with GPs for its policy.

    minimise   mu'mu + p d^2
    subject to mean_V(mu) + confidence deviation_V(mu) + rate V <= d
               mean_Bi(mu) - confidence deviation_Bi(mu) + K_b eta_Bi >= 0, i = 1, 2;    the force rows alike

mean is the nominal value and the GP's mean, affine in mu; the squared deviation is the GP's variance, quadratic in mu.
"""

from pathlib import Path
from typing import Any

import numpy as np
from cbf_clf_qp.answer import Solver
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import Array, Values
from pydantic import Field
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.policy import Policy
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.scene import Scene
from rl_cbf_clf_controller.weights import PolicyFileError

from rabbit_rivals import cone_programme
from rabbit_rivals.gaussian_process import MU_UNIT, Kernel, Posterior
from rabbit_rivals.model_file import About, ModelFile, read

TINY = 1e-9  # least variance, in the square of an error's unit


class GpAbout(About):
    """Kernels and transitions of a problem's GPs; see `GpPolicy`."""

    problem: str
    quantities: tuple[str, ...] = Field(min_length=1)
    observation: tuple[str, ...] = Field(min_length=1)
    center: tuple[float, ...] = Field(description="a kernel reads (observation - center) / scale")
    scale: tuple[float, ...]
    error_scale: tuple[float, ...] = Field(description="of z, in the quantities' units; that of V times |LgV| + 1")
    transitions: int = Field(ge=1, le=100_000)
    inducing: int = Field(ge=1, le=2000, description="of the transitions, at most, for each quantity")
    hours: float = Field(ge=0, description="of walking and fitting")
    command: str = Field(description="makes this file again")

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        n, k, d = self.transitions, len(self.quantities), len(self.observation)
        data = {"x": (n, d), "mu": (n, 4), "z": (n, k), "inducing": (k, self.inducing)}
        return data | {"signal": (k, 5), "lengths": (k, d), "noise": (k,)}


class GpPolicy(Policy):
    """A GP for each quantity: its mean as alpha and beta.

    Of the last tick: `deviations`, (5, 5) each, and `slopes` (5, 4) over mu.

    |deviation [1, mu]| is the standard deviation of the quantity's error, in its unit.
    """

    adaptation = "none"

    def __init__(self, file: ModelFile[GpAbout], confidence: float) -> None:
        self.confidence, self.version = confidence, f"{file.version}, confidence {confidence:g}"
        self.about = file.about
        data = {name: array.astype(float) for name, array in file.arrays.items()}
        self._center, self._scale = np.array(file.about.center), np.array(file.about.scale)
        self._units = np.array(file.about.error_scale)
        self._to_mu = np.array([1.0, *[1 / MU_UNIT] * 4])
        w, inducing = data["mu"] / MU_UNIT, file.arrays["inducing"]
        self._posteriors = [
            Posterior(
                Kernel(data["signal"][i], data["lengths"][i], float(data["noise"][i])),
                *(data["x"], w, data["z"][:, i], inducing[i][inducing[i] >= 0]),
            )
            for i in range(len(file.about.quantities))
        ]
        self.deviations, self.slopes = list[Array](), np.zeros((0, 4))

    def estimate(self, scene: Scene, before: Estimates) -> Estimates:
        """The means at a tick."""
        x = (scene.observation[: len(self._center)] - self._center) / self._scale
        means, self.deviations = [], []
        for posterior, unit, name in zip(self._posteriors, self._units, self.about.quantities, strict=True):
            size = unit * (np.linalg.norm(scene.LgV) + 1) if name == "V" else unit
            mean, covariance = posterior.at(x)
            means.append(size * self._to_mu * mean)
            factor = np.linalg.cholesky(covariance + TINY * np.eye(len(mean)))
            self.deviations.append(size * factor.T * self._to_mu)
        weights = np.array(means)
        self.slopes = scene.seen.nominal_a + weights[:, 1:]
        return Estimates(weights[:, 1:], weights[:, 0])


class ConeSolver:
    """Solves a tick's programme with the margins that the GPs of its controller ask for."""

    def __init__(self, controller: "GpController") -> None:
        self._controller = controller

    def reset(self) -> None:
        """Does nothing: nothing is kept."""

    def solve(self, data: Values) -> tuple[Array, Array, float, str]:
        """See `Solver`; an answer has no multipliers, so no KKT residual tells whether it counts."""
        layout = self._controller.qp.layout
        x, is_solved, status = cone_programme.solve(data, layout, self._factors(data))
        return x, np.zeros(len(layout.names)), np.inf if is_solved else 0.0, status

    def _factors(self, data: Values) -> dict[int, Array]:
        """The margin of each row of the quantities, in the QP's scaling."""
        policy, layout, p = self._controller.policy, self._controller.qp.layout, self._controller.parameters
        of_row = combinations(self._controller.qp.names, p.friction_coeff - p.friction_margin)
        factors: dict[int, Array] = {}
        for i, name in enumerate(layout.names):
            if name in of_row and policy.confidence:
                weights = of_row[name]
                scaled = np.linalg.norm(data.A[i, : layout.inputs])
                norm = np.linalg.norm(weights @ policy.slopes) / scaled if scaled else 1.0
                parts = [weight * policy.deviations[k] for k, weight in enumerate(weights) if weight]
                factors[i] = policy.confidence / norm * np.concatenate(parts)
        return factors


class GpController(Controller):
    """The walking controller with the cone programme in place of the QP."""

    policy: GpPolicy

    def __init__(self, *parts: Any) -> None:
        super().__init__(*parts)
        self.solvers = ("clarabel",)

    def make_solver(self, name: str) -> Solver:
        """The cone programme's."""
        return ConeSolver(self)


def combinations(quantities: tuple[str, ...], friction_coeff: float) -> dict[str, Array]:
    """What each row constrains of the quantities (n,), by the row's name; the sign of a row plays no part."""
    unit = dict(zip(quantities, np.eye(len(quantities)), strict=True))
    rows = {"CLF": unit["V"]}
    if "B1" in unit:
        rows |= {"B1": unit["B1"], "B2": unit["B2"], "C1": unit["C1"]}
        rows |= {f"C2{'+' if s < 0 else '-'}": friction_coeff * unit["C1"] + s * unit["C2"] for s in (-1, 1)}
    return rows


def gp_policy(path: str, problem: Problem, confidence: float) -> GpPolicy:
    """The policy of a file.

    Raises:
        PolicyFileError: it cannot be read, or was fitted for another problem.
    """
    file = read(Path(path), GpAbout)
    if (file.about.problem, file.about.quantities) != (problem.name, problem.quantities):
        raise PolicyFileError(f"{path}: fitted for {file.about.problem}; this controller needs {problem}")
    return GpPolicy(file, confidence)

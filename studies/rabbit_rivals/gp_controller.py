"""GP-CBF-CLF-SOCP (Castañeda, Choi, Zhang, Tomlin, Sreenath 2021): the walking controller with GPs for its policy.

    minimise   mu'mu + p d^2
    subject to mean_V(mu) + confidence deviation_V(mu) + rate V <= d
               mean_Bi(mu) - confidence deviation_Bi(mu) + K_b eta_Bi >= 0, i = 1, 2;    the force rows alike

mean is the nominal value and the GP's mean, affine in mu; the squared deviation is the GP's variance, quadratic in mu.
"""

import time
from pathlib import Path
from typing import Any

import numpy as np
from cbf_clf_qp.answer import Decided
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import Array
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
    """A GP for each quantity: its mean as alpha and beta; `deviations` of the last tick, (5, 5) each.

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
        self.deviations: list[Array] = []

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
        found = np.array(means)
        return Estimates(found[:, 1:], found[:, 0])


class GpController(Controller):
    """The walking controller with the cone programme in place of the QP."""

    policy: GpPolicy

    def decide(self, scene: Scene) -> Decided:
        """mu at a tick."""
        start = time.perf_counter()
        self.estimates = self.policy.estimate(scene, self.qp.no_error())
        self.parts = [self.estimates]
        qp, layout = self.qp.programme(scene.x, scene.p, self.estimates), self.qp.layout
        factors = self._factors(qp, scene.seen.nominal_a + self.estimates.alpha)
        x, is_solved, status = cone_programme.solve(qp, layout, factors)
        values = self.qp.answer.reading(qp.row, x, np.zeros(len(layout.names)))
        return Decided(values, layout, is_solved, "clarabel", status, time.perf_counter() - start)

    def _factors(self, qp: Any, slopes: Array) -> dict[int, Array]:
        """The margin of each row of the quantities, in the QP's scaling; `slopes` (n, 4) are theirs over mu."""
        of_row = combinations(self.qp.names, self.parameters.friction_coeff - self.parameters.friction_margin)
        factors: dict[int, Array] = {}
        for i, name in enumerate(self.qp.layout.names):
            if name in of_row and self.policy.confidence:
                weights = of_row[name]
                scaled = np.linalg.norm(qp.A[i, : self.qp.layout.inputs])
                norm = np.linalg.norm(weights @ slopes) / scaled if scaled else 1.0
                parts = [weight * self.policy.deviations[k] for k, weight in enumerate(weights) if weight]
                factors[i] = self.policy.confidence / norm * np.concatenate(parts)
        return factors


def combinations(quantities: tuple[str, ...], friction_coeff: float) -> dict[str, Array]:
    """Of the quantities (n,), what each row constrains, by the row's name; the sign of a row plays no part."""
    unit = dict(zip(quantities, np.eye(len(quantities)), strict=True))
    rows = {"CLF": unit["V"]}
    if "B1" in unit:
        rows |= {"B1": unit["B1"], "B2": unit["B2"], "C1": unit["C1"]}
        rows |= {f"C2{'+' if s < 0 else '-'}": friction_coeff * unit["C1"] + s * unit["C2"] for s in (-1, 1)}
    return rows


def gp_policy(path: str, problem: Problem, confidence: float) -> GpPolicy:
    """From a file.

    Raises:
        PolicyFileError: it cannot be read, or was fitted for another problem.
    """
    file = read(Path(path), GpAbout)
    if (file.about.problem, file.about.quantities) != (problem.name, problem.quantities):
        raise PolicyFileError(f"{path}: fitted for {file.about.problem}; this controller needs {problem}")
    return GpPolicy(file, confidence)

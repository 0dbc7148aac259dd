"""Gaussian processes of an error that is affine in the input, and their sparse posterior.

The error of a quantity is z(x, mu) = [1, w] f(x) + noise with w = mu / MU_UNIT and f (m + 1,) unknown. Independent GPs
on the components of f make the affine dot product compound kernel of Castañeda et al. (2021, "Gaussian Process-based
Min-norm Stabilizing Controller", definition 2):

    k((x, w), (x', w')) = [1, w] diag(k_0(x, x'), ..., k_m(x, x')) [1, w']'
    k_i(x, x') = s_i^2 exp(-|(x - x') / l|^2 / 2)

So at a state x the posterior is a mean affine in w and a variance quadratic in it:

    E z = [1, w] mean(x)        Var z = [1, w] covariance(x) [1, w]'

With all transitions n as inducing points the posterior is the exact one. With m of them it is that of the projected
process, whose k(X, X) is K_nm K_mm^-1 K_mn (DTC; Quiñonero-Candela and Rasmussen 2005, section 4): all transitions
count, at a price of m^2 a tick, and far from them the variance is still the prior's.
"""

from dataclasses import dataclass

import numpy as np
from cbf_clf_qp.functions import Array
from scipy.linalg import solve_triangular
from scipy.optimize import minimize

MU_UNIT = 50.0  # rad/s^2
RANGE = 30.0  # factor, up and down, in which a fit looks for each parameter
JITTER = 1e-6  # of the kernel's largest variance


@dataclass(frozen=True)
class Kernel:
    """`signal` (m + 1,) are the s_i, `lengths` (d,) the l, `noise` the standard deviation of a measurement."""

    signal: Array
    lengths: Array
    noise: float

    def components(self, x: Array, other: Array) -> Array:
        """k_i between rows of `x` (a, d) and `other` (b, d), shape (m + 1, a, b)."""
        a, b = x / self.lengths, other / self.lengths
        squares = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2 * a @ b.T
        return np.square(self.signal)[:, None, None] * np.exp(-0.5 * np.maximum(squares, 0))

    def __call__(self, x: Array, w: Array, other: Array, other_w: Array) -> Array:
        """The compound kernel, with inputs `w` (a, m) and `other_w` (b, m), shape (a, b)."""
        products = with_one(w).T[:, :, None] * with_one(other_w).T[:, None, :]
        return (products * self.components(x, other)).sum(0)

    def variance(self, w: Array) -> Array:
        """The prior's, without noise, at inputs `w` (a, m); shape (a,)."""
        return np.square(with_one(w)) @ np.square(self.signal)


class Posterior:
    """The posterior of one quantity, from transitions `x` (n, d), `w` (n, m), `z` (n,), spanned by rows `inducing`."""

    def __init__(self, kernel: Kernel, x: Array, w: Array, z: Array, inducing: Array) -> None:
        self.kernel = kernel
        self._x, v = x[inducing] / kernel.lengths, with_one(w[inducing])
        self._squares = (self._x**2).sum(1)
        self._v = v.T * np.square(kernel.signal)[:, None]
        K = kernel(x[inducing], w[inducing], x[inducing], w[inducing])
        K[np.diag_indices_from(K)] += JITTER * np.diag(K).max()
        left = np.linalg.cholesky(K)
        A = solve_triangular(left, kernel(x[inducing], w[inducing], x, w), lower=True) / kernel.noise
        B = np.linalg.cholesky(np.eye(len(A)) + A @ A.T)
        inverse = solve_triangular(left, np.eye(len(left)), lower=True)
        whitened = solve_triangular(B, inverse, lower=True)
        self._weights = whitened.T @ solve_triangular(B, A @ z / kernel.noise, lower=True)
        self._precision = inverse.T @ inverse - whitened.T @ whitened

    def at(self, x: Array) -> tuple[Array, Array]:
        """Mean (m + 1,) and covariance (m + 1, m + 1) of f at `x` (d,), as in z = [1, w] f."""
        scaled = x / self.kernel.lengths
        squares = self._squares + scaled @ scaled - 2 * self._x @ scaled
        K = self._v * np.exp(-0.5 * np.maximum(squares, 0))
        covariance = np.diag(np.square(self.kernel.signal)) - K @ self._precision @ K.T
        return K @ self._weights, covariance


def with_one(w: Array) -> Array:
    """[1, w], row by row."""
    return np.column_stack([np.ones(len(w)), w])


def spread(kernel: Kernel, x: Array, w: Array, count: int) -> Array:
    """The `count` transitions that know most of the others: each next one is that of the largest posterior variance.

    It is the pivoted Cholesky decomposition; fewer are chosen where the rest are known.
    """
    variance = kernel.variance(w)
    least = JITTER * variance.max()
    rows = np.zeros((min(count, len(x)), len(x)))
    chosen: list[int] = []
    for i in range(len(rows)):
        pivot = int(np.argmax(variance))
        if variance[pivot] <= least:
            break
        row = kernel(x[[pivot]], w[[pivot]], x, w)[0] - rows[:i, pivot] @ rows[:i]
        rows[i] = row / np.sqrt(variance[pivot])
        variance = variance - rows[i] ** 2
        variance[pivot] = 0.0
        chosen.append(pivot)
    return np.array(chosen)


def fit(x: Array, w: Array, z: Array) -> Kernel:
    """The kernel of the largest marginal likelihood of the exact GP, from unit lengths on."""
    inputs = w.shape[1]
    begin = np.log(np.concatenate([np.full(inputs + 1, z.std()), np.full(x.shape[1], 3.0), [0.3 * z.std()]]))
    begin[1 : inputs + 1] += np.log(0.3)
    low, high = begin - np.log(RANGE), begin + np.log(RANGE)
    optimum = minimize(
        negative_log_likelihood,
        begin,
        args=(x, w, z),
        jac=True,
        method="L-BFGS-B",
        bounds=list(zip(low, high, strict=True)),
        options={"maxiter": 100},
    )
    return kernel_of(optimum.x, inputs)


def kernel_of(logs: Array, inputs: int) -> Kernel:
    """The kernel from the logarithms of signal (m + 1,), lengths (d,) and noise."""
    values = np.exp(logs)
    return Kernel(values[: inputs + 1], values[inputs + 1 : -1], float(values[-1]))


def negative_log_likelihood(logs: Array, x: Array, w: Array, z: Array) -> tuple[float, Array]:
    """-log p(z | x, w), and its gradient in the logarithms that `kernel_of` reads.

    d/dp = tr((K^-1 - K^-1 z z' K^-1) dK/dp) / 2.
    """
    n, inputs = w.shape
    kernel = kernel_of(logs, inputs)
    v = with_one(w)
    parts = kernel.components(x, x) * (v.T[:, :, None] * v.T[:, None, :])
    K = parts.sum(0)
    left = np.linalg.cholesky(K + kernel.noise**2 * np.eye(n))
    inverse = solve_triangular(left, np.eye(n), lower=True)
    inverse = inverse.T @ inverse
    solved = inverse @ z
    value = 0.5 * z @ solved + np.log(np.diag(left)).sum() + 0.5 * n * np.log(2 * np.pi)
    G = 0.5 * (inverse - np.outer(solved, solved))
    of_signal = [2 * (G * part).sum() for part in parts]
    weighted = G * K
    rows = weighted.sum(1)
    # sum_ab weighted_ab (x_a - x_b)^2 = 2 (x^2)' rows - 2 x' weighted x
    squares = 2 * np.square(x).T @ rows - 2 * np.einsum("ad,ab,bd->d", x, weighted, x, optimize=True)
    of_noise = 2 * kernel.noise**2 * np.trace(G)
    return float(value), np.concatenate([of_signal, squares / kernel.lengths**2, [of_noise]])

"""What noise of the measured rates does to a numerical derivative, and what a filter saves of it.

The learning needs y'' and B_i'' of the true plant [eq:loss_functions]. It takes one difference over a tick of

    z = (dy, dB_1, dB_2)        linear in the measured rates dq, at given angles

so white noise n of dq puts (J n' - J n) / dt into the derivative. V-dot's error is LgV times that of y''. Measured with
noise and compared to the same difference without, at the states of one walk; the controller has clean rates. Compared

    difference       (z' - z) / dt, as the trainer does
    low-pass         the same of z through a first-order filter, `CUTOFF`; it knows the past alone, and lags
    Savitzky-Golay   the slope of a parabola through `WINDOW` ticks around; after a walk, as it looks ahead

The unit of an error is the rms of what is to be learned there, the model's error in that quantity over the tick.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
from cbf_clf_qp.functions import NumpyFunction, packed
from rabbit_description.gait import Gait
from rabbit_description.state import SWAP_STATE, TICK_SECONDS, Array, Leg
from rabbit_experiments.metrics import IMPACT_TICKS
from rabbit_experiments.walk_records import WalkRecords
from rl_cbf_clf_controller.planar_robot import PinnedRobot
from rl_cbf_clf_controller.robot_numbers import read_robot
from rl_cbf_clf_controller.stone_barriers import stone_barriers
from rl_cbf_clf_controller.virtual_constraints import VirtualConstraints
from scipy.signal import lfilter, savgol_filter

QUANTITIES = ("V", "B1", "B2")
CUTOFF = 100.0  # 1/s
WINDOW = 5  # ticks
DRAWS = 5  # of the noise
OUTPUTS = 4
Derivative = Callable[[Array], Array]  # of one step's z (n, 6): means over its n - 1 ticks (n - 1, 6)


def difference(z: Array) -> Array:
    """Over a tick."""
    return np.diff(z, axis=0) / TICK_SECONDS


def low_passed(z: Array) -> Array:
    """Over a tick, of the filtered z; the filter begins at rest with the step's first value."""
    keep = np.exp(-CUTOFF * TICK_SECONDS)
    filtered, _ = lfilter([1 - keep], [1, -keep], z, axis=0, zi=keep * z[:1])
    return difference(filtered)


def savitzky_golay(z: Array) -> Array:
    """Slope of the parabola through the ticks around, the mean of a tick's two ends."""
    slope = savgol_filter(z, WINDOW, 2, deriv=1, delta=TICK_SECONDS, axis=0)
    mean: Array = (slope[1:] + slope[:-1]) / 2
    return mean


METHODS: Mapping[str, Derivative] = {
    "one difference": difference,
    "low-pass": low_passed,
    "Savitzky-Golay": savitzky_golay,
}


@dataclass(frozen=True)
class Step:
    """One step of a walk: z (n, 6) and its part per unit of noise; LgV over |LgV| + 1 (n, 4); the model's error there.

    `size` (n - 1, 3): model's error in V-dot (over |LgV| + 1), B1'', B2''. `kept` (n - 1,): 40 ms after impact.
    """

    z: Array
    noise: Array
    LgV: Array
    size: Array
    kept: Array

    def errors(self, derivative: Derivative, sigma: float, draw: int) -> Array:
        """What the measurement is off by at the ticks kept, (m, 3)."""
        wrong = derivative(self.z + sigma * self.noise[draw]) - difference(self.z)
        return _in_quantities(wrong, self.LgV)[self.kept]


def steps(walk: WalkRecords, gait: Gait, seed: int) -> list[Step]:
    """The steps of a walk with exact estimates on stones; the noise from `seed`."""
    rng = np.random.default_rng(seed)
    rate = rates(walk, gait)
    made: list[Step] = []
    for index in np.unique(walk.step_index):
        ticks = np.flatnonzero(walk.step_index == index)
        if len(ticks) <= max(WINDOW, IMPACT_TICKS + 1):
            continue
        z = np.column_stack([walk.eta[ticks, OUTPUTS:], walk.barrier_rates[ticks]])
        drawn = rng.standard_normal((DRAWS, len(ticks), 5))
        noise = np.array([[rate(tick, n) for tick, n in zip(ticks.tolist(), each, strict=True)] for each in drawn])
        unit = walk.LgV[ticks] / (np.linalg.norm(walk.LgV[ticks], axis=1, keepdims=True) + 1)
        error = np.einsum("tij,tj->ti", walk.alpha[ticks], walk.mu[ticks]) + walk.beta[ticks]
        error[:, 0] /= np.linalg.norm(walk.LgV[ticks], axis=1) + 1
        kept = np.arange(len(ticks) - 1) >= IMPACT_TICKS
        made.append(Step(z, noise, unit, error[:-1, : len(QUANTITIES)], kept))
    return made


def relative_errors(walked: list[Step], derivative: Derivative, sigma: float) -> Array:
    """Rms of the measurement's error over the rms of the model's, by quantity, (3,)."""
    wrong = np.concatenate([each.errors(derivative, sigma, draw) for each in walked for draw in range(DRAWS)])
    size = np.concatenate([each.size[each.kept] for each in walked])
    ratio: Array = np.sqrt(np.mean(wrong**2, axis=0) / np.mean(size**2, axis=0))
    return ratio


def _in_quantities(derivative: Array, LgV: Array) -> Array:
    """(n, 6) of z as (n, 3) of V-dot over |LgV| + 1, B1'', B2''."""
    V = np.einsum("ti,ti->t", LgV[:-1], derivative[:, :OUTPUTS])
    return np.column_stack([V, derivative[:, OUTPUTS:]])


def rates(walk: WalkRecords, gait: Gait) -> Callable[[int, Array], Array]:
    """What noise (5,) of the measured angle rates, left/right order, makes of z at a tick, (6,)."""
    outputs, barrier_rates, robot = VirtualConstraints(gait), barrier_rate_function(), read_robot().row
    radii = np.array([walk.about["R1"], walk.about["R2"]], dtype=float)
    margins = float(walk.about["stone_margin"]) * np.array([1, -1])  # l_min and l_max that the barriers know

    def rate(tick: int, noise: Array) -> Array:
        dq, q = np.concatenate([np.zeros(2), noise]), walk.q[tick]
        if walk.stance[tick] == Leg.RIGHT:
            q, dq = q[SWAP_STATE], dq[SWAP_STATE]
        stone = np.append(walk.preview[tick] + margins, walk.stone_height[tick])
        of_barriers = barrier_rates(q, dq, robot, stone, radii).rates
        return np.concatenate([outputs.evaluate(q, dq).dy, of_barriers])

    return rate


def barrier_rate_function() -> NumpyFunction:
    """`rates` (2,) of B1 and B2, m/s, of (q, dq, robot's row, stone (3,), R1 and R2 (2,))."""
    robot, stone, radii = PinnedRobot(), ca.SX.sym("stone", 3), ca.SX.sym("radii", 2)
    barriers = ca.vertcat(*stone_barriers(robot.swing, *ca.vertsplit(stone), *ca.vertsplit(radii)))
    inputs = {"q": robot.q, "dq": robot.dq, "robot": packed(robot.parameters), "stone": stone, "radii": radii}
    return NumpyFunction.of("barrier_rates", inputs, {"rates": robot.rate(barriers)})

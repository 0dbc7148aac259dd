"""The scales of a learning problem, measured: how large alpha, beta and the nominal model's error are on walks.

    alpha_scale, beta_scale     `ROOM` times what the oracle's stay below in 99% of the ticks
    error_scale                 root of the mean square of measured - nominal, under the nominal controller

Those of V are in units of |LgV| + 1, as `Problem` has them.
"""

from collections.abc import Iterable
from dataclasses import replace
from itertools import chain

import numpy as np
from rl_cbf_clf_controller.problem import LEAST, QUANTILE, ROOM, Scales

from rabbit_experiments.assembly import Assembly
from rabbit_experiments.cache import Cache
from rabbit_experiments.engine import run
from rabbit_experiments.evaluation import RecordedWalk
from rabbit_experiments.walk_records import WalkRecords


class ScalesError(ValueError):
    """Walks on which nothing can be measured."""


def measure_scales(
    assembly: Assembly, seeds: Iterable[int], cache: Cache, processes: int | str = 1
) -> dict[str, Scales]:
    """`alpha_scale`, `beta_scale`, `error_scale`, each (n,), of the quantities of the assembly's controller.

    Raises `ScalesError` where no walk has two ticks in one step, `JobError` as `engine.run`.
    """
    both = [replace(assembly, policy=policy) for policy in ("oracle", "zero")]
    walks = [[RecordedWalk(one, seed, title=one.policy) for one in both] for seed in seeds]
    run([*chain(*walks)], cache, processes)
    alphas, betas, errors = [], [], []
    for oracle, nominal in (map(cache.get, pair) for pair in walks):
        units = units_of(oracle)
        alphas.append(np.abs(oracle.alpha).max(axis=2) / units)
        betas.append(np.abs(oracle.beta) / units)
        predicted = np.einsum("tnm,tm->tn", nominal.nominal_a, nominal.mu) + nominal.nominal_b
        same_step = np.diff(nominal.step_index) == 0
        errors.append(((nominal.measured[1:] - predicted[:-1]) / units_of(nominal)[:-1])[same_step])
    measured = {
        "alpha_scale": ROOM * np.nanquantile(np.concatenate(alphas), QUANTILE, axis=0),
        "beta_scale": ROOM * np.nanquantile(np.concatenate(betas), QUANTILE, axis=0),
        "error_scale": np.sqrt(np.nanmean(np.square(np.concatenate(errors)), axis=0)),
    }
    if not all(np.isfinite(values).all() for values in measured.values()):
        raise ScalesError("the walks end before anything is measured: expected a plant on which the robot takes a step")
    return {name: tuple(float(f"{max(value, LEAST):.3g}") for value in values) for name, values in measured.items()}


def units_of(records: WalkRecords) -> np.ndarray:
    """The unit of each tick and quantity: |LgV| + 1 for V, 1 for the others; (ticks, n)."""
    clf = np.array(records.about["quantities"]) == "V"
    size = np.linalg.norm(records.LgV, axis=1)
    return np.where(clf, size[:, None] + 1, 1.0)

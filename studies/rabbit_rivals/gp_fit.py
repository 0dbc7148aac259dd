"""GPs from a training session's transitions: `rabbit train --out DIR` collects them, `fit_session(DIR)` reads them.

Each quantity's kernel is fitted by the marginal likelihood of a random part of the transitions, then all of them count.
"""

import time
from pathlib import Path
from typing import Any

import numpy as np
from cbf_clf_qp.functions import Array
from rabbit_description.yaml_file import read_mapping
from rl_trainer.checkpoint import CheckpointError, read_checkpoint
from rl_trainer.parameters import TrainingParameters

from rabbit_rivals.gaussian_process import MU_UNIT, fit, spread
from rabbit_rivals.gp_controller import GpAbout
from rabbit_rivals.model_file import ModelFile

FITTED = 600  # transitions that a kernel is fitted to


def fit_session(folder: Path, inducing: int, seed: int) -> ModelFile[GpAbout]:
    """The GPs of the session in `folder`; raises `CheckpointError` where there is none."""
    start = time.perf_counter()
    parameters, columns = transitions(folder)
    problem = parameters.problem
    center, scale = np.array([problem.unit(name) for name in parameters.observation]).T
    x = ((columns["observation"] - center) / scale).astype(np.float32)
    mu, z = columns["mu"].astype(np.float32), columns["target"].astype(np.float32)
    part = np.random.default_rng(seed).permutation(len(x))[:FITTED]
    fits: dict[str, list[Any]] = {"signal": [], "lengths": [], "noise": [], "inducing": []}
    for i, name in enumerate(problem.quantities):
        X, w, of_one = x.astype(float), mu / MU_UNIT, z[:, i].astype(float)
        kernel = fit(X[part], w[part], of_one[part])
        fits["signal"].append(kernel.signal)
        fits["lengths"].append(kernel.lengths)
        fits["noise"].append(kernel.noise)
        chosen = spread(kernel, X, w, inducing)
        fits["inducing"].append(np.pad(chosen, (0, inducing - len(chosen)), constant_values=-1))
        print(f"{name}: noise {kernel.noise:.3g} of {of_one.std():.3g}, signal {np.round(kernel.signal, 3)}")
    about = GpAbout(
        problem=problem.name,
        quantities=problem.quantities,
        observation=parameters.observation,
        center=tuple(center),
        scale=tuple(scale),
        error_scale=parameters.scales[2],
        transitions=len(x),
        inducing=inducing,
        hours=round((time.perf_counter() - start) / 3600, 3),
        command=f"rabbit train --problem {problem.name} --seed {parameters.seed} --out DIR; rabbit rival gp DIR",
    )
    kernels = {name: np.array(fits[name]) for name in ("signal", "lengths", "noise")}
    return ModelFile(about, {"x": x, "mu": mu, "z": z, "inducing": np.array(fits["inducing"], np.int32), **kernels})


def transitions(folder: Path) -> tuple[TrainingParameters, dict[str, Array]]:
    """What a session was asked for, and the columns of its replay buffer; raises `CheckpointError`."""
    try:
        parameters = TrainingParameters.model_validate(read_mapping(folder / "parameters.yaml"))
        state = read_checkpoint(folder)
        if state is None:
            raise CheckpointError("no checkpoint")
        columns = {name: column.numpy() for name, column in state["replay"]["columns"].items()}
    except Exception as error:  # a damaged file may raise anything
        raise CheckpointError(f"session {folder}: {' '.join(str(error).split())[:200]}") from error
    return parameters, columns

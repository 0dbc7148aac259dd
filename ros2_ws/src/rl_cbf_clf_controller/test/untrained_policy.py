"""Policy files that nothing trained."""

from collections.abc import Callable
from typing import Any

import numpy as np
from rabbit_description.state import Array
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.weights import PROBE, PolicyFile, PolicyMetadata, probe_outputs, problem_fields


def policy_metadata(problem: Problem, **changes: Any) -> PolicyMetadata:
    """Of a policy that nothing trained and that scales nothing, but for `changes`."""
    m, n = len(changes.get("observation", problem.observation)), len(problem.quantities)
    plain = {
        **problem_fields(problem),
        "observation": problem.observation,
        "observation_center": (0.0,) * m,
        "observation_scale": (1.0,) * m,
        "structured": problem.has_clf,
        "alpha_scale": (1.0,) * n,
        "beta_scale": (1.0,) * n,
        "learner": "test",
        "plant": {},
        "training_seed": 1,
        "episodes": 0,
        "transitions": 0,
        "commit": "",
        "command": "",
    }
    return PolicyMetadata.model_validate(plain | changes)


def policy_file(metadata: PolicyMetadata, fill: Callable[[tuple[int, ...]], Array]) -> PolicyFile:
    """With weights that `fill` makes of their shapes."""
    arrays = {name: fill(shape).astype(np.float32) for name, shape in metadata.shapes.items()}
    arrays[PROBE] = probe_outputs(arrays)
    return PolicyFile(metadata, arrays)

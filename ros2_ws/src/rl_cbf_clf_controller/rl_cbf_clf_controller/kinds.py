"""Controllers by name: those of `recipes.py`, and those that another package brings.

A package brings its own by an entry point in the group `rabbit.controllers`, which names a `Kind`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cbf_clf_qp.problem import Problem
from cbf_clf_qp.res_clf import ResClf
from cbf_clf_qp.tick import Estimator, Quantity
from pydantic import BeforeValidator, PlainSerializer
from rabbit_description import plugins

from rl_cbf_clf_controller.scene import Scene
from rl_cbf_clf_controller.terrain import FlatGround, SteppingStones

GROUP = "rabbit.controllers"
NAMES = plugins.names(GROUP)
if TYPE_CHECKING:
    ControllerName = str
else:  # so that `--help` and `ros2 param describe` list them
    ControllerName = Literal[*NAMES]

Quantities = tuple[Quantity[Scene], ...]
Estimators = tuple[Estimator[Scene], ...]


@dataclass(frozen=True)
class Kind:
    """What tells one controller from another. The functions get the `ControllerParameters` and the CLF.

    `terrain`: what the controller knows of the ground ahead; `estimators`: its own, besides the policy and the
    adaptation that the parameters choose; `learns`: a policy belongs to it.
    """

    problem: Problem
    quantities: Callable[[Any, ResClf], Quantities]
    terrain: type[FlatGround | SteppingStones] = FlatGround
    estimators: Callable[[Any, ResClf], Estimators] = lambda parameters, clf: ()
    learns: bool = False


@cache
def find_kind(name: str) -> Kind:
    """The controller of this name; raises `LookupError`."""
    kind: Kind = plugins.load(GROUP, name)
    return kind


def find_problem(problem: Any) -> Any:
    """The learning problem of this name; another object as it is. Raises `ValueError`."""
    if not isinstance(problem, str):
        return problem
    known = {kind.problem.name: kind.problem for kind in map(find_kind, NAMES)}
    if problem not in known:
        raise ValueError(f"expected {' or '.join(map(repr, known))}")
    return known[problem]


NamedProblem = Annotated[Problem, BeforeValidator(find_problem), PlainSerializer(str, return_type=str)]

"""Controllers by name: those of `recipes.py`, and those that another package brings.

A package brings a controller by an entry point in the group `rabbit.controllers`, which names a `Kind`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, PlainSerializer
from rabbit_description import plugins
from rabbit_description.validation import one_of

from rl_cbf_clf_controller.problem import Problem

if TYPE_CHECKING:  # a help text lists controllers, and computes nothing
    from cbf_clf_qp.affine import Affine
    from cbf_clf_qp.functions import NumpyFunction
    from cbf_clf_qp.quantity import Constrained, Terms

    from rl_cbf_clf_controller.walking import Walking

GROUP = "rabbit.controllers"
NAMES = plugins.names(GROUP)
if TYPE_CHECKING:
    ControllerName = str
else:  # so that `--help` and `ros2 param describe` list them
    ControllerName = Literal[*NAMES]


@dataclass(frozen=True)
class Kind:
    """What distinguishes one controller from another. The functions get the `ControllerParameters`.

    `quantities`: of RABBIT's symbols; `corners`: further errors at which every row holds; `terrain`: what it
    walks on; `compensation`: an adaptive law, see `l1_adaptation.py`; `learns`: a policy belongs to it.
    """

    problem: Problem
    quantities: "Callable[[Walking, Any], Sequence[Constrained]]"
    terrain: Literal["flat", "stones"] = "flat"
    compensation: "Callable[[Any], NumpyFunction] | None" = None
    corners: "Callable[[Walking, Any], Callable[[Terms], list[Affine]]] | None" = None
    learns: bool = False


@cache
def find_kind(name: str) -> Kind:
    """The controller of this name; raises `PluginError`."""
    return plugins.load(GROUP, name)


def find_problem(problem: Any) -> Any:
    """The learning problem of this name; another object as it is. Raises `ValueError`."""
    if not isinstance(problem, str):
        return problem
    known = {kind.problem.name: kind.problem for kind in map(find_kind, NAMES)}
    if problem not in known:
        raise ValueError(f"expected {one_of(problem, known)}")
    return known[problem]


NamedProblem = Annotated[Problem, BeforeValidator(find_problem), PlainSerializer(str, return_type=str)]

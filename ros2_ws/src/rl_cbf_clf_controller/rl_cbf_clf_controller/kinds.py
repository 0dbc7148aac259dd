"""Controllers by name: those of `recipes.KINDS`, and those that another package brings.

A package brings its own by an entry point in the group `rabbit.controllers`, which names a table like `recipes.KINDS`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any

from cbf_clf_qp.affine import Affine
from cbf_clf_qp.problem import Problem
from cbf_clf_qp.res_clf import ResClf
from cbf_clf_qp.tick import Quantity, Terms, no_corners
from pydantic import BeforeValidator, PlainSerializer
from pydantic_core import PydanticCustomError
from rabbit_description import plugins

from rl_cbf_clf_controller.scene import Scene

GROUP = "rabbit.controllers"

Quantities = tuple[Quantity[Scene], ...]


@dataclass(frozen=True)
class Kind:
    """What tells one controller from another: what is learned, the quantities, and how their estimates are used.

    `quantities` and `corners` get the `ControllerParameters`. `sees_stones`: it has barriers on the stone in sight;
    `learns`: a policy belongs to it.
    """

    problem: Problem
    quantities: Callable[[Any, ResClf], Quantities]
    sees_stones: bool = False
    learns: bool = False
    corners: Callable[[Any], Callable[[Terms[Scene]], Sequence[Affine]]] = lambda _: no_corners


@cache
def kinds() -> Mapping[str, Kind]:
    """All controllers."""
    found: dict[str, Kind] = {}
    for table in plugins.names(GROUP):
        found |= plugins.load(GROUP, table)
    return found


def find_kind(name: str) -> Kind:
    """The controller of this name."""
    return kinds()[known_name(name)]


def known_name(name: str) -> str:
    """A controller's name; raises `ValueError`."""
    return _one_of(name, kinds())


def find_problem(problem: Any) -> Any:
    """The learning problem of this name; another object as it is. Raises `ValueError`."""
    if not isinstance(problem, str):
        return problem
    found = {kind.problem.name: kind.problem for kind in kinds().values()}
    return found[_one_of(problem, found)]


def _one_of(name: str, known: Mapping[str, Any]) -> str:
    if name not in known:
        raise PydanticCustomError(
            "literal_error", "Input should be {expected}", {"expected": " or ".join(map(repr, known))}
        )
    return name


NamedProblem = Annotated[Problem, BeforeValidator(find_problem), PlainSerializer(str, return_type=str)]

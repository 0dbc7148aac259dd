"""What one controller is made of, however many robots it walks: the QP, the functions of a tick."""

from collections.abc import Callable, Sequence
from typing import Any

from cbf_clf_qp.answer import OsqpSolver, Solver, guarded
from cbf_clf_qp.estimates import Estimates, model_error
from cbf_clf_qp.functions import one_at_a_time
from cbf_clf_qp.quantity import Constrained
from cbf_clf_qp.tick import Tick
from rabbit_description.gait import Gaits
from rabbit_description.state import Array

from rl_cbf_clf_controller.kinds import find_kind
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.rabbit_step import RabbitStep
from rl_cbf_clf_controller.recipes import barriers_of, make_tick
from rl_cbf_clf_controller.robot_numbers import read_robot
from rl_cbf_clf_controller.scene import ControllerError
from rl_cbf_clf_controller.step import StepFunctions
from rl_cbf_clf_controller.step_paths import Shape
from rl_cbf_clf_controller.uncertainty import STATE_OBSERVATION
from rl_cbf_clf_controller.walking import Walking

SEEN = ("eta", "barriers", "barrier_rates", "LgV", "nominal_a", "nominal_b", "mu_held", "measured")

Further = Callable[[Walking], Sequence[Constrained]]  # quantities of RABBIT's symbols


def nothing_further(walking: Walking) -> Sequence[Constrained]:
    """No more than the quantities of the recipe."""
    return ()


class ControllerParts:
    """The parts of a controller of any robot.

    Args:
        tick: the controller's QP.
        functions: its tick as one function.
        barrier_names: of all that `seen` has barriers of.
        observed: how many observations there are.
        parameters: with `objective`, `adaptation`, `qp_solver`, `sigma`, and `functions.settings` by their names.
    """

    def __init__(
        self, tick: Tick, functions: StepFunctions, barrier_names: Sequence[str], observed: int, parameters: Any
    ) -> None:
        self.qp, self.functions, self.barrier_names = tick, functions, tuple(barrier_names)
        self.observed, self._parameters = observed, parameters
        self.model_error = model_error(tick.terms)
        self.places = {name: place for name, (place, _) in functions.report.places.items()}
        self.output_places = at = OutputPlaces(self)
        self.learned_from = at.arrays["observation"], at.arrays["LgV"]  # of a report
        self.acted_at = self.places["mu"], self.places["mu_qp"], self.places["saturated"].start
        self.is_valid = functions.answer.places["is_valid"][0].start
        self.solvers = guarded(parameters.qp_solver)

    @property
    def parameters(self) -> Any:
        """The parameters, of which only some change, by their setter."""
        return self._parameters

    def first_memory(self) -> Array:
        """The memory with which an episode begins."""
        return self.functions.first(self._parameters)

    def make_solver(self, name: str) -> Solver:
        """One of the QP outside the step's function: `osqp`."""
        return OsqpSolver(self.qp.layout)

    def check_estimates(self, total: Estimates) -> None:
        """Raises `ControllerError` where the objective needs an output error, and none is known."""
        if total.output_error is None and self.qp.needs_output_error:
            objective = self.parameters.objective
            raise ControllerError(f"objective {objective}: expected a structured policy, which gives the output error")


@one_at_a_time
def rabbit_parts(
    parameters: ControllerParameters, gait: Gaits, further: Further, urdf: str | None
) -> tuple[Tick, StepFunctions, Sequence[str], int]:
    """RABBIT's parts: the QP, its functions, the names of its barriers, how many observations there are."""
    kind, walking, robot = find_kind(parameters.controller), Walking(), read_robot(urdf)
    added = further(walking)
    tick = make_tick(walking, parameters, added)
    names = barriers_of([*kind.quantities(walking, parameters), *added])
    on_stones = parameters.terrain == "stones"
    observed = len(STATE_OBSERVATION) + (1 + (not Shape.of(gait).is_single) if on_stones else 0)
    return tick, RabbitStep(walking, tick, parameters, robot, gait), tuple(names), observed


class OutputPlaces:
    """Where in a report a `ControllerOutput` finds its arrays and numbers."""

    def __init__(self, one: "ControllerParts") -> None:
        f, at, self.shape = one.functions, one.places, one.qp.no_error().alpha.shape  # of alpha
        seen = {name: shifted(place, at["seen"]) for name, (place, _) in f.seen.places.items()}
        answer = {name: shifted(place, at["answer"]) for name, (place, _) in f.answer.places.items()}
        self.arrays = {name: seen[name] for name in SEEN}
        start = seen["observation"].start
        self.arrays |= {"observation": slice(start, start + one.observed), "margins": answer["row_margin"]}
        self.arrays |= {"slacks": answer["slack"], "multipliers": answer["multiplier"]}
        self.arrays |= {name: at[name] for name in ("identified", "adapted") if f.identifies}
        self.alpha, self.beta, _ = (place for place, _ in f.estimates.places.values())
        self.margin = answer["margin"]
        numbers = at["tick"], at["index"], at["stance"], at["step_time"], seen["phase"], seen["V"], at["solved"]
        sums = answer["slack_sums"].start
        self.scalars = [*(place.start for place in numbers), sums, sums + 1]


def shifted(place: slice, within: slice) -> slice:
    """The place of what lies there in a part of a row."""
    return slice(place.start + within.start, place.stop + within.start)

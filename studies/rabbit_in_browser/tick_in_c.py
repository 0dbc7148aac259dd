"""A controller's tick, the actor included, as one CasADi function that is written out as C.

    seen        of (x, p, path, torque, before)   what is seen of a state: `look` of `tick_functions`
    estimates   of (seen, policy)                 the actor, in double precision; of a policy of zeros they are zero
    answered    of (seen, estimates)              the QP, by DAQP

All functions are those of `rl_cbf_clf_controller` and of the core, put one after another. State, robot, gains, path and
policy are inputs, so that controllers with the same rows and objective share a function.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import accumulate

import casadi as ca
from cbf_clf_qp.answer import by_daqp
from cbf_clf_qp.functions import NumpyFunction, Place, one_at_a_time, places_of
from cbf_clf_qp.qp import Layout
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import estimate_function
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.recipes import make_tick
from rl_cbf_clf_controller.tick_functions import tick_functions
from rl_cbf_clf_controller.walking import Walking

HIDDEN = 400, 300  # sizes of the actor's layers
SEEN = ("leaves", "V", "barriers", "measured", "nominal_a", "nominal_b")
ANSWERED = ("residual", "u", "mu", "slack", "control_b")
ESTIMATED = ("alpha", "beta", "output_error")


@dataclass(frozen=True)
class TickInC:
    """`function` has the `inputs`, and one row of values, in which `places` says what lies where.

    `layout`: of the QP; `parameters`: where each parameter of the system lies in the input `p`.
    """

    function: ca.Function
    places: Mapping[str, Place]
    parameters: Mapping[str, Place]
    layout: Layout


def policy_shapes(problem: Problem) -> dict[str, tuple[int, int]]:
    """Of the parts of the input `policy`, by name and in order; each lies there column by column.

    The actor reads all that a policy reads beside one gait: one that reads less has zeros in the other columns.
    """
    read, n, m = len(problem.observation), len(problem.quantities), problem.inputs
    sizes = (read, *HIDDEN, m * (m + 1) + (m + 1) * (n - 1))
    shapes = {"center": (read, 1), "inverse_scale": (read, 1)}
    for i in range(3):
        shapes |= {f"{i}.weight": (sizes[i + 1], sizes[i]), f"{i}.bias": (sizes[i + 1], 1)}
    return shapes | {"alpha_scale": (n, 1), "beta_scale": (n, 1)}


@one_at_a_time
def tick_in_c(name: str, parameters: ControllerParameters) -> TickInC:
    """The tick of the controllers that have the rows and the objective of these parameters."""
    walking, problem = Walking(), parameters.problem
    tick = make_tick(walking, parameters)
    look, answer, _ = tick_functions(walking, tick)
    symbols = look.function.mx_in()
    numbers, policy = policy_symbols(problem)
    seen = split(look, look.function(*symbols))
    observation = seen["observation"][: len(problem.observation)]
    outputs = actor(policy, (observation - policy["center"]) * policy["inverse_scale"])
    estimates = estimated(problem, policy, outputs, seen["LgV"])
    data = answer.programme.function(seen["prepared"], *estimates.values())
    x, y = by_daqp(data, answer.programme.places)
    answered = split(answer.reading, answer.reading.function(data, x, y))
    shown = {key: seen[key] for key in SEEN} | {key: answered[key] for key in ANSWERED}
    shown |= {key: estimates[key] for key in ("alpha", "beta")}
    inputs = {**dict(zip(look.function.name_in(), symbols, strict=True)), "policy": numbers}
    function = ca.Function(name, [*inputs.values()], [ca.vertcat(*shown.values())], [*inputs], ["values"])
    return TickInC(function, places_in_row(shown), places_of(walking.system.named), tick.layout)


def places_in_row(values: Mapping[str, ca.MX]) -> dict[str, Place]:
    """Where these columns lie, one after another."""
    places, start = dict[str, Place](), 0
    for name, value in values.items():
        places[name] = slice(start, start + value.numel()), value.shape[:1]
        start += value.numel()
    return places


def split(function: NumpyFunction, row: ca.MX) -> dict[str, ca.MX]:
    """The values in its row, by name; a matrix as a column, row by row."""
    return {name: row[place] for name, (place, _) in function.places.items()}


def policy_symbols(problem: Problem) -> tuple[ca.MX, dict[str, ca.MX]]:
    """The input `policy`, and its parts by name."""
    shapes = policy_shapes(problem)
    ends = list(accumulate((rows * columns for rows, columns in shapes.values()), initial=0))
    numbers = ca.MX.sym("policy", ends[-1])
    parts = zip(ca.vertsplit(numbers, ends), shapes.items(), strict=True)
    return numbers, {name: ca.reshape(part, *shape) for part, (name, shape) in parts}


def actor_in_c(problem: Problem) -> ca.Function:
    """The actor alone, of (scaled, policy): for the outputs that a policy file says it has."""
    numbers, policy = policy_symbols(problem)
    scaled = ca.MX.sym("scaled", len(problem.observation))
    return ca.Function("actor", [scaled, numbers], [actor(policy, scaled)], ["scaled", "policy"], ["outputs"])


def actor(policy: Mapping[str, ca.MX], scaled: ca.MX) -> ca.MX:
    """The network's outputs, see `weights.Actor`."""
    values = scaled
    for layer in range(3):
        values = policy[f"{layer}.weight"] @ (ca.fmax(values, 0) if layer else values) + policy[f"{layer}.bias"]
    return ca.tanh(values)


def estimated(problem: Problem, policy: Mapping[str, ca.MX], outputs: ca.MX, LgV: ca.MX) -> dict[str, ca.MX]:
    """`ESTIMATED` of a structured policy, see `estimate_function`, whose scales are the policy's."""
    n, m = len(problem.quantities), problem.inputs
    unscaled = estimate_function((1.0,) * n, (1.0,) * n, True, True, m)
    found = split(unscaled, unscaled.function(outputs, LgV))
    alpha, beta = policy["alpha_scale"], policy["beta_scale"]
    of_V = ca.repmat(ca.vertcat(ca.repmat(alpha[0], m, 1), beta[0]), m, 1)
    scales = ca.vec(ca.repmat(alpha.T, m, 1)), beta, of_V
    return {name: found[name] * scale for name, scale in zip(ESTIMATED, scales, strict=True)}

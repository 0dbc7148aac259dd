"""All of a controller's tick that others read: recorders, the trainer, the page, you."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from cbf_clf_qp.estimates import Estimates
from rabbit_description.state import Array, Leg

from rl_cbf_clf_controller.scene import Scene

NOTHING = np.zeros(0)


@dataclass
class Acted:
    """What acts in a tick, as in `ControllerOutput`."""

    torque: Array
    mu: Array
    mu_qp: Array
    omega: Array
    saturated: bool
    policy_version: str
    fault: str


@dataclass  # not frozen: that would take a tick 5 us
class ControllerOutput:
    """All of one tick that a person debugging, a recorder or the trainer wants.

    `torque` (4,) N m, left/right order, saturated; `eta` (8,); `barriers`, `barrier_rates` (b,) of
    `barrier_names`, B1 and B2 on stones, and your own;
    `mu` (4,) as executed after exploration and saturation, `mu_qp` the QP's, `omega` the noise; `mu_held` (4,) what the
    last tick's torque amounts to at this state, that is y-ddot by the nominal model, NaN where the step is new; nominal
    value of the quantities = `nominal_a` mu + `nominal_b`, (n, 4) and (n,); `measured` (n,) theirs over the last tick,
    NaN where the step is new; `alpha`, `beta` the estimates in all;
    `observation` (14,), on stones (15,), there with a gait library (16,); `LgV` (4,); `clf_slack`, `rescue_slack`: the
    paper's d, the sum of the slacks of last resort; `rows` names the QP's rows, each with what it leaves at the answer
    (`margins`), its slack, as `decided.slack`, and its multiplier; `active` names those that hold with equality;
    `answered` is False where the guard solver had to answer, or none could; `fault` is empty, or why the episode must
    end; `objective`, `adaptation` name what was minimised and adapted; `identified` (18,) is the robot as in
    `identified_robot.KNOWN`, `adapted` (5n + 20,) its part of the estimates, as in `from_flat`; both (0,) without
    adaptation.
    """

    tick: int
    torque: Array
    stance: Leg
    step_index: int
    step_time: float
    phase: float
    eta: Array
    V: float
    barriers: Array
    barrier_rates: Array
    barrier_names: tuple[str, ...]
    mu: Array
    mu_qp: Array
    omega: Array
    quantities: tuple[str, ...]
    alpha: Array
    beta: Array
    observation: Array
    LgV: Array
    clf_slack: float
    rescue_slack: float
    active: tuple[str, ...]
    saturated: bool
    solver: str
    status: str
    answered: bool
    solve_seconds: float
    policy_version: str
    rows: tuple[str, ...] = ()
    margins: Array = field(default_factory=lambda: NOTHING)
    slacks: Array = field(default_factory=lambda: NOTHING)
    multipliers: Array = field(default_factory=lambda: NOTHING)
    mu_held: Array = field(default_factory=lambda: NOTHING)
    nominal_a: Array = field(default_factory=lambda: NOTHING)
    nominal_b: Array = field(default_factory=lambda: NOTHING)
    measured: Array = field(default_factory=lambda: NOTHING)
    fault: str = ""
    objective: str = "paper"
    adaptation: str = "none"
    identified: Array = field(default_factory=lambda: NOTHING)
    adapted: Array = field(default_factory=lambda: NOTHING)


def seen_fields(scene: Scene) -> dict[str, Any]:
    """What an output has of its scene alone."""
    seen = scene.seen
    return {
        "tick": scene.tick,
        "stance": scene.stance,
        "step_index": scene.step_index,
        "step_time": scene.step_time,
        "phase": seen.phase.item(),
        "eta": seen.eta,
        "V": seen.V.item(),
        "barriers": seen.barriers,
        "barrier_rates": seen.barrier_rates,
        "observation": scene.observation,
        "LgV": seen.LgV,
        "nominal_a": seen.nominal_a,
        "nominal_b": seen.nominal_b,
        "mu_held": seen.mu_held,
        "measured": seen.measured,
    }


def from_flat(values: Array, n: int, m: int) -> Estimates:
    """The estimates of n quantities over m inputs; raises ValueError for a wrong number of values.

    In the paper's order (alpha_V, alpha_B1, ..., beta_V, beta_B1, ...), then the output error where it is known.
    """
    sizes = n * (m + 1), (n + m) * (m + 1)
    if values.shape not in ((sizes[0],), (sizes[1],)):
        raise ValueError(f"estimates: {values.shape} values; expected {sizes[0]}, or {sizes[1]} with an output error")
    alpha, beta, error = np.split(values, [n * m, sizes[0]])
    return Estimates(alpha.reshape(n, m), beta, error.reshape(m, m + 1) if error.size else None)

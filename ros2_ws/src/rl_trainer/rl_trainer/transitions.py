"""From two ticks of a walk to a transition: what the learner may know, and nothing of the true dynamics.

A quantity is measured by one numerical difference over the tick [SectionRL, Remark 3]:

    V-dot = (V' - V) / dt,   B_i'' = (B_i-dot' - B_i-dot) / dt,   y'' = (dy' - dy) / dt,   ' = one tick later

and the stance foot's force is the one averaged over that tick; each quantity's `measure` says so, and the controller
publishes it. A difference across a change of stance means nothing.
V is quadratic in eta, so the difference of V is off by dt |eta-dot|^2 in the metric P. So the known gradient of V takes
the difference of dy instead: V-dot = LfV + LgV (dy' - dy) / dt.

A difference is a mean over the tick, in which the torque is held and the state moves on; so the nominal value that it
is compared to is the mean of those at the tick's ends, both under the torque that was applied. With `measurement =
paper` the difference of V is compared with the nominal value of the tick's start.
"""

from dataclasses import dataclass
from enum import IntFlag, auto

import numpy as np
from cbf_clf_qp.estimates import Estimates
from rabbit_description.state import Array, RobotState
from rl_cbf_clf_controller.controller_output import ControllerOutput, from_flat
from rl_cbf_clf_controller.problem import Problem

from rl_trainer.parameters import TrainingParameters

CONTACT_FORCE = 1.0  # N; a foot that carries less is in the air
SETTLED = 0.04  # s after an impact, but for half a tick
FAR_POSITION, FAR_VELOCITY = 0.6, 12.0  # rad, rad/s; y and dy beyond these are far off the gait


class Doubt(IntFlag):
    """Why a transition may be left out of learning."""

    NONE = 0
    UNMEASURED = auto()  # no next output, another stance leg, or another torque than this tick's was applied
    SETTLING = auto()  # after an impact; with an adaptation an episode's first step, in which the robot is found
    FLIGHT = auto()  # the stance foot carries nothing
    SCUFF = auto()  # the swing foot touches the ground
    SATURATED = auto()  # the torque limit changed mu
    FAR = auto()  # far off the gait
    EDGE = auto()  # the phase passed 0 or 1, beyond which the curvature of the desired outputs fades


@dataclass(frozen=True)
class Transition:
    """One tick, with m observations, n quantities and p inputs.

    `observation`, `next_observation` (m,), raw; `LgV`, `next_LgV` (p,); `mu`, `next_mu` (p,), executed, rad/s^2;
    `mu_qp` (p,), the QP's, before exploration and torque limit;
    `alpha` (n, p), `beta` (n,), used at this tick; `nominal`, `measured` (n,), in the quantities' units, NaN where not
    measured. `failed`: the next pose is a failure, and the episode's end.
    """

    problem: Problem
    tick: int
    step_index: int
    observation: Array
    LgV: Array
    mu: Array
    mu_qp: Array
    alpha: Array
    beta: Array
    nominal: Array
    measured: Array
    next_observation: Array
    next_LgV: Array
    next_mu: Array
    failed: bool
    doubt: Doubt

    @property
    def correction(self) -> Array:
        """alpha mu + beta at this tick, (n,)."""
        return self.alpha @ self.mu + self.beta

    @property
    def target(self) -> Array:
        """What the correction (n,) should have been, the model's error at the executed mu.

        In the first approach the correction is part of the input v = mu + correction, which the nominal model takes for
        y''; the target is v - y''.
        """
        if self.problem.corrects_input:
            return self.nominal - self.measured
        return self.measured - self.nominal

    @property
    def error(self) -> Array:
        """What the reward squares: estimate minus measurement [eq:loss_functions]; y'' - mu in the first approach."""
        return self.correction - self.target


class TransitionBuilder:
    """Puts transitions together from the ticks of a walk, in order; a tick that never came has none."""

    def __init__(self, parameters: TrainingParameters) -> None:
        self._parameters = parameters
        self.reset()

    def reset(self) -> None:
        """Begin an episode."""
        self._last: ControllerOutput | None = None

    def add(self, state: RobotState, output: ControllerOutput | None = None) -> Transition | None:
        """The transition that ends at this tick; None at the episode's first and after a gap.

        Without an output it is the episode's last one; nothing is measured but the failure.
        """
        p, (last, self._last) = self._parameters, (self._last, output)
        if output is not None and output.quantities != p.problem.quantities:
            raise ValueError(f"quantities = {output.quantities}; expected {p.problem.quantities}")
        if last is None or state.tick != last.tick + 1:
            return None
        following, doubt = output or last, self._doubt(last, state, output)
        usable = None if doubt & Doubt.UNMEASURED else output
        measured = usable.measured.copy() if usable else np.full(p.n, np.nan)
        if usable and p.measurement == "paper" and p.problem.has_clf:
            measured[0] = (usable.V - last.V) / p.tick_seconds
        return Transition(
            problem=p.problem,
            tick=last.tick,
            step_index=last.step_index,
            observation=last.observation,
            LgV=last.LgV,
            mu=last.mu,
            mu_qp=last.mu_qp,
            alpha=last.alpha - adapted(last).alpha,
            beta=last.beta - adapted(last).beta,
            nominal=nominal_value(last, usable, p),
            measured=measured,
            next_observation=following.observation,
            next_LgV=following.LgV,
            next_mu=following.mu,
            failed=output is None and has_fallen(state, p),
            doubt=doubt,
        )

    def _doubt(self, last: ControllerOutput, state: RobotState, output: ControllerOutput | None) -> Doubt:
        acted_otherwise = np.isfinite(state.applied).all() and (state.applied != last.torque).any()  # it came late
        unmeasured = output is None or output.step_index != last.step_index or np.isnan(output.measured).all()
        reasons = {
            Doubt.UNMEASURED: unmeasured or acted_otherwise,
            Doubt.SATURATED: last.saturated,
            Doubt.EDGE: output is not None and any((last.phase < edge) != (output.phase < edge) for edge in (0, 1)),
        }
        if state.foot_force.size:  # a control task of one's own has neither feet nor a gait
            y, dy = np.abs(last.eta.reshape(2, -1)).max(axis=1)
            normal_force, settled = state.foot_force[:, 1], SETTLED - self._parameters.tick_seconds / 2
            reasons |= {
                Doubt.SETTLING: last.step_time < settled if last.step_index else last.adapted.size > 0,
                Doubt.FLIGHT: normal_force[last.stance] < CONTACT_FORCE,
                Doubt.SCUFF: normal_force[last.stance.other] >= CONTACT_FORCE,
                Doubt.FAR: y > FAR_POSITION or dy > FAR_VELOCITY,
            }
        return Doubt(sum(flag for flag, holds in reasons.items() if holds))


def has_fallen(state: RobotState, p: TrainingParameters) -> bool:
    """Whether its pose is a fall; a state without feet is a control task's, which has none."""
    return bool(state.foot_force.size) and bool(state.q[1] < p.fall_height or abs(state.q[2]) > p.fall_pitch)


def nominal_value(last: ControllerOutput, output: ControllerOutput | None, p: TrainingParameters) -> Array:
    """The quantities without the policy's estimate over the same tick, (n,); at its start where there is no `output`.

    That is by the nominal model, or with an adaptation by the robot that it knows.
    """
    first_approach = p.problem.corrects_input
    v: Array = last.mu + last.alpha @ last.mu + last.beta if first_approach else last.mu
    start = predicted(last, v)
    if output is None or p.measurement == "paper" or not np.isfinite(output.mu_held).all():
        return start
    mean: Array = (start + predicted(output, output.mu_held)) / 2
    if "V" in last.quantities:
        ends = _y_ddot(last, v) + _y_ddot(output, output.mu_held)
        mean[0] = last.nominal_b[0] + last.LgV @ ends / 2
    return mean


def predicted(output: ControllerOutput, v: Array) -> Array:
    """The quantities (n,) of a tick at the input v (4,), without the policy's estimate."""
    return output.nominal_a @ v + output.nominal_b + adapted(output).error(v)


def _y_ddot(output: ControllerOutput, v: Array) -> Array:
    """y'' (4,) at the input v (4,), without the policy's estimate."""
    error = adapted(output).output_error
    return v if error is None else v + error[:, :-1] @ v + error[:, -1]


def adapted(output: ControllerOutput) -> Estimates:
    """What an adaptation added to a tick's quantities (n,) and to its y'' (4,)."""
    n, m = output.nominal_a.shape
    return from_flat(output.adapted, n, m) if output.adapted.size else Estimates.zero(n, m)

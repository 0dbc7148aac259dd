"""What is seen at a touchdown of the step that ended and of the stone ahead; nothing of the true plant.

The observer of a walk collects a row for each step except the first, which no other step precedes. A step misses if it
does not end on its stone. Then the foot landed beside the stone, or the robot fell, flew, slipped or stalled.
"""

from collections.abc import Sequence

import numpy as np
from rabbit_description.state import SWAP_STATE, TICK_SECONDS, Array, Leg
from rl_cbf_clf_controller.robot_numbers import Feet, read_robot
from rl_cbf_clf_controller.virtual_constraints import RABBIT_ANGLES
from rl_trainer.rollout import Record

FEATURES = (
    *("phase_angle_rate", "step_length", "speed", "pitch", "pitch_rate", "foot_height"),
    *("l_min", "stone_width", "stone_height", "step_index"),
    *("largest_torque", "mean_torque", "largest_output", "clf_slack", "rescue_slack"),
    *("least_normal_force", "largest_force_ratio"),
)
LANDING_TICKS = 2  # of a step, in which the force is the impact's
LEAST_FORCE = 10.0  # N, below which a ratio says nothing
LARGEST_RATIO = 3.0


class Touchdowns:
    """Observes one walk; `rows` has the features (n, 17) of its touchdowns, in order."""

    def __init__(self) -> None:
        self.rows: list[Array] = []
        self._step: list[Record] = []
        self._feet = Feet(read_robot())

    def __call__(self, record: Record) -> None:
        """A tick."""
        if self._step and record.output.step_index != self._step[-1].output.step_index:
            self.rows.append(features(self._step, record, self._feet))
            self._step = []
        self._step.append(record)


def features(step: Sequence[Record], now: Record, feet: Feet) -> Array:
    """`FEATURES` (17,) at the touchdown `now` after the ticks of `step`; slacks and the normal force as log(1 + x)."""
    state, stone = now.state, now.state.preview
    if stone is None:
        raise ValueError(f"tick {state.tick}: no stone is previewed: expected a walk on stones")
    q, dq = state.q, state.dq
    if now.output.stance is Leg.RIGHT:
        q, dq = q[SWAP_STATE], dq[SWAP_STATE]
    length, height = -feet(q).swing
    seconds = (state.tick - step[0].state.tick) * TICK_SECONDS
    forces = np.array([tick.state.foot_force[tick.output.stance] for tick in step[LANDING_TICKS:] or step])
    ratios = np.abs(forces[:, 0]) / np.maximum(forces[:, 1], LEAST_FORCE)
    torques = np.array([np.abs(tick.output.torque).max() for tick in step])
    outputs = np.array([np.abs(tick.output.eta[:4]).max() for tick in step])
    slacks = np.array([(tick.output.clf_slack, tick.output.rescue_slack) for tick in step]).max(axis=0)
    return np.array(
        [
            *(RABBIT_ANGLES.phase_angle @ dq, length, length / seconds, q[2], dq[2], height),
            *(stone.l_min, stone.l_max - stone.l_min, stone.height, now.output.step_index),
            *(torques.max(), torques.mean(), outputs.max(), *np.log1p(np.maximum(slacks, 0.0))),
            *(np.log1p(max(forces[:, 1].min(), 0.0)), min(ratios.max(), LARGEST_RATIO)),
        ]
    )

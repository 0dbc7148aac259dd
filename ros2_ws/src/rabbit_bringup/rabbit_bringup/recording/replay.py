"""Recorded states into a controller of one's own, under the recorded policies: the same torques must come out."""

import math
from collections.abc import Iterator

import numpy as np
from rabbit_description.gait import load_gait
from rabbit_description.state import Array
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ActorPolicy, Policy, ZeroPolicy
from rl_cbf_clf_controller.weights import decode

from rabbit_bringup.recording.reader import RecordedEpisode


def replay(episode: RecordedEpisode, law: ControllerParameters) -> Iterator[Array]:
    """Torques (4,), N m, for each recorded tick of an episode."""
    swaps = {swap.tick: swap for swap in episode.swaps}
    if math.isfinite(episode.sigma):
        law = law.model_copy(update={"sigma": episode.sigma})
    controller = Controller(law, load_gait(law.gait), ZeroPolicy(law.problem))
    controller.reset(episode.seed)
    for record in episode.records:
        if (swap := swaps.get(record.state.tick)) is not None:
            policy: Policy = ActorPolicy(decode(swap.data, law.problem)) if swap.data else ZeroPolicy(law.problem)
            controller.policy = policy
        yield controller.step(record.state).torque


def differing_ticks(episode: RecordedEpisode, law: ControllerParameters) -> list[int]:
    """Ticks whose torques do not come out again, bit for bit."""
    again = zip(episode.records, replay(episode, law), strict=True)
    return [record.state.tick for record, torque in again if not np.array_equal(record.output.torque, torque)]

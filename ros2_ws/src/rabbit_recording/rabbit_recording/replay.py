"""Recorded states into a controller of one's own, under the recorded policies: the same torques must come out."""

import math
from collections.abc import Iterator

import numpy as np
from rabbit_description.gait_library import load_gaits
from rabbit_description.state import Array
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.policy_compatibility import fitted
from rl_cbf_clf_controller.weights import PolicyFile, decode

from rabbit_recording.active_settings import RecordedSettings
from rabbit_recording.reader import RecordedEpisode, RecordedSwap


def replay(episode: RecordedEpisode, law: ControllerParameters | None = None) -> Iterator[Array]:
    """Torques (4,), N m, for each recorded tick of an episode, by the recorded settings or by `law` in their place.

    Raises:
        ValueError: nothing says what the controller went by at tick 0; a policy is not in the recording, or not for it.
    """
    if law is not None:
        settings = [RecordedSettings(0, law, load_gaits(law.gait))]
    elif not episode.settings or episode.settings[0].tick > 0:
        raise ValueError("the controller's parameters are not in it: name its ROS parameter file")
    else:
        settings = episode.settings
    laws = {each.tick: with_noise(each.parameters, episode.sigma) for each in settings}
    swaps = {swap.tick: swap for swap in episode.swaps}
    gait, zero = settings[0].gait, ZeroPolicy(laws[0].problem)
    controller = Controller(laws[0], gait, zero)
    controller.reset(episode.seed)
    for record in episode.records:
        controller.parameters = laws.get(record.state.tick, controller.parameters)
        if (swap := swaps.get(record.state.tick)) is not None:
            controller.policy = fitted(_policy_file(swap), laws[0], gait) if swap.data != b"" else zero
        yield controller.step(record.state).torque


def _policy_file(swap: RecordedSwap) -> PolicyFile:
    if swap.data is None:
        raise ValueError(f"policy {swap.version} is not in it")
    return decode(swap.data)


def with_noise(law: ControllerParameters, sigma: float) -> ControllerParameters:
    """The episode's own exploration, where it has one, goes before the controller's."""
    return law.model_copy(update={"sigma": sigma}) if math.isfinite(sigma) else law


def differing_ticks(episode: RecordedEpisode, law: ControllerParameters | None = None) -> list[int]:
    """Ticks whose torques do not come out again, bit for bit."""
    again = zip(episode.records, replay(episode, law), strict=True)
    return [record.state.tick for record, torque in again if not np.array_equal(record.output.torque, torque)]

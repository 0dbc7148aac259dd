"""Is a recording whole, and does it replay? Ticks that are not in it, and torques that do not come out again."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rabbit_description.state import JOINTS
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.controller_output import ControllerOutput
from rl_cbf_clf_controller.fitted_policy import fitted
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.weights import decode

from rabbit_recording.open_recording import one_line_errors
from rabbit_recording.reader import RecordedEpisode, iterate_episodes


@dataclass(frozen=True)
class Checked:
    """An episode, what of it is in the recording, and how many of its ticks were `replayed`.

    None are where it begins later, or its controller is of another kind, which announces no settings.

    `differing` are the ticks whose torques did not come out, `furthest` (N m) the most that one was off.
    """

    episode: RecordedEpisode
    replayed: int
    differing: list[int]
    furthest: float


def check_episodes(path: Path) -> Iterator[Checked]:
    """Check one episode after another; raises `RecordingError`."""
    for episode in iterate_episodes(path):
        # up to the first gap: a controller remembers, and cannot be replayed from elsewhere
        is_ours = bool(episode.settings or any(record.output.quantities for record in episode.records))
        whole = [record for i, record in enumerate(episode.records) if is_ours and record.state.tick == i]
        with one_line_errors(path, f"episode {episode.number} cannot be replayed"):
            torques = [output.torque for _, output in replayed(replace(episode, records=whole))]
        again = np.array(torques).reshape(-1, JOINTS)
        off = np.abs(np.array([record.output.torque for record in whole]).reshape(-1, JOINTS) - again).max(axis=1)
        yield Checked(episode, len(whole), np.flatnonzero(off != 0).tolist(), float(off.max(initial=0.0)))


def replayed(episode: RecordedEpisode) -> Iterator[tuple[Controller, ControllerOutput]]:
    """The recorded states into a controller of one's own, under the recorded settings and policies.

    The recorded torques must come out.

    Returns:
        The controller after each recorded tick, and its output.

    Raises:
        ValueError: nothing says what the controller went by at tick 0; a policy is not in the recording, or not for it.
    """
    if not episode.records:
        return
    if not episode.settings or episode.settings[0].tick > 0:
        raise ValueError("the controller's parameters are not in it")
    noise = {"sigma": episode.sigma} if math.isfinite(episode.sigma) else {}  # the episode's own goes first
    all_parameters = {each.tick: each.parameters.model_copy(update=noise) for each in episode.settings}
    swaps = {swap.tick: swap for swap in episode.swaps}
    first, gait = all_parameters[0], episode.settings[0].gait
    zero = ZeroPolicy(first.problem)
    controller = Controller(first, gait, zero)
    controller.rehearse()  # as the node does
    controller.reset(episode.seed)
    for record in episode.records:
        controller.parameters = all_parameters.get(record.state.tick, controller.parameters)
        if (swap := swaps.get(record.state.tick)) is not None:
            if swap.data is None:
                raise ValueError(f"policy {swap.version} is not in it")
            controller.policy = fitted(decode(swap.data), first, gait) if swap.data else zero
        yield controller, controller.step(record.state)

"""Is a recording whole, and does it replay? Ticks that are not in it, and torques that do not come out again."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rabbit_description.task import ControlTask
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.controller_output import ControllerOutput
from rl_cbf_clf_controller.fitted_policy import fitted
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.task_controller import NOMINAL, TaskController
from rl_cbf_clf_controller.weights import decode

from rabbit_recording.open_recording import one_line_errors
from rabbit_recording.reader import RecordedEpisode, RecordedSwap, iterate_episodes


@dataclass(frozen=True)
class Checked:
    """An episode, what of it is in the recording, and how many of its ticks were `replayed`.

    None are where it begins later, or its controller is of another kind, which announces no settings.

    `differing` are the ticks whose torques did not come out, `furthest` (N m; a task's unit) the most that one was off.
    """

    episode: RecordedEpisode
    replayed: int
    differing: list[int]
    furthest: float


def check_episodes(path: Path, task: ControlTask | None = None) -> Iterator[Checked]:
    """Check one episode after another, of a `task` or of RABBIT; raises `RecordingError`."""
    for episode in iterate_episodes(path, task):
        records = episode.records
        if not task:  # up to the first gap: RABBIT's controller remembers, and cannot be replayed from elsewhere
            is_ours = bool(episode.settings or any(record.output.quantities for record in records))
            records = [record for i, record in enumerate(records) if is_ours and record.state.tick == i]
        with one_line_errors(path, f"episode {episode.number} cannot be replayed"):
            again = [output.torque for _, output in replayed(replace(episode, records=records), task)]
        both = zip(records, again, strict=True)
        off = np.array([np.abs(record.output.torque - torque).max() for record, torque in both])
        differing = [records[i].state.tick for i in np.flatnonzero(off != 0)]
        yield Checked(episode, len(records), differing, float(off.max(initial=0.0)))


def replayed(episode: RecordedEpisode, task: ControlTask | None = None) -> Iterator[tuple[Any, ControllerOutput]]:
    """The recorded states into a new controller, under the recorded settings and policies.

    The recorded torques must come out.

    Returns:
        The controller after a recorded tick, and its output.

    Raises:
        ValueError: nothing says what the controller went by at tick 0; a policy is not in the recording, or not for it.
    """
    if not episode.records:
        return
    controller, set_for = _task_controller(episode, task) if task else _controller(episode)
    controller.reset(episode.seed)
    swaps = {swap.tick: swap for swap in episode.swaps}
    for record in episode.records:
        set_for(record.state.tick, swaps.get(record.state.tick))
        yield controller, controller.step(record.state)


SetFor = Callable[[int, RecordedSwap | None], None]  # what a controller goes by at a tick, where that changes


def _controller(episode: RecordedEpisode) -> tuple[Controller, SetFor]:
    if not episode.settings or episode.settings[0].tick > 0:
        raise ValueError("the controller's parameters are not in it")
    noise = {"sigma": episode.sigma} if math.isfinite(episode.sigma) else {}  # the episode's goes first
    all_parameters = {s.tick: s.parameters.model_copy(update=noise) for s in episode.settings}
    first, gait = all_parameters[0], episode.settings[0].gait
    zero = ZeroPolicy(first.problem)
    controller = Controller(first, gait, zero)
    controller.rehearse()  # as the node does

    def set_for(tick: int, swap: RecordedSwap | None) -> None:
        controller.parameters = all_parameters.get(tick, controller.parameters)
        if swap is not None:
            data = policy_bytes(swap)
            controller.policy = fitted(decode(data), first, gait) if data else zero

    return controller, set_for


def _task_controller(episode: RecordedEpisode, task: ControlTask) -> tuple[TaskController, SetFor]:
    controller = TaskController(task)
    controller.sigma = float(np.nan_to_num(episode.sigma))

    def set_for(tick: int, swap: RecordedSwap | None) -> None:
        if swap is None:
            return
        if swap.version == "zero":
            controller.policy = NOMINAL
        elif swap.version in controller.names or ":" in swap.version:
            controller.policy = controller.controlling(swap.version)
        else:
            controller.policy = controller.fitted(decode(policy_bytes(swap)))

    return controller, set_for


def policy_bytes(swap: RecordedSwap) -> bytes:
    """The bytes of a policy's file, none for the zero policy; raises `ValueError` where they are not recorded."""
    if swap.data is None:
        raise ValueError(f"policy {swap.version} is not in it")
    return swap.data

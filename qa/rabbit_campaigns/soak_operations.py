"""Operations beside a soak: what an operator does to a walking graph, drawn from a seed, and what came of it.

FOLDER/operations.csv    a row an operation: when, what, the graph's answer, whether it was the expected one
"""

import random
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel
from rabbit_description.gait import load_gaits
from rabbit_experiments.tables import read_rows, write_rows
from rabbit_recording.reader import RecordedEpisode, iterate_episodes
from rl_cbf_clf_controller.fitted_policy import fitted
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.weights import PROBE, SHIPPED, PolicyFile, PolicyFileError, policy_path, probe_outputs, read

OPERATIONS = "operations.csv"
KINDS = (
    *("good policy", "published policy", "unfit policy", "good parameter", "refused parameter"),
    *("pause", "reset"),
)
LATCHED, LATCH_SECONDS = 20, 3.0  # swaps that the controller keeps for late readers: put there first, one so often
RESET = ("reset", "by service")  # how an episode ends that an operator ends


class Operation(BaseModel):
    """One operation: `seconds` since the soak began, where the walk stood, and the answer."""

    seconds: float
    episode: int
    tick: int
    kind: str
    what: str
    answer: str
    expected: bool


def draw_kinds(rng: random.Random) -> Iterator[str]:
    """Kind after kind, without end: all of them in each round, in another order."""
    while True:
        yield from rng.sample(KINDS, len(KINDS))


def unfit_policy(parameters: ControllerParameters) -> Path:
    """A shipped policy that this controller refuses."""
    for path in sorted(SHIPPED.glob("*.safetensors")):
        try:
            fitted(read(path), parameters, load_gaits(parameters.gait))
        except PolicyFileError:
            return path
    raise ValueError("every shipped policy fits")


def near_policy(path: Path, number: int) -> PolicyFile:
    """A policy that acts as the file's does but for the last bias of each output, another one for each number."""
    file = read(path)
    changes = {"2.bias": file.arrays["2.bias"] + np.float32(2e-4 * (number % 3))}
    return _changed(file, changes, training_seed=number)


def idle_policy(parameters: ControllerParameters) -> PolicyFile:
    """A policy for this controller whose estimates are zero: beside the identified robot it changes nothing."""
    file = read(policy_path(parameters.problem.name))
    changes = {name: np.zeros_like(file.arrays[name]) for name in ("2.weight", "2.bias")}
    return _changed(file, changes, adaptation=parameters.adaptation)


def _changed(file: PolicyFile, arrays: dict[str, Any], **metadata: Any) -> PolicyFile:
    arrays = {**file.arrays, **arrays}
    arrays[PROBE] = probe_outputs(arrays)
    return PolicyFile(file.metadata.model_copy(update=metadata), arrays)


class Operations:
    """Called at every glance at the walk; does the next operation when its time has come, and waits for the answer."""

    def __init__(self, operator: Any, folder: Path, every: float, seed: int) -> None:
        """`operator`: an `Operator`; `every`: s between two operations."""
        self._operator, self._every, self._path = operator, every, folder / OPERATIONS
        self._first = LATCHED  # policies yet to come before all else, so that what is latched does not grow later
        self._kinds = draw_kinds(random.Random(seed))
        self._done: list[Operation] = []
        self._next = min(every, LATCH_SECONDS)

    def __enter__(self) -> "Operations":
        return self

    def __exit__(self, *error: object) -> None:
        """No more operations."""
        self._operator.close()

    def __call__(self, seconds: float) -> None:
        """Look at the clock, s since the soak began."""
        self._operator.spin(0.0)
        if seconds < self._next:
            return
        self._next = seconds + (min(self._every, LATCH_SECONDS) if self._first else self._every)
        kind = "good policy" if self._first else next(self._kinds)
        self._first = max(0, self._first - 1)
        values: dict[str, Any] = {"seconds": round(seconds, 3), "kind": kind}
        values["episode"], values["tick"] = self._operator.newest
        what, answer, expected = self._operator.do(kind)
        answer = " ".join(answer.split())[:200]
        self._done.append(Operation(**values, what=what, answer=answer, expected=expected))
        write_rows(self._path, Operation, self._done)


def judge_operations(folder: Path) -> tuple[dict[str, Any], dict[str, bool]]:
    """How a soak walked and how its operations were answered; the bars of both.

    Raises:
        RecordingError: a recording cannot be read.
    """
    path = folder / OPERATIONS
    operations = read_rows(path, Operation) if path.exists() else []  # none where there was no operator
    asked, right = Counter(o.kind for o in operations), Counter(o.kind for o in operations if o.expected)
    walk = judge_walk(iterate_episodes(folder / "recording"), asked["reset"])
    bars = {
        "recording": walk["ticks_not_recorded"] == 0,
        "walks": not walk["walks"]["fell"],
        "operations": all(operation.expected for operation in operations),
    }
    counts = {kind: [asked[kind], right[kind]] for kind in sorted(asked)}
    return {**walk, "operations": counts}, bars


def judge_walk(episodes: Iterable[RecordedEpisode], resets: int) -> dict[str, Any]:
    """All episodes must have walked but the last, which the soak's end cut off, and `resets` that an operator ended."""
    swaps = lost = walked = reset = 0
    fell: list[list[Any]] = []
    newest: RecordedEpisode | None = None
    for episode in episodes:
        swaps += sum(swap.tick > 0 for swap in episode.swaps)
        newest, before = replace(episode, records=[]), newest
        if before is None:
            continue
        lost += before.lost
        is_reset = (before.outcome, before.reason) == RESET and reset < resets
        walked, reset = walked + (before.outcome == "walked"), reset + is_reset
        if before.outcome != "walked" and not is_reset:
            fell.append([before.number, before.seed, before.outcome, before.reason])
    walks = {"ended": walked + reset + len(fell), "walked": walked, "reset": reset, "fell": fell}
    return {"walks": walks, "policies_put_in_force": swaps, "ticks_not_recorded": lost}

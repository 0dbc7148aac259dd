"""Operations beside a soak: what an operator does to a walking graph, drawn from a seed, and what came of it.

FOLDER/operations.csv    a row an operation: when, what, the graph's answer, whether it was the expected one
FOLDER/second/           what a second recorder wrote, which is started and ended in the middle of episodes
"""

import csv
import random
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from rabbit_description.gait import load_gaits
from rabbit_recording.reader import RecordedEpisode, iterate_episodes
from rabbit_recording.stored_messages import recorded_turns
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy_compatibility import fitted
from rl_cbf_clf_controller.weights import PROBE, SHIPPED, PolicyFile, PolicyFileError, forward, probe_inputs, read

OPERATIONS = "operations.csv"
KINDS = (
    "good policy",
    "published policy",
    "unfit policy",
    "junk file",
    "junk message",
    "good parameter",
    "refused parameter",
    "pause",
    "reset",
    "recorder started",
)
LATCHED, LATCH_SECONDS = 20, 3.0  # swaps that the controller keeps for late readers: put there first, one so often
RECORDED = 2  # operations that a second recorder stays for
SECOND = "second"
RESET = ("reset", "by service")  # how an episode ends that an operator ends
WHOLE = ("state", "torque", "controller_state")  # topics with a message a tick

Turns = Mapping[str, set[tuple[int, int]]]  # by topic


@dataclass(frozen=True)
class Operation:
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


def unfit_policy(law: ControllerParameters) -> Path:
    """A shipped policy that this controller refuses."""
    for path in sorted(SHIPPED.glob("*.safetensors")):
        try:
            fitted(read(path), law, load_gaits(law.gait))
        except PolicyFileError:
            return path
    raise ValueError("every shipped policy fits")


def near_policy(path: Path, number: int) -> PolicyFile:
    """A policy that acts as the file's does but for the last bias of each output, another one for each number."""
    file = read(path)
    arrays = {**file.arrays, "2.bias": file.arrays["2.bias"] + np.float32(2e-4 * (number % 3))}
    arrays[PROBE] = np.stack([forward(arrays, row) for row in probe_inputs(len(file.metadata.observation))])
    return PolicyFile(file.metadata.model_copy(update={"training_seed": number}), arrays)


class Operations:
    """Called at every glance at the walk; does the next operation when its time has come, and waits for the answer."""

    def __init__(self, operator: Any, folder: Path, every: float, seed: int) -> None:
        """`operator`: an `Operator`; `every`: s between two operations."""
        self._operator, self._every = operator, every
        self._first = LATCHED  # policies yet to come before all else, so that what is latched does not grow later
        self._kinds = draw_kinds(random.Random(seed))
        self._file = (folder / OPERATIONS).open("w", newline="", encoding="utf-8")
        self._rows = csv.writer(self._file)
        self._rows.writerow([field.name for field in fields(Operation)])
        self._next, self._recorded = min(every, LATCH_SECONDS), 0

    def __call__(self, now: Any, seconds: float) -> None:
        """Look at the clock; `now` is the watch's `Progress`."""
        self._operator.spin(0.0)
        if seconds < self._next:
            return
        self._next = seconds + (min(self._every, LATCH_SECONDS) if self._first else self._every)
        episode, tick = self._operator.newest
        kind = self._kind()
        what, answer, expected = self._operator.do(kind)
        row = Operation(round(seconds, 3), episode, tick, kind, what, " ".join(answer.split())[:200], expected)
        self._rows.writerow(astuple(row))
        self._file.flush()

    def close(self) -> None:
        """No more operations."""
        self._operator.close()
        self._file.close()

    def _kind(self) -> str:
        if self._first:
            self._first -= 1
            return "good policy"
        self._recorded = self._recorded + 1 if self._operator.records else 0
        if self._recorded > RECORDED:
            return "recorder ended"
        return next(kind for kind in self._kinds if not (self._recorded and kind == "recorder started"))


def read_operations(path: Path) -> list[Operation]:
    """The rows of `operations.csv`; none where there was no operator."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return [
        Operation(
            float(row["seconds"]),
            int(row["episode"]),
            int(row["tick"]),
            row["kind"],
            row["what"],
            row["answer"],
            row["expected"] == "True",
        )
        for row in rows
    ]


def judge_operations(folder: Path) -> tuple[dict[str, Any], dict[str, bool]]:
    """How a soak walked, how its operations were answered and what the second recorder missed; the bars of all three.

    Raises:
        RecordingError: a recording cannot be read.
    """
    operations = read_operations(folder / OPERATIONS)
    asked, right = Counter(each.kind for each in operations), Counter(e.kind for e in operations if e.expected)
    walk = judge_walk(iterate_episodes(folder / "recording"), asked["reset"])
    main = turns_in(folder / "recording") if operations else {}
    seconds = [{"name": path.name, **compare(turns_in(path), main)} for path in second_recordings(folder)]
    bars = {
        "recording": walk["ticks_not_recorded"] == 0,
        "walks": not walk["walks"]["fell"],
        "operations": all(each.expected for each in operations),
        "second recordings": all(each["ticks"] and not each["missing"] for each in seconds),
    }
    counts = {kind: [asked[kind], right[kind]] for kind in sorted(asked)}
    return {**walk, "operations": counts, "second_recordings": seconds}, bars


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


def second_recordings(folder: Path) -> list[Path]:
    """What the second recorder left, the oldest first."""
    return sorted((folder / SECOND).glob("recording*"), key=lambda path: int(path.name.partition("-")[2] or 1))


def turns_in(recording: Path) -> Turns:
    """Episode and tick of all that comes once a tick, by topic."""
    return {topic: set(recorded_turns(recording, topic)) for topic in WHOLE}


def compare(second: Turns, main: Turns) -> dict[str, int]:
    """How many messages the `main` recording has, while the `second` one has all topics, that this has not."""
    if not all(second.values()):
        return {"ticks": 0, "missing": 0}
    first = max(min(turns) for turns in second.values())  # a recorder that comes hears one topic a little after another
    last = min(max(turns) for turns in second.values())
    missing = sum(first <= turn <= last for topic in WHOLE for turn in main[topic] - second[topic])
    return {"ticks": len(second["state"]), "missing": missing}

"""A training session: a learner of stable-baselines3 and the robots that walk for it. Its folder has

    curve.csv             a line for each rollout
    session.json          what decides it
    session.zip           where it stands, written every `KEPT` seconds and at the end, with `replay.pkl` where the
                          learner has a replay; it goes on from there
    policy.safetensors    the network, likewise; as a robot walks with it, without noise

After a stop the robots begin new episodes.
"""

import csv
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from rabbit_description.atomic_file import replacing
from rabbit_description.state import Array
from rabbit_experiments.conditions import POLICY
from rabbit_experiments.engine import progress_bar
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv

from rabbit_rivals.learners import KINDS, actor_arrays, make

CURVE, OPTIONS, SESSION, REPLAY, KEPT = "curve.csv", "session.json", "session.zip", "replay.pkl", 600.0  # s
COLUMNS = "ticks", "hours", "episodes", "walked", "reward"


class SessionError(RuntimeError):
    """A folder whose session was another, or is damaged."""


@dataclass(frozen=True)
class Options:
    """A session's options; `ticks` may grow when it goes on. `rollout`: ticks of each robot between two updates."""

    learner: str
    ticks: int
    seed: int
    robots: int
    rollout: int
    hidden: int  # units of each of the two hidden layers
    flat: float = 0.25  # share of the robots on flat ground
    settings: dict[str, Any] = field(default_factory=dict)  # of the learner

    def asked(self) -> str:
        """What decides the session."""
        return json.dumps({name: value for name, value in asdict(self).items() if name != "ticks"}, indent=1) + "\n"


@dataclass(frozen=True)
class Done:
    """What came of a session so far."""

    arrays: dict[str, Array]
    ticks: int
    hours: float  # of computing
    episodes: int


class Bar(BaseCallback):
    """A bar of the ticks, with the mean reward of a tick and the share of the episodes that ended well."""

    def __init__(self, ticks: int) -> None:
        super().__init__()
        self._ticks, self._bar = ticks, progress_bar()

    def _on_training_start(self) -> None:
        self._task = self._bar.add_task("", total=self._ticks, completed=self.num_timesteps)

    def _on_rollout_start(self) -> None:
        self.rewards, self.ends = list[float](), list[bool]()

    def _on_step(self) -> bool:
        self.rewards.append(float(self.locals["rewards"].mean()))
        cut = (info.get("TimeLimit.truncated") for info in self.locals["infos"])
        self.ends += [has_walked for has_walked in cut if has_walked is not None]
        return True

    def _on_rollout_end(self) -> None:
        self.reward = float(np.mean(self.rewards))
        self.walked = float(np.mean(self.ends)) if self.ends else np.nan
        text = f"reward {self.reward:.4f}, {self.walked:.0%} of {len(self.ends)} episodes ended well"
        self._bar.update(self._task, completed=self.num_timesteps, description=text)

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()


class Keeper(Bar):
    """Writes the session's files into the folder `out`; `write`, the policy's file."""

    def __init__(self, options: Options, out: Path, done: list[str], write: Callable[[Path, Done], None]) -> None:
        super().__init__(options.ticks)
        self._out, self._write, self._kept = out, write, time.perf_counter()
        self._hours, self._episodes = float(done[1]), int(done[2])
        self._began = self._kept - 3600 * self._hours

    def _on_rollout_start(self) -> None:
        super()._on_rollout_start()
        if time.perf_counter() - self._kept > KEPT:
            self.keep()

    def _on_rollout_end(self) -> None:
        super()._on_rollout_end()
        self._hours, self._episodes = (time.perf_counter() - self._began) / 3600, self._episodes + len(self.ends)
        figures = f"{self._hours:.4f}", self._episodes, f"{self.walked:.4g}", f"{self.reward:.4g}"
        with (self._out / CURVE).open("a", newline="") as curve:
            csv.writer(curve, lineterminator="\n").writerow([self.num_timesteps, *figures])

    def __exit__(self, *_: object) -> None:
        super().__exit__()
        if self.n_calls:
            self.keep()

    def keep(self) -> None:
        """The session as it stands."""
        with replacing(self._out / SESSION) as partial, partial.open("wb") as file:
            self.model.save(file)
        if isinstance(self.model, OffPolicyAlgorithm):
            with replacing(self._out / REPLAY) as partial, partial.open("wb") as file:
                self.model.save_replay_buffer(file)
        done = Done(actor_arrays(self.model), self.num_timesteps, self._hours, self._episodes)
        self._write(self._out / POLICY, done)
        self._kept = time.perf_counter()


def learn(o: Options, environment: VecEnv, reads: int, write: Callable[[Path, Done], None], out: Path) -> Path:
    """Train, or go on; returns the policy's file, which `write` writes. Raises `SessionError`."""
    torch.set_num_threads(1)
    out.mkdir(parents=True, exist_ok=True)
    model = make(o.learner, environment, reads, o.seed, o.rollout, o.hidden, **o.settings)
    if (out / SESSION).is_file():
        if (out / OPTIONS).read_text() != o.asked():
            raise SessionError(f"{out / OPTIONS}: a session with other options: use another folder")
        model = _restored(out, o, environment)
    (out / OPTIONS).write_text(o.asked())
    left, last = o.ticks - model.num_timesteps, _trimmed(out / CURVE, model.num_timesteps)
    if left > 0:
        with Keeper(o, out, last, write) as keeper:
            model.learn(left, keeper, reset_num_timesteps=False)
    return out / POLICY


def _restored(out: Path, o: Options, environment: VecEnv) -> BaseAlgorithm:
    """The learner as it stood, with new noise and new plants."""
    try:
        model = KINDS[o.learner][0].load(out / SESSION, environment, device="cpu")
        if isinstance(model, OffPolicyAlgorithm):
            model.load_replay_buffer(out / REPLAY)
    except Exception as error:  # of zip, pickle and torch: they raise what they like
        raise SessionError(f"{out / SESSION}: damaged: {str(error).splitlines()[0]}") from error
    model.set_random_seed(o.seed + model.num_timesteps)
    return model


def _trimmed(path: Path, ticks: int) -> list[str]:
    """The last line of the curve, of which the head and what was kept stay."""
    lines = list(csv.reader(path.open(newline=""))) if path.is_file() else []
    kept = [line for line in lines[1:] if line and line[0].isdigit() and int(line[0]) <= ticks]
    with replacing(path) as partial, partial.open("w", newline="") as curve:
        csv.writer(curve, lineterminator="\n").writerows([COLUMNS, *kept])
    return kept[-1] if kept else ["0", "0", "0"]

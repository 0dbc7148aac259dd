"""A training session: a learner, and fleets that walk for it. Its folder has

    curve.csv             a line for each rollout
    session.pt            where it stands, written every `KEPT` seconds and at the end; it goes on from there
    policy.safetensors    the network, likewise; as a robot walks with it, without noise

After a stop the robots begin new episodes.
"""

import csv
import ctypes
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from pydantic import BaseModel, ConfigDict, Field
from rabbit_benchmark.cells import Terrain
from rabbit_description.atomic_file import replacing
from rabbit_description.state import Array
from rabbit_experiments.conditions import POLICY

from rabbit_residual.fleet import Fleet, Rollout

MMAP_THRESHOLD = -3  # of malloc.h
SESSION, KEPT = "session.pt", 300.0  # s
COLUMNS = ("ticks", "hours", "stones_walked", "flat_walked", "episodes", "reward")
STEPS = ("stones", "flat_steps")  # of an episode

Done = dict[str, Any]  # ticks, hours of computing, episodes
Act = Callable[[Array], Array]


class SessionError(RuntimeError):
    """A folder whose session was another, or is damaged."""


class Learner(Protocol):
    """PPO or SAC."""

    @property
    def figures(self) -> tuple[str, ...]:
        """Names of what an update returns."""

    def act(self, reads: Array) -> Array:
        """Actions (N, m) with noise at `reads` (N, r)."""

    def update(self, rollouts: list[Rollout]) -> tuple[float, ...]:
        """Learn from them; returns figures for the curve."""

    def arrays(self) -> dict[str, Array]:
        """The actor's, `0.weight` to `2.bias`."""

    def state(self) -> dict[str, Any]:
        """All that an update goes on from."""

    def restore(self, state: dict[str, Any], seed: int) -> None:
        """Go on from there, with new noise."""


class Options(BaseModel):
    """Of any session; `ticks` may grow when it goes on."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    ticks: int = Field(6_000_000, ge=1, le=10**11)
    seed: int = Field(1, ge=0, le=2**31)
    robots: int = Field(128, ge=4, le=4096, description="that walk side by side")
    flat: float = Field(0.25, ge=0, le=1, description="share of them on flat ground")
    rollout: int = Field(96, ge=1, le=10_000, description="ticks of each robot between two updates")

    @property
    def asked(self) -> str:
        """What decides a session."""
        return repr(self.model_dump(exclude={"ticks"}))


def learn(
    options: Options,
    learner: Learner,
    fleet: Callable[[Terrain, int, Act, list[int]], Fleet],
    write: Callable[[Path, Done], None],
    out: Path,
    tell: Callable[[str], None],
) -> Path:
    """Train, or go on; returns the policy's file, which `write` writes. Raises `SessionError`."""
    torch.set_num_threads(1)
    _keep_large_arrays_apart()
    out.mkdir(parents=True, exist_ok=True)
    done: Done = {"ticks": 0, "hours": 0.0, "episodes": 0}
    if (out / SESSION).is_file():
        done = _restore(out / SESSION, learner, options)

    def keep() -> None:
        with replacing(out / SESSION) as partial:
            torch.save({"learner": learner.state(), "asked": options.asked, "done": done}, partial)
        write(out / POLICY, done)

    flat = round(options.robots * options.flat)
    shares: dict[Terrain, int] = {"stones": options.robots - flat, "flat": flat}
    seeds = [options.seed, done["ticks"]]
    fleets = {
        terrain: fleet(terrain, share, learner.act, [*seeds, i])
        for i, (terrain, share) in enumerate(shares.items())
        if share
    }
    columns = (*COLUMNS, *learner.figures, *STEPS)
    _trim(out / "curve.csv", columns, done["ticks"])
    kept, is_new = time.perf_counter(), False
    try:
        while done["ticks"] < options.ticks:
            start = time.perf_counter()
            found = [fleet.walk(options.rollout) for fleet in fleets.values()]
            of_learner = learner.update(found)
            done["ticks"] += options.robots * options.rollout
            done["hours"] += (time.perf_counter() - start) / 3600
            done["episodes"] += sum(len(fleet.ends) for fleet in fleets.values())
            is_new = True
            ends = [fleets[terrain].ends if terrain in fleets else [] for terrain in shares]
            walked, steps = ([np.mean([end[i] for end in each]) if each else np.nan for each in ends] for i in (0, 1))
            reward = float(np.mean(np.concatenate([each.reward.ravel() for each in found])))
            figures = [*walked, done["episodes"], reward, *of_learner, *steps]
            line = [done["ticks"], f"{done['hours']:.4f}", *(f"{value:.4g}" for value in figures)]
            with (out / "curve.csv").open("a", newline="") as curve:
                csv.writer(curve, lineterminator="\n").writerow(line)
            tell(", ".join(f"{name} {value}" for name, value in zip(columns, line, strict=True)))
            if time.perf_counter() - kept > KEPT:
                keep()
                kept, is_new = time.perf_counter(), False
    finally:
        if is_new:
            keep()
    return out / POLICY


def _keep_large_arrays_apart() -> None:
    """Each gets memory of its own from glibc, and gives it back: in the heap 60 MB a rollout stayed."""
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):
        libc.mallopt(MMAP_THRESHOLD, 65_536)


def _restore(path: Path, learner: Learner, options: Options) -> Done:
    """Where the session stands; raises `SessionError`."""
    try:
        state = torch.load(path, weights_only=True)
        if state["asked"] != options.asked:
            raise SessionError(f"{path}: a session with {state['asked']}: use another folder")
        learner.restore(state["learner"], options.seed + state["done"]["ticks"])
        return dict(state["done"])
    except SessionError:
        raise
    except Exception as error:  # torch raises what it likes
        raise SessionError(f"{path}: damaged: {str(error).splitlines()[0]}") from error


def _trim(path: Path, columns: tuple[str, ...], ticks: int) -> None:
    """The head and the lines of the curve that belong to what was kept, and no other."""
    lines = list(csv.reader(path.open(newline=""))) if path.is_file() else []
    kept = [line for line in lines[1:] if line and line[0].isdigit() and int(line[0]) <= ticks]
    with replacing(path) as partial, partial.open("w", newline="") as curve:
        csv.writer(curve, lineterminator="\n").writerows([columns, *kept])

"""The same run by every road gives the same digits, in this process and in a new one elsewhere."""

import multiprocessing
import os
import shutil
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from itertools import zip_longest
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from drawn_runs import Digits, Run, assert_same, digits, runs, tick_of, walk
from hypothesis import Phase, given, settings
from rabbit_description import GAITS, LIBRARIES
from rabbit_description.yaml_file import dump_yaml
from rabbit_sim.stones import draw_course
from rl_cbf_clf_controller.weights import policy_path
from rl_trainer.rollout import Record


def with_used_parts(run: Run, other: Run) -> Digits:
    """By the plant and the controller that have walked from another seed."""
    with run.parts() as parts:
        digits(run.model_copy(update={"seed": other.seed, "ticks": other.ticks}), parts)
        return digits(run, parts)


def read_late(run: Run, other: Run) -> Digits:
    """What a tick says is read when the run is over."""
    with run.parts() as parts:
        return [tick_of(found) for found in [*walk(run, parts)]]


def interleaved(run: Run, other: Run) -> Digits:
    """Tick by tick in turn with another run."""
    with run.parts() as ours, other.parts() as theirs:
        both = zip_longest(walk(run, ours), walk(other, theirs))
        return [tick_of(found) for found, _ in both if found is not None]


def in_threads(run: Run, other: Run) -> Digits:
    """Beside another run and itself."""
    with ThreadPoolExecutor(3) as pool:
        found, _, again = pool.map(digits, (run, other, run))
    assert_same(again, found, run, "two threads")
    return found


def changed_and_changed_back(run: Run, other: Run) -> Digits:
    """Before each tick another policy and another sigma are set, and then the former ones again."""
    with run.parts() as parts, run.model_copy(update={"policy": "zero"}).parts() as (_, another):
        controller, found = parts[1], []
        policy, parameters = controller.policy, controller.parameters
        for record in walk(run, parts):
            found.append(tick_of(record))
            controller.policy, controller.parameters = another.policy, parameters.model_copy(update={"sigma": 7.0})
            controller.policy, controller.parameters = policy, parameters
        return found


def by_files(run: Run, other: Run) -> Digits:
    """Gait, policy and course come from files; the gait's first held another gait, changed at the same time."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        gait, course, policy = folder / "gait.yaml", folder / "course.yaml", run.policy
        stones = draw_course(run.simulation, np.random.default_rng(np.random.SeedSequence(run.seed).spawn(3)[0]))
        course.write_text(dump_yaml({"stones": [stone.model_dump() for stone in stones]}), encoding="utf-8")
        if policy not in ("zero", "oracle"):
            policy = shutil.copy(policy_path(policy), folder)
        own = run.controller.model_copy(update={"gait": str(gait)})
        simulation = run.simulation.model_copy(update={"course": str(course)})
        from_files = run.model_copy(update={"controller": own, "simulation": simulation, "policy": policy})
        for held in (other.controller.gait, run.controller.gait):
            gait.write_bytes(gait_file(held).read_bytes())
            os.utime(gait, (0, 0))
            found = digits(from_files)
        return found


def gait_file(name: str) -> Path:
    """Of a shipped gait or library."""
    return next(path for folder in (GAITS, LIBRARIES) if (path := folder / f"{name}.yaml").is_file())


def replayed(run: Run, other: Run) -> Digits:
    """A new controller, made ready as a node makes its own, gets the plant's states; a refused tick ends both."""
    with run.parts() as parts:
        found = [*walk(run, parts)]
    with run.parts() as (_, controller):
        controller.rehearse()
        controller.reset(run.seed)
        states = (record if isinstance(record, str) else record.state for record in found)
        return [tick_of(s if isinstance(s, str) else Record(s, controller.step(s))) for s in states]


ROADS = with_used_parts, read_late, interleaved, in_threads, changed_and_changed_back, by_files, replayed


@settings(max_examples=settings.default.max_examples // 5, phases=(Phase.reuse, Phase.generate))
@given(run=runs(), other=runs())
def test_every_road_has_the_same_digits(run: Run, other: Run) -> None:
    expected = digits(run)
    for road in ROADS:
        assert_same(road(run, other), expected, run, f"{road.__name__} {other!r}")


ELSEWHERE = {"TZ": "Asia/Kathmandu", "LC_ALL": "de_DE.UTF-8", "PYTHONHASHSEED": "4711", "PYTHONOPTIMIZE": "2"}
ELSEWHERE |= {"OMP_NUM_THREADS": "4", "OPENBLAS_NUM_THREADS": "4", "PYTHONMALLOC": "debug"}


@settings(max_examples=max(settings.default.max_examples // 50, 1), phases=(Phase.reuse, Phase.generate))
@given(run=runs())
def test_a_new_process_has_the_same_digits(tmp_path_factory: pytest.TempPathFactory, run: Run) -> None:
    """With other settings of the machine, in an empty folder."""
    spawn = multiprocessing.get_context("spawn")
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (ELSEWHERE | {"HOME": str(tmp_path_factory.mktemp("home"))}).items():
            patch.setenv(name, value)
        with ProcessPoolExecutor(1, spawn, initializer=os.chdir, initargs=(os.environ["HOME"],)) as pool:
            found = pool.submit(digits, run).result()
    assert_same(found, digits(run), run, "a new process")

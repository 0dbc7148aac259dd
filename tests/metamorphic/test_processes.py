"""The same run in another process, under other settings of the machine, gives the same digits."""

import locale
import multiprocessing
import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest
from drawn_runs import Run, assert_same, digits, runs
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

EXAMPLES = settings.default.max_examples
DRAWN = Phase.reuse, Phase.generate

MACHINES = {
    "as here": {},
    "another place": {"TZ": "Asia/Kathmandu", "LC_ALL": "de_DE.UTF-8", "LANG": "tr_TR.UTF-8", "PYTHONHASHSEED": "4711"},
    "more threads": {"OMP_NUM_THREADS": "4", "OPENBLAS_NUM_THREADS": "4", "MKL_NUM_THREADS": "4"},
    "optimised": {"PYTHONOPTIMIZE": "2", "PYTHONMALLOC": "debug", "PYTHONHASHSEED": "0"},
}


def settle(folder: Path) -> None:
    """Into an empty folder, with the numbers of the country, as a program with windows does."""
    os.chdir(folder)
    with suppress(locale.Error):
        locale.setlocale(locale.LC_ALL, "")


@contextmanager
def process(folder: Path, **environment: str) -> Iterator[ProcessPoolExecutor]:
    """A new Python process."""
    own = {"HOME": str(folder), "XDG_CACHE_HOME": str(folder / "cache"), "TMPDIR": str(folder)}
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, spawn, initializer=settle, initargs=(folder,)) as pool:
        with pytest.MonkeyPatch.context() as patch:
            for name, value in {**own, **environment}.items():
                patch.setenv(name, value)
            pool.submit(os.getpid).result()  # it starts now
        yield pool


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, ProcessPoolExecutor]]:
    """A process for each of the `MACHINES`."""
    with ExitStack() as stack:
        yield {
            name: stack.enter_context(process(tmp_path_factory.mktemp("machine"), **environment))
            for name, environment in MACHINES.items()
        }


@settings(max_examples=EXAMPLES // 4, phases=DRAWN)
@given(run=runs(), machine=st.sampled_from(list(MACHINES)))
def test_another_process_has_the_same_digits(machines: dict[str, ProcessPoolExecutor], run: Run, machine: str) -> None:
    """One that has walked other runs before."""
    assert_same(machines[machine].submit(digits, run).result(), digits(run), run, machine)


@settings(max_examples=max(EXAMPLES // 50, 1), phases=DRAWN)
@given(run=runs())
def test_a_new_process_has_the_same_digits(tmp_path_factory: pytest.TempPathFactory, run: Run) -> None:
    with process(tmp_path_factory.mktemp("machine")) as pool:
        assert_same(pool.submit(digits, run).result(), digits(run), run, "a new process")

"""Runs on a cluster: a real scheduler, and workers that are others, raise, stop, are killed, come later."""

import importlib
import json
import os
import platform
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from threading import Thread
from typing import Any

import dask
import distributed
import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rabbit_experiments import cluster, engine
from rabbit_experiments.cache import Cache, JobError
from rabbit_experiments.conditions import who_runs
from rabbit_experiments.evaluation import Walk
from rabbit_reproduce.controllers import CBF_CLF

TIMES = {"tick_ms_p50", "tick_ms_p99", "plant_ms_p50", "walk_seconds"}
PATIENCE = 120.0  # s
MODULE = """
import os, time
from dataclasses import dataclass
from pathlib import Path
from pydantic import BaseModel
from rabbit_experiments.cache import Job

class Report(BaseModel):
    number: int

@dataclass(frozen=True)
class Nap(Job):
    number: int
    folder: Path
    seconds: float = 0.0
    model = Report

    def do(self):
        with (self.folder / "log").open("a") as file:
            file.write(f"{self.number} {os.getpid()}\\\\n")
        if self.seconds < 0:
            raise ZeroDivisionError("a job's own")
        time.sleep(self.seconds)
        return Report(number=self.number)
""".replace("\\\\", "\\")


class Started:
    """A scheduler and workers as processes, in a folder whose modules they import."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.log = folder, folder / "log"
        self._running: list[subprocess.Popen[bytes]] = []
        self._file = folder / "scheduler.json"

    def start(self, *words: str, path: Sequence[Path] = (), **environment: str) -> subprocess.Popen[bytes]:
        """A process that imports from `path` and the folder first."""
        paths = ":".join([*map(str, path), str(self.folder), os.environ.get("PYTHONPATH", "")])
        env = {**os.environ, "PYTHONPATH": paths, **environment}
        process = subprocess.Popen([sys.executable, *words], cwd=self.folder, env=env, start_new_session=True)
        self._running.append(process)
        return process

    def scheduler(self, host: str = "127.0.0.1") -> subprocess.Popen[bytes]:
        """Its file names its address."""
        self._file.unlink(missing_ok=True)
        self._where = ("--scheduler-file", str(self._file), "--host", host, "--dashboard-address", "127.0.0.1:0")
        process = self.start("-m", "dask", "scheduler", "--port", "0", *self._where)
        until(self._file.exists)
        return process

    def worker(self, *words: str, path: Sequence[Path] = (), **environment: str) -> subprocess.Popen[bytes]:
        """Without a nanny: killed, it is gone."""
        words = "-m", "dask", "worker", *self._where, "--nthreads", "1", "--no-nanny", *words
        return self.start(*words, path=path, **environment)

    def client(self, address: str) -> subprocess.Popen[bytes]:
        """Takes twelve naps there."""
        program = (
            "from pathlib import Path; from rabbit_napping import Nap; from rabbit_experiments import cache, engine\n"
            f"folder, address = Path({str(self.folder)!r}), {address!r}\n"
            "if __name__ == '__main__':\n"
            "    naps = [Nap(number, folder, 0.3) for number in range(12)]\n"
            "    engine.run(naps, cache.Cache(folder / 'cache'), address)"
        )
        (self.folder / "client.py").write_text(program)
        return self.start("client.py")

    @property
    def address(self) -> str:
        """The scheduler's."""
        return str(json.loads(self._file.read_text())["address"])

    @property
    def began(self) -> list[tuple[int, int]]:
        """Number and process of each nap that was begun."""
        lines = self.log.read_text().splitlines() if self.log.exists() else []
        return [(int(number), int(process)) for number, process in map(str.split, lines)]

    def end(self) -> None:
        """Kill all."""
        for process in self._running:
            process.kill()
            process.wait()


def until(condition: Callable[[], object]) -> None:
    """Wait."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.fixture
def started(tmp_path: Path) -> Iterator[Started]:
    """Nothing runs yet."""
    (tmp_path / "rabbit_napping.py").write_text(MODULE)
    sys.path.insert(0, str(tmp_path))
    processes = Started(tmp_path)
    yield processes
    processes.end()
    sys.path.remove(str(tmp_path))
    sys.modules.pop("rabbit_napping", None)
    importlib.invalidate_caches()


def naps(started: Started, *seconds: float) -> list[Any]:
    """One for each time."""
    importlib.invalidate_caches()
    nap = importlib.import_module("rabbit_napping").Nap
    return [nap(number, started.folder, of, title=f"nap {number}") for number, of in enumerate(seconds)]


class Running(Thread):
    """`engine.run` in a thread; `join` raises what it raised."""

    def __init__(self, jobs: list[Any], cache: Cache, address: str) -> None:
        super().__init__(daemon=True)
        self._call, self.error = (jobs, cache, address), None
        self.kept: list[Any] = []
        self.start()

    def run(self) -> None:
        """Each result once."""
        try:
            engine.run(*self._call, note=lambda job, _: str(self.kept.append(job)))
        except BaseException as error:
            self.error = error

    def join(self, timeout: float | None = PATIENCE) -> None:
        """Until it ends."""
        super().join(timeout)
        assert not self.is_alive()
        if self.error:
            raise self.error


def is_kept(jobs: list[Any], cache: Cache) -> bool:
    """Whether each has a result."""
    return all(cache.get(job) is not None for job in jobs)


def test_rows_are_those_of_one_process_whatever_becomes_of_the_workers(started: Started, tmp_path: Path) -> None:
    """One worker is killed in the middle, another comes later. Walks in MuJoCo go out in batches."""
    assemblies = [CBF_CLF.assembly(stones=2, plant=plant) for plant in ("pybullet", "mujoco")]
    walks = [Walk(assembly, seed, run=seed) for assembly in assemblies for seed in range(1, 9)]
    rows: dict[int | str, Any] = {}
    for processes in (1, 2, "cluster"):
        cache = Cache(tmp_path / f"cache-{processes}")
        if processes == "cluster":
            started.scheduler()
            victim, _, _ = started.worker(), started.worker(), started.worker()
            running = Running(walks, cache, started.address)
            until(lambda running=running: running.kept)
            victim.kill()
            started.worker()
            running.join()
            assert sorted(map(hash, running.kept)) == sorted(map(hash, walks))
        else:
            engine.run(walks, cache, int(processes))
        rows[processes] = [cache.get(walk).row.model_dump(exclude=TIMES) for walk in walks]
    assert rows[1] == rows[2] == rows["cluster"]


def test_another_worker_gets_no_job(started: Started, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By the library's name, also where it comes later; one with threads too, and one that adds up in another order,
    as an old processor does. If there is no other, the run ends."""
    other = tmp_path / "other"
    (other / "numpy-1.0.dist-info").mkdir(parents=True)
    (other / "numpy-1.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: numpy\nVersion: 1.0\n")
    started.scheduler()
    jobs, cache = naps(started, *[0.5] * 30), Cache(tmp_path / "cache")
    strange = started.worker(path=[other])
    with pytest.raises(JobError, match=r"no worker gets jobs: tcp://.*: another numpy$"):
        engine.run(jobs, cache, started.address)
    good = started.worker()
    with distributed.Client(started.address, set_as_default=False) as client:
        client.wait_for_workers(2, PATIENCE)
    running = Running(jobs, cache, started.address)
    until(lambda: started.began)
    late, threaded = started.worker(path=[other]), started.worker("--nthreads", "2")
    old = started.worker(OPENBLAS_CORETYPE="Nehalem" if platform.machine() == "x86_64" else "ARMV8")
    running.join()
    assert is_kept(jobs, cache)
    assert {process for _, process in started.began} == {good.pid}
    assert strange.poll() is late.poll() is threaded.poll() is old.poll() is None
    said = capsys.readouterr().out
    assert "another numpy" in said
    assert "another arithmetic" in said
    assert "2 threads, expected --nthreads 1" in said


@given(st.lists(st.integers(1, 5), max_size=300), st.integers(1, 9))
def test_every_job_goes_out_once_and_batches_of_several_alone(sizes: list[int], workers: int) -> None:
    batches: Any = [[f"{number} {k}" for k in range(size)] for number, size in enumerate(sizes)]
    given_out = cluster.loads(batches, workers)
    assert sorted(batch for load in given_out for batch in load) == sorted(batches)
    for load in given_out:
        assert len(load) == 1 or all(len(batch) == 1 for batch in load)
        assert 1 <= len(load) <= cluster.MOST_JOBS


def test_of_a_load_that_a_worker_ended_with_each_job_is_done_or_told(
    started: Started, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of 48 jobs two go out at once; one of them always raises, one worker is killed."""
    started.scheduler()
    victim = started.worker()
    jobs, cache = naps(started, -1.0, *[0.05] * 47), Cache(tmp_path / "cache")
    running = Running(jobs, cache, started.address)
    until(lambda: len(started.began) > 6)
    victim.kill()
    started.worker()
    with pytest.raises(JobError, match=r"nap 0: ZeroDivisionError"):
        running.join()
    assert is_kept(jobs[1:], cache)
    assert max(Counter(number for number, _ in started.began).values()) <= 2
    assert capsys.readouterr().out.count("Traceback") == 1


def test_an_error_is_told_once_and_leaves_the_worker(
    started: Started, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    started.scheduler()
    worker = started.worker()
    jobs, cache = naps(started, 0.0, -1.0, 0.0, 0.0), Cache(tmp_path / "cache")
    with pytest.raises(JobError, match=r"nap 1: ZeroDivisionError\(\"a job's own\"\)"):
        engine.run(jobs, cache, started.address)
    assert [cache.get(job) is None for job in jobs] == [False, True, False, False]
    assert Counter(started.began) == dict.fromkeys([(number, worker.pid) for number in range(4)], 1)
    said = capsys.readouterr().out
    assert said.count("Traceback") == 1
    assert "rabbit_napping.py" in said


def test_a_killed_worker_and_a_stopped_one(started: Started, tmp_path: Path) -> None:
    """Only what the killed one had is begun again; what the stopped one has ends when it goes on."""
    started.scheduler()
    workers = [started.worker() for _ in range(3)]
    jobs, cache = naps(started, *[0.5] * 40), Cache(tmp_path / "cache")
    running = Running(jobs, cache, started.address)
    until(lambda: len({process for _, process in started.began}) == 3)
    killed, stopped, _ = workers
    stopped.send_signal(signal.SIGSTOP)
    killed.kill()
    until(lambda: len(running.kept) >= 37)
    stopped.send_signal(signal.SIGCONT)
    running.join()
    assert is_kept(jobs, cache)
    assert len(running.kept) == len({*running.kept}) == 40
    twice = [number for number, count in Counter(number for number, _ in started.began).items() if count > 1]
    assert len(twice) <= 1
    assert all((number, killed.pid) in started.began for number in twice)


def test_a_job_that_kills_its_workers_is_given_up(started: Started, tmp_path: Path) -> None:
    started.scheduler()
    jobs, cache = naps(started, 60.0), Cache(tmp_path / "cache")
    running = Running(jobs, cache, started.address)
    for count in range(1, cluster.LOSSES + 1):
        worker = started.worker()
        until(lambda count=count: len(started.began) == count)
        worker.kill()
    with pytest.raises(JobError, match="nap 0: 3 workers ended with it"):
        running.join()


def test_after_a_killed_client_and_a_killed_scheduler_a_run_goes_on_later(started: Started, tmp_path: Path) -> None:
    scheduler = started.scheduler()
    started.worker()
    jobs, cache = naps(started, *[0.3] * 12), Cache(tmp_path / "cache")
    client = started.client(started.address)
    until(lambda: cache.get(jobs[2]))
    client.kill()
    client.wait()
    before = {job.number for job in jobs if cache.get(job) is not None}
    assert 0 < len(before) < 12
    running = Running(jobs, cache, started.address)
    until(lambda: len(running.kept) >= 3)
    scheduler.kill()
    with pytest.raises(JobError, match="the scheduler ended"):
        running.join()
    kept = before | {job.number for job in running.kept}
    begun = len(started.began)
    assert begun <= len(kept) + 2 + 2  # one was under way, one next
    started.scheduler()
    started.worker()
    assert engine.run(jobs, cache, started.address) == 12 - len(kept)
    assert {number for number, _ in started.began[begun:]} == {*range(12)} - kept
    assert is_kept(jobs, cache)


def test_only_who_has_a_certificate_reaches_a_scheduler_with_tls(
    started: Started, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The ten lines of studies/docs/cluster.md."""
    page = Path(__file__).parents[1] / "docs" / "cluster.md"
    make, exports = [part.split("```")[0] for part in page.read_text().split("<!-- tls -->\n```\n")[1:]]
    subprocess.run(["bash", "-ec", make], cwd=tmp_path, check=True, capture_output=True)
    names = [line.removeprefix("export ").split("=") for line in exports.splitlines()]
    for name, value in names:
        monkeypatch.setenv(name, value.replace("$PWD", str(tmp_path)))
    jobs, cache = naps(started, 0.0, 0.0), Cache(tmp_path / "cache")
    started.scheduler(host="tls://127.0.0.1")
    assert started.address.startswith("tls://")
    started.worker()
    with pytest.raises(JobError, match="TLS"):
        engine.run(jobs, cache, started.address)
    own = tmp_path / "own"
    own.mkdir()
    subprocess.run(["bash", "-ec", make], cwd=own, check=True, capture_output=True)
    stranger = distributed.Security(
        tls_ca_file=str(tmp_path / "cert.pem"),
        tls_client_cert=str(own / "cert.pem"),
        tls_client_key=str(own / "key.pem"),
    )
    with pytest.raises(OSError, match="TLS"):
        distributed.Client(started.address, security=stranger, timeout=5, set_as_default=False)
    settings = {name.removeprefix("DASK_").replace("__", ".").lower(): os.environ[name] for name, _ in names}
    with dask.config.set(settings):
        engine.run(jobs, cache, started.address)
    assert is_kept(jobs, cache)


def test_workers_of_this_machine_listen_to_it_alone_and_end_with_ctrl_c(started: Started, tmp_path: Path) -> None:
    jobs, cache = naps(started, *[0.3] * 12), Cache(tmp_path / "cache")
    client = started.client("local:2")
    until(lambda: cache.get(jobs[2]))
    processes = [psutil.Process(client.pid), *psutil.Process(client.pid).children(recursive=True)]
    listening = [
        net_connection.laddr.ip
        for process in processes
        for net_connection in process.net_connections()
        if net_connection.status == "LISTEN"
    ]
    assert {*listening} == {"127.0.0.1"}
    os.killpg(client.pid, signal.SIGINT)
    assert client.wait(PATIENCE) in (1, 130, -signal.SIGINT)
    assert not psutil.wait_procs(processes[1:], PATIENCE)[1]
    assert 3 <= sum(cache.get(job) is not None for job in jobs) < 12


def test_an_open_port_is_asked_for_by_name() -> None:
    for address in ("tcp://10.0.0.1:8786", "node7:8786", "ws://10.0.0.1:8786", "tcp://[2001:db8::1]:8786"):
        with (
            pytest.raises(JobError, match=f"runs code on all workers: expected tls://, or.*insecure:{address[:4]}"),
            cluster.connected(address),
        ):
            pass
        assert cluster._checked(f"insecure:{address}") == address
    for address in ("tls://node7:8786", "tcp://127.0.0.1:8786", "localhost:8786", "tcp://[::1]:8786"):
        assert cluster._checked(address) == address
    with pytest.raises(JobError, match="local:0: expected local:1 to"), cluster.connected("local:0"):
        pass


def test_without_dask_one_line_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "rabbit_experiments.cluster")
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(JobError, match=r"^--cluster local:2: .*pip install 'rabbit_experiments\[cluster\]'"):
        engine.run([Walk(CBF_CLF.assembly(stones=1), 1)], Cache(tmp_path), "local:2")


def test_an_option_beats_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RABBIT_CLUSTER", "local:2")
    assert who_runs(None, None) == "local:2"
    assert who_runs(1, None) == 1
    assert who_runs(1, "local:3") == "local:3"

"""The files that the project reads, in one table: a sound one of each kind, its reader, the error of a refusal."""

import contextlib
import gzip
import hashlib
import io
import json
import tempfile
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rabbit_description import GAITS
from rabbit_description.gait import GaitError, load_gaits
from rabbit_description.yaml_file import dump_yaml
from rabbit_experiments.walk_records import RecordsError, WalkRecords, about_walk, load_records, save_records
from rabbit_misses import model as misses
from rabbit_recording import RecordingError
from rabbit_recording.checking import check_episodes
from rabbit_recording.contents import contents
from rabbit_recording.recover import recover
from rabbit_reproduce.training import training_job
from rabbit_rivals import model_file
from rabbit_rivals.gp_controller import GpAbout
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.restart_file import RestartFile, RestartFileError
from rabbit_sim.stones import CourseError, read_course
from rabbit_viewer.page.broadcast import Broadcast
from rabbit_viewer.page.recording import recorded as recorded_rows
from rabbit_viewer.walk_pictures import records_of
from recorded_walk import TICK_NS, Walk, told, write
from rl_cbf_clf_controller import weights
from rl_cbf_clf_controller.parameters import CONFIG, ParameterError, load_parameters
from rl_cbf_clf_controller.uncertainty import RL_CLF_QP
from rl_trainer.checkpoint import CHECKPOINT, DIGEST, Checkpoint, CheckpointError, checksum, journal_path
from rl_trainer.learning_thread import LearningThread
from rl_trainer.parameters import TrainingParameters
from rl_trainer.training import Trainer
from rl_trainer.transitions import Doubt, Transition
from safetensors.numpy import load, save
from untrained_policy import policy_file, policy_metadata

TINY = TrainingParameters(problem=RL_CLF_QP, hidden1=3, hidden2=2, batch=2, capacity=10)
BAD_RECORDING = (RecordingError, RecordsError)
NAMES = ("policy", "model", "gait", "library", "course", "parameters", "recording")
NAMES += ("journal", "checkpoint", "records", "memory", "misses", "cached result")


@dataclass(frozen=True)
class Entrance:
    """A kind of file. `reads` raises nothing but `error`; `seal` corrects the checksums of a file that was changed.

    `is_told`: a refusal is shown to a person; else the file is made again.
    """

    file: str
    sound: bytes
    reads: Callable[[Path], Any]
    error: type[Exception] | tuple[type[Exception], ...]
    seal: Callable[[bytes], bytes] = bytes
    is_told: bool = True


def entrances(walk: Walk) -> dict[str, Entrance]:
    """All by name; `walk`: some ticks for recordings."""
    gait = (GAITS / "authors_035.yaml").read_bytes()
    one = {**yaml.safe_load(gait), "metadata": {}}
    library = {"name": "two", "start_length": one["step_length"], "gaits": [one, {**one, "step_length": 0.5}]}
    course = {"stones": [{"l_min": 0.35, "l_max": 0.4}, {"l_min": 0.36}]}
    tiny = policy_file(policy_metadata(RL_CLF_QP, hidden=(3, 2)), lambda shape: np.full(shape, 0.1))
    rival = (model_file.SHIPPED / "gp-socp-flat.safetensors").read_bytes()
    checkpoint, journal = kept_files()
    report = gzip.compress(json.dumps({"commit": "a", "episodes": [{"kept": 3}]}).encode())
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        mcap = recorded(folder, walk)
        about = about_walk(walk.parameters, SimulationParameters(stones=2), "zero", 1, "walked")
        save_records(WalkRecords.from_ticks(walk.records, walk.landings, about), folder / "records.npz")
        records = (folder / "records.npz").read_bytes()
        RestartFile(folder / "memory")
        memory = (folder / "memory").read_bytes()
    misses_of_best = Path(misses.__file__).with_name("best.json").read_bytes()

    def stones(path: Path) -> Any:
        return read_course(path, 2, 0.05)

    return {
        "policy": Entrance("tiny.safetensors", tiny.encode(), weights.read, weights.PolicyFileError, with_hash),
        "model": Entrance("a.safetensors", rival, lambda p: model_file.read(p, GpAbout), weights.PolicyFileError),
        "gait": Entrance("gait.yaml", gait, load_gaits, GaitError),
        "library": Entrance("library.yaml", dump_yaml(library).encode(), load_gaits, GaitError),
        "course": Entrance("course.yaml", dump_yaml(course).encode(), stones, CourseError),
        "parameters": Entrance("a.yaml", (CONFIG / "best.yaml").read_bytes(), load_parameters, ParameterError),
        "recording": Entrance("bag.mcap", mcap, use_recording, BAD_RECORDING, without_checksums),
        "journal": Entrance(journal_path(Path(), 0).name, journal, go_on, CheckpointError, with_line_checksums),
        "checkpoint": Entrance(CHECKPOINT, checkpoint, go_on, CheckpointError, with_digest),
        "records": Entrance("records.npz", records, show_records, RecordsError, with_crcs),
        "memory": Entrance("memory", memory, RestartFile, RestartFileError),
        "misses": Entrance("best.json", misses_of_best, misses.MissProbability.load, misses.MissModelError),
        "cached result": Entrance("a.json.gz", report, training_job(TINY).read, ValueError, regzipped, is_told=False),
    }


# What reads them


class Silent:
    """Hears of nothing."""

    def on_plan(self, plan: Any, after: int, report: Any) -> None: ...

    def on_transition(self, transition: Any, tag: Any) -> None: ...


def go_on(path: Path) -> Any:
    """As a trainer does that is started again; the transitions that it has."""
    learning = LearningThread(Trainer(TINY), Silent(), folder=path.parent)
    try:
        learning.take_up(0)
    finally:
        learning.close()
    replay = learning.trainer.replay
    return replay.rows(slice(0, len(replay))).observation.numpy().tobytes() if len(replay) else b""


def use_recording(path: Path) -> None:
    """As `rabbit bag info` does, and another command, which its bytes choose; each may refuse it."""
    others: tuple[Callable[[Path], Any], ...] = (
        lambda bag: list(check_episodes(bag)),
        lambda bag: recover(bag, bag.parent / "recovered"),
        lambda bag: recorded_rows(records_of(bag), "bag").tell(Broadcast()),
    )
    with contextlib.suppress(*BAD_RECORDING):
        others[zlib.crc32(path.read_bytes()) % len(others)](path)
    contents(path)


def show_records(path: Path) -> None:
    """On the page."""
    recorded_rows(load_records(path), "run").tell(Broadcast())


# Sound files


def transition(tick: int) -> Transition:
    """One of no particular value."""
    rng = np.random.default_rng(tick)
    vectors = {name: rng.standard_normal(4) for name in ("LgV", "mu", "mu_qp", "next_LgV", "next_mu")}
    values = {name: rng.standard_normal(1) for name in ("beta", "nominal", "measured")}
    observations = {name: rng.standard_normal(14) for name in ("observation", "next_observation")}
    alpha, about = rng.standard_normal((1, 4)), {"failed": False, "doubt": Doubt.NONE, "step_index": 0}
    return Transition(problem=TINY.problem, tick=tick, alpha=alpha, **about, **vectors, **values, **observations)


def kept_files() -> tuple[bytes, bytes]:
    """A checkpoint and a journal."""
    with tempfile.TemporaryDirectory() as folder:
        trainer = Trainer(TINY)
        kept = Checkpoint(Path(folder), trainer)
        kept.begin()
        for tick in range(3):
            kept.append(trainer.take(transition(tick)) or transition(tick))
        journal = journal_path(Path(folder), 0).read_bytes()
        kept.save()
        return (Path(folder) / CHECKPOINT).read_bytes(), journal


def recorded(folder: Path, walk: Walk) -> bytes:
    """The walk's recording."""
    mcap = write(folder / "bag", ((topic, tick * TICK_NS, message) for topic, tick, message in told(walk)))
    return (mcap / "bag.mcap").read_bytes()


# Checksums of changed content: without them a change would never be read. What is beyond repair stays as it is.


def with_hash(data: bytes) -> bytes:
    """A policy file with the hash of its content."""
    with contextlib.suppress(Exception):
        header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])
        about = weights.PolicyMetadata.model_validate(json.loads(header["__metadata__"]["rabbit_policy"])["metadata"])
        arrays = load(data)
        digest = hashlib.sha256(about.model_dump_json(exclude_none=True).encode())
        for name in sorted(arrays):
            digest.update(name.encode() + arrays[name].tobytes())
        head = json.dumps({"content_hash": digest.hexdigest(), "metadata": about.model_dump(mode="json")})
        return bytes(save(arrays, metadata={"rabbit_policy": head}))
    return data


def with_digest(data: bytes) -> bytes:
    """A checkpoint with the checksums of its content."""
    content = with_crcs(data[DIGEST:])
    return hashlib.sha256(content).digest() + content


def with_crcs(data: bytes) -> bytes:
    """A zip archive with the checksums of its members, which are not compressed."""
    out = io.BytesIO()
    with contextlib.suppress(Exception):
        with zipfile.ZipFile(io.BytesIO(data)) as archive, zipfile.ZipFile(out, "w") as sealed:
            for member in archive.infolist():
                begin = member.header_offset + 30
                begin += sum(int.from_bytes(data[begin - k : begin - k + 2], "little") for k in (4, 2))
                sealed.writestr(member.filename, data[begin : begin + member.compress_size])
        return out.getvalue()
    return data


def with_line_checksums(data: bytes) -> bytes:
    """A journal whose lines have the checksums of what is in them."""
    lines = [line.partition(b" ")[2] for line in data.split(b"\n") if line]
    return b"".join(b"\n%s %s\n" % (checksum(text, TINY.key), text) for text in lines)


def without_checksums(data: bytes) -> bytes:
    """An MCAP file whose chunks have no checksum, as MCAP allows."""
    found, at = bytearray(data), 8
    while at + 9 <= len(found):
        if found[at] == 0x06:
            found[at + 33 : at + 37] = bytes(4)[: max(0, len(found) - at - 33)]
        at += 9 + int.from_bytes(found[at + 1 : at + 9], "little")
    return bytes(found)


def regzipped(data: bytes) -> bytes:
    """The same, compressed again."""
    with contextlib.suppress(Exception):
        return gzip.compress(gzip.GzipFile(fileobj=io.BytesIO(data)).read())
    return gzip.compress(data)

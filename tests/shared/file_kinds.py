"""The kinds of files that the project reads: sound ones of each, who reads them, and the error that refuses one."""

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
from rabbit_experiments.results import ABOUT, ResultsError, ResultsFolder
from rabbit_experiments.tables import read_rows
from rabbit_experiments.walk_records import RecordsError, WalkRecords, about_walk, load_records, save_records
from rabbit_misses import model as misses
from rabbit_recording import RecordingError
from rabbit_recording.checking import check_episodes
from rabbit_recording.contents import contents
from rabbit_recording.open_recording import one_line_errors, opened
from rabbit_recording.reader import iterate_episodes
from rabbit_recording.recover import recover
from rabbit_reproduce.training import COMMITTED, Episode, training_job
from rabbit_rivals import model_file
from rabbit_rivals.gp_controller import GpAbout
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.restart_file import RestartFile, RestartFileError
from rabbit_sim.stones import CourseError, read_course
from rabbit_viewer.page.broadcast import Broadcast
from rabbit_viewer.page.recording import fill
from rabbit_viewer.walk_pictures import records_of
from recorded_walk import TICK_NS, TOPICS, TYPES, Walk, told
from rl_cbf_clf_controller import weights
from rl_cbf_clf_controller.parameters import CONFIG
from rl_cbf_clf_controller.parameters import ParameterError as ControllerParameterError
from rl_cbf_clf_controller.parameters import load_parameters as load_controller
from rl_cbf_clf_controller.uncertainty import RL_CLF_QP
from rl_trainer.checkpoint import CHECKPOINT, DIGEST, Checkpoint, CheckpointError, checksum, journal_path
from rl_trainer.learning_thread import LearningThread
from rl_trainer.parameters import TrainingParameters
from rl_trainer.training import Trainer
from rl_trainer.transitions import Doubt, Transition
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from safetensors.numpy import load, save
from untrained_policy import policy_file, policy_metadata

TINY = TrainingParameters(problem=RL_CLF_QP, hidden1=3, hidden2=2, batch=2, capacity=10)


@dataclass(frozen=True)
class Kind:
    """`sound`: names and bytes of the files. `reads` raises nothing but `errors`; `seal` mends what sums to a file."""

    sound: tuple[tuple[str, bytes], ...]
    reads: Callable[[Path], Any]
    errors: tuple[type[Exception], ...]
    seal: Callable[[bytes], bytes] | None = None


# Trainer


def transition(tick: int) -> Transition:
    """One of no particular value."""
    rng = np.random.default_rng(tick)
    vectors = {name: rng.standard_normal(4) for name in ("LgV", "mu", "mu_qp", "next_LgV", "next_mu")}
    values = {name: rng.standard_normal(1) for name in ("beta", "nominal", "measured")}
    observations = {name: rng.standard_normal(14) for name in ("observation", "next_observation")}
    alpha, about = rng.standard_normal((1, 4)), {"failed": False, "doubt": Doubt.NONE, "step_index": 0}
    return Transition(problem=TINY.problem, tick=tick, alpha=alpha, **about, **vectors, **values, **observations)


def kept_files() -> tuple[bytes, bytes]:
    """A sound checkpoint and journal."""
    with tempfile.TemporaryDirectory() as folder:
        trainer = Trainer(TINY)
        kept = Checkpoint(Path(folder), trainer)
        kept.begin()
        for tick in range(3):
            kept.append(trainer.take(transition(tick)) or transition(tick))
        journal = journal_path(Path(folder), 0).read_bytes()
        kept.save()
        return (Path(folder) / CHECKPOINT).read_bytes(), journal


def go_on(path: Path) -> None:
    """As a trainer does that is started again."""
    learning = LearningThread(Trainer(TINY), Silent(), folder=path.parent)
    try:
        learning.take_up(0)
    finally:
        learning.close()


class Silent:
    """Hears of nothing."""

    def on_plan(self, plan: Any, after: int, report: Any) -> None: ...

    def on_transition(self, transition: Any, tag: Any) -> None: ...


def with_digest(data: bytes) -> bytes:
    """A checkpoint whose checksums are those of its content."""
    content = with_crcs(data[DIGEST:])
    return hashlib.sha256(content).digest() + content


def with_crcs(data: bytes) -> bytes:
    """A zip archive of the same members, not compressed, with the checksums of what is in them."""
    out = io.BytesIO()
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive, zipfile.ZipFile(out, "w") as sealed:
            for member in archive.infolist():
                begin = member.header_offset + 30
                begin += sum(int.from_bytes(data[begin - k : begin - k + 2], "little") for k in (4, 2))
                sealed.writestr(member.filename, data[begin : begin + member.compress_size])
    except Exception:  # whatever is wrong with it: it stays as it is
        return data
    return out.getvalue()


def with_hash(data: bytes) -> bytes:
    """A policy file whose hash is that of its content, where it has one."""
    try:
        header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])
        about = weights.PolicyMetadata.model_validate(json.loads(header["__metadata__"]["rabbit_policy"])["metadata"])
        arrays = load(data)
        digest = hashlib.sha256(about.model_dump_json(exclude_none=True).encode())
        for name in sorted(arrays):
            digest.update(name.encode() + arrays[name].tobytes())
        head = json.dumps({"content_hash": digest.hexdigest(), "metadata": about.model_dump(mode="json")})
        return bytes(save(arrays, metadata={"rabbit_policy": head}))
    except Exception:  # whatever is wrong with it: it stays as it is
        return data


def mended(data: bytes) -> bytes:
    """A journal whose lines have the checksums of what is in them."""
    lines = [line.partition(b" ")[2] for line in data.split(b"\n") if line]
    return b"".join(b"\n%s %s\n" % (checksum(text, TINY.key), text) for text in lines)


# Recordings


def recorded(folder: Path, walk: Walk, form: str) -> bytes:
    """The walk's recording as one file: `mcap`, `sqlite3`, or `zstd`, MCAP with compressed chunks."""
    storage = StoragePlugin.SQLITE3 if form == "sqlite3" else StoragePlugin.MCAP
    writer = Writer(folder, version=9, storage_plugin=storage)
    if form == "zstd":
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        topics = {t: writer.add_connection(f"/{t}", f"rabbit_msgs/msg/{k}", typestore=TYPES) for t, k in TOPICS.items()}
        for topic, tick, message in told(walk):
            data = bytes(TYPES.serialize_cdr(message, f"rabbit_msgs/msg/{TOPICS[topic]}"))
            writer.write(topics[topic], tick * TICK_NS, data)
    (file,) = (each for each in folder.iterdir() if each.suffix in (".mcap", ".db3"))
    return file.read_bytes()


def without_checksums(data: bytes) -> bytes:
    """An MCAP file whose chunks have no checksum, as MCAP allows: so what is changed in one is read."""
    found, at = bytearray(data), 8
    while at + 9 <= len(found):
        if found[at] == 0x06:
            found[at + 33 : at + 37] = bytes(4)[: max(0, len(found) - at - 33)]
        at += 9 + int.from_bytes(found[at + 1 : at + 9], "little")
    return bytes(found)


def use_recording(path: Path) -> None:
    """As `rabbit bag info` does, and another command, which its bytes choose; each may refuse it."""
    others: tuple[Callable[[Path], Any], ...] = (
        lambda bag: list(iterate_episodes(bag)),
        lambda bag: list(check_episodes(bag)),
        lambda bag: recover(bag, bag.parent / "recovered"),
        lambda bag: fill(Broadcast(), records_of(bag), "bag"),
        every_message,
    )
    with contextlib.suppress(RecordingError, RecordsError):
        others[zlib.crc32(path.read_bytes()) % len(others)](path)
    contents(path)


def every_message(path: Path) -> None:
    """Read them, as `rabbit bag play` does."""
    with opened(path) as reader, one_line_errors(path):
        for _ in reader.messages():
            pass


# Tables and results


def evaluation(path: Path) -> None:
    """As `rabbit evaluate` that goes on."""
    ResultsFolder(path.parent, {"key": "a", "made_with": {}})


def cached(path: Path) -> Any:
    """A result of the cache, which is made again where it cannot be read."""
    return training_job(TINY).read(path)


# All


def kinds(walk: Walk) -> dict[str, Kind]:
    """All kinds by name."""
    tiny = policy_file(policy_metadata(RL_CLF_QP, hidden=(3, 2)), lambda shape: np.full(shape, 0.1))
    shipped = next(weights.SHIPPED.glob("*.safetensors"))
    gait = (GAITS / "authors_035.yaml").read_bytes()
    one = yaml.safe_load(gait)
    library = {
        "name": "two",
        "start_length": one["step_length"],
        "gaits": [{**one, "metadata": {}}, {**one, "step_length": 0.5, "metadata": {}}],
    }
    course = {"stones": [{"l_min": 0.35, "l_max": 0.4}, {"l_min": 0.36}]}
    checkpoint, journal = kept_files()
    rival = (model_file.SHIPPED / "gp-socp-flat.safetensors").read_bytes()
    with tempfile.TemporaryDirectory() as folder:
        for form in ("mcap", "zstd", "sqlite3"):
            RECORDED[form] = recorded(Path(folder) / form, walk, form)
        about = about_walk(walk.parameters, SimulationParameters(stones=2), "zero", 1, "walked")
        save_records(WalkRecords.from_ticks(walk.records, walk.landings, about), Path(folder) / "records.npz")
        records = (Path(folder) / "records.npz").read_bytes()
    report = {"commit": "a", "episodes": [{"kept": 3}]}
    log = "\n".join(COMMITTED.read_text(encoding="utf-8").splitlines()[:6]).encode()
    return {
        "policy": Kind(
            (("tiny.safetensors", tiny.encode()), ("policy.safetensors", shipped.read_bytes())),
            weights.read,
            (weights.PolicyFileError,),
            with_hash,
        ),
        "model": Kind(
            (("model.safetensors", rival),), lambda p: model_file.read(p, GpAbout), (weights.PolicyFileError,)
        ),
        "gait": Kind((("gait.yaml", gait), ("library.yaml", dump_yaml(library).encode())), load_gaits, (GaitError,)),
        "course": Kind(
            (("course.yaml", dump_yaml(course).encode()), ("course.csv", b"l_min,l_max\n0.35,0.40\n0.36,0.41\n")),
            lambda p: read_course(p, 2, 0.05),
            (CourseError,),
        ),
        "controller parameters": Kind(
            (
                ("parameters.yaml", (CONFIG / "authors.yaml").read_bytes()),
                ("best.yaml", (CONFIG / "best.yaml").read_bytes()),
            ),
            load_controller,
            (ControllerParameterError,),
        ),
        "recording": Kind(
            (("bag.mcap", RECORDED["mcap"]), ("bag.mcap", RECORDED["zstd"])),
            use_recording,
            (RecordingError, RecordsError),
            without_checksums,
        ),
        "database": Kind((("bag.db3", RECORDED["sqlite3"]),), use_recording, (RecordingError, RecordsError)),
        "journal": Kind(((journal_path(Path(), 0).name, journal),), go_on, (CheckpointError,), mended),
        "checkpoint": Kind(((CHECKPOINT, checkpoint),), go_on, (CheckpointError,), with_digest),
        "records": Kind(
            (("records.npz", stored(records)), ("records.npz", records)),
            lambda p: fill(Broadcast(), load_records(p), "run"),
            (RecordsError,),
            with_crcs,
        ),
        "memory": Kind((("memory", memory()),), RestartFile, (RestartFileError,)),
        "table": Kind((("log.csv", log),), lambda p: read_rows(p, Episode), (ValueError,)),
        "misses": Kind(
            (("best.json", Path(misses.__file__).with_name("best.json").read_bytes()),),
            misses.MissProbability.load,
            (misses.MissModelError,),
        ),
        "evaluation": Kind(
            ((ABOUT, json.dumps({"key": "a", "made_with": {"numpy": "2"}}).encode()),), evaluation, (ResultsError,)
        ),
        "cached result": Kind(
            (("result.json.gz", gzip.compress(json.dumps(report).encode())),), cached, (ValueError,), regzipped
        ),
    }


RECORDED: dict[str, bytes] = {}


def stored(data: bytes) -> bytes:
    """An archive's members, not compressed."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as archive, zipfile.ZipFile(out, "w") as plain:
        for member in archive.infolist():
            plain.writestr(member.filename, archive.read(member))
    return out.getvalue()


def memory() -> bytes:
    """A simulator's, as it stands at the start."""
    with tempfile.TemporaryDirectory() as folder:
        RestartFile(Path(folder) / "memory")
        return (Path(folder) / "memory").read_bytes()


def regzipped(data: bytes) -> bytes:
    """The same, compressed again, where it can be read at all."""
    with contextlib.suppress(Exception):
        return gzip.compress(gzip.GzipFile(fileobj=io.BytesIO(data)).read())
    return gzip.compress(data)

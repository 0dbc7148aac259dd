"""Hostile files of every kind: each is read, or refused in its one line, within a second and 500 MB.

    python qa/test/hostile_files.py --cases 20000 --seed 1 --processes 2

A case is a sound file with bits flipped, cut, spliced, with other numbers in it, or a bomb. It is drawn from the seed
and its number alone: `--only N` reads case N again. What is measured is CPU time, and how much the largest resident
memory grows. The exit code is 1 where a case raised another error, took too much, or its refusal was too long.
"""

import argparse
import io
import logging
import multiprocessing
import re
import shutil
import signal
import struct
import sys
import tempfile
import time
import traceback
import warnings
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from types import FrameType

sys.path.append(str(Path(__file__).resolve().parents[2] / "tests/shared"))
sys.path.append(str(Path(__file__).resolve().parents[2] / "ros2_ws/src/rabbit_recording/test"))
sys.path.append(str(Path(__file__).resolve().parents[2] / "ros2_ws/src/rl_cbf_clf_controller/test"))

import numpy as np
import torch
from file_kinds import Kind, kinds
from rabbit_description.gait import load_gait
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Simulation
from recorded_walk import SEED, Walk
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_trainer.rollout import Record, rollout

MOST_SECONDS, MOST_BYTES, LONGEST = 1.0, 500_000_000, 5000
HANGS = 60  # s, wall clock
TICKS = 12  # of the walk that is recorded
NUMBER = re.compile(rb"[-+]?[0-9]+(\.[0-9]+)?(e[-+]?[0-9]+)?")
NUMBERS = (
    *(b"nan", b".nan", b"inf", b"-.inf", b"1e39", b"-1e300", b"1e999", b"1e-320", b"-1", b"0", b"-0.0", b"4294967296"),
    *(b"0200", b"3:20", b"1_0", b"0x10", b"yes", b"null", b"true", b"~", b'""', b"[]", b"{}", b"[1, [2, [3]]]", b"'"),
    *(
        b"&a 1",
        b"*a",
        b"!!python/name:os.system 1",
        b"9" * 25,
        b"9" * 5000,
        b"1" * 100_000,
        b"\xf0\x9f\x98\x80",
        b"\xff",
    ),
    *("\u0663 \u202e \u2028".encode(), b"\0", b"|", b"{a: &b [*b]}"),
)
WORDS = (2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**64 - 1, 10**6, 10**9, 0, 1)
Rng = np.random.Generator


class TooSlow(BaseException):
    """Raised by the alarm; no reader may catch it."""


def flipped(data: bytearray, rng: Rng) -> None:
    """A few bits."""
    for at in rng.integers(0, max(len(data), 1), rng.integers(1, 4)).tolist():
        if data:
            data[at] ^= 1 << int(rng.integers(8))


def cut(data: bytearray, rng: Rng) -> None:
    """The end."""
    del data[int(rng.integers(0, len(data) + 1)) :]


def spliced(data: bytearray, rng: Rng) -> None:
    """A part taken out, or put elsewhere, perhaps many times."""
    begin, at = (int(rng.integers(0, len(data) + 1)) for _ in range(2))
    part = bytes(data[begin : begin + int(rng.integers(1, 200))])
    if rng.random() < 0.3:
        del data[begin : begin + len(part)]
    else:
        data[at:at] = part * int(rng.choice([1, 1, 2, 50, 1000]))


def overwritten(data: bytearray, rng: Rng) -> None:
    """A part, with zeros, ones or noise."""
    at, size = int(rng.integers(0, len(data) + 1)), int(rng.integers(1, 64))
    size = min(size, len(data) - at)
    data[at : at + size] = (bytes(size), b"\xff" * size, rng.bytes(size))[int(rng.integers(3))]


def other_numbers(data: bytearray, rng: Rng) -> None:
    """Some of a text's."""
    found = list(NUMBER.finditer(bytes(data[:200_000])))
    if found:
        for match in sorted({int(i) for i in rng.integers(0, len(found), rng.choice([1, 1, 3]))}, reverse=True):
            data[found[match].start() : found[match].end()] = NUMBERS[int(rng.integers(len(NUMBERS)))]


def other_words(data: bytearray, rng: Rng) -> None:
    """Some integers of 4 or 8 bytes, or floats, as in binary files."""
    for _ in range(int(rng.integers(1, 4))):
        at, word = int(rng.integers(0, len(data) + 1)), WORDS[int(rng.integers(len(WORDS)))]
        if rng.random() < 0.3:
            new = struct.pack("<d", float(rng.choice([np.nan, np.inf, -np.inf, 1e39, -1e300, 5e-324])))
        else:
            new = word.to_bytes(8, "little")[: int(rng.choice([4, 8]))]
        data[at : at + len(new)] = new


CHANGES: tuple[Callable[[bytearray, Rng], None], ...] = (
    *(flipped, cut, spliced, overwritten),
    *(other_numbers, other_numbers, other_words, other_words),
)


def anchors(rng: Rng) -> bytes:
    """Nine to the ninth from a thousand bytes."""
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 10)]
    return "\n".join(lines).encode()


def zipped(rng: Rng) -> bytes:
    """An npz file, or what torch would read, of a gigabyte of zeros."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("q.npy", "nominal_b.npy", "about.npy", "archive/data.pkl", "archive/data/0", "archive/version"):
            with archive.open(name, "w", force_zip64=True) as member:
                for _ in range(int(rng.choice([1, 300]))):
                    member.write(bytes(1_000_000))
    return stream.getvalue()


def claimed(rng: Rng) -> bytes:
    """An npz file whose array claims to have 8 TB."""
    stream = io.BytesIO()
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }"
    header += b" " * (-(len(header) + 11) % 64) + b"\n"
    with zipfile.ZipFile(stream, "w") as archive:
        for name in ("q", "nominal_b", "about"):
            archive.writestr(f"{name}.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header)
    return stream.getvalue()


def safetensors(rng: Rng) -> bytes:
    """A header that claims much."""
    header = b'{"__metadata__": {"rabbit_policy": "' + b"[" * 3000 + b'"}, "a": {"dtype": "F32", "shape": '
    header += b'[4294967295, 4294967295], "data_offsets": [0, 4]}}'
    size = int(rng.choice([len(header), 2**40, 2**63]))
    return struct.pack("<Q", size) + header


BOMBS: tuple[Callable[[Rng], bytes], ...] = (
    *(anchors, zipped, claimed, safetensors),
    lambda rng: b"[" * int(rng.choice([100, 3000, 100_000])),
    lambda rng: b'{"a":' * int(rng.choice([100, 3000, 50_000])),
    lambda rng: b"- " * 100_000,
    lambda rng: b"".join(b"k%d: 1\n" % i for i in range(int(rng.choice([3000, 20_000, 300_000])))),
    lambda rng: b"stones:\n" + b"- {l_min: x, l_max: []}\n" * int(rng.choice([100, 9000])),
    lambda rng: b"gaits: [" + b"{}," * int(rng.choice([100, 80_000])) + b"]",
    lambda rng: b"a" * int(rng.choice([1000, 240_000, 5_000_000])),
    lambda rng: b"? " * 100_000,
    lambda rng: b'"' + b"\\U0001F600" * 20_000 + b'"',
    lambda rng: b"l_min,l_max\n" + b"0.3,0.4,0.5\n" * 15_000,
    lambda rng: b"a," * 100_000 + b"\n" + b"1," * 20_000,
    lambda rng: gz(300_000_000 if rng.random() < 0.3 else 1_000_000),
    lambda rng: rng.bytes(int(rng.choice([0, 1, 100, 100_000]))),
)


def gz(size: int) -> bytes:
    """So many zeros."""
    stream = zlib.compressobj(wbits=31)
    return b"".join([*(stream.compress(bytes(1_000_000)) for _ in range(size // 1_000_000)), stream.flush()])


def drawn(kind: Kind, rng: Rng) -> tuple[str, bytes]:
    """Name and bytes of a hostile file."""
    name, sound = kind.sound[int(rng.integers(len(kind.sound)))]
    if rng.random() < 0.08:
        return name, BOMBS[int(rng.integers(len(BOMBS)))](rng)
    data = bytearray(sound)
    if kind.seal and rng.random() < 0.7:
        data = bytearray(kind.seal(bytes(data)))
    for _ in range(int(rng.choice([1, 1, 1, 2, 3]))):
        CHANGES[int(rng.integers(len(CHANGES)))](data, rng)
    if len(data) > 20_000_000:
        del data[20_000_000:]
    return name, kind.seal(bytes(data)) if kind.seal and rng.random() < 0.7 else bytes(data)


def walked() -> Walk:
    """The first ticks of a walk."""
    parameters = ControllerParameters(sigma=1.0)
    gait = load_gait(parameters.gait)
    simulation, records = Simulation(SimulationParameters(stones=1), gait), list[Record]()
    rollout(simulation, Controller(parameters, gait, ZeroPolicy(parameters.problem)), SEED, records.append)
    simulation.close()
    return Walk(parameters, records[:TICKS], [])


def resident(field: str) -> int:
    """Bytes: `VmRSS` now, or `VmHWM`, the most since it was last reset."""
    (line,) = (line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith(field))
    return int(line.split()[1]) * 1024


def on_alarm(_signal: int, _frame: FrameType | None) -> None:
    raise TooSlow


def read(kind: Kind, name: str, data: bytes) -> tuple[str, float, int]:
    """What is wrong with how a file is read, else an empty text, or `refused`; CPU seconds, and bytes of memory."""
    folder = Path(tempfile.mkdtemp(prefix="hostile-"))
    path = folder / name
    path.write_bytes(data)
    Path("/proc/self/clear_refs").write_text("5")
    before, begin, said = resident("VmRSS"), time.process_time(), ""
    signal.alarm(HANGS)
    try:
        kind.reads(path)
    except kind.errors as error:
        said = "refused" if len(str(error)) <= LONGEST else f"a refusal of {len(str(error))} characters"
    except (Exception, TooSlow):
        said = traceback.format_exc(limit=-6)
    finally:
        signal.alarm(0)
    seconds, grown = time.process_time() - begin, resident("VmHWM") - before
    shutil.rmtree(folder)
    if seconds > MOST_SECONDS:
        said = f"{seconds:.2f} s; {said}"
    if grown > MOST_BYTES:
        said = f"{grown / 1e6:.0f} MB; {said}"
    return said, seconds, grown


def case_of(seed: int, names: Sequence[str], case: int) -> tuple[int, str, str, float, int]:
    """A case's number and kind, and what `read` says of it."""
    name = names[case % len(names)]
    return case, name, *read(EVERY[name], *drawn(EVERY[name], np.random.default_rng((seed, case))))


EVERY: dict[str, Kind] = {}


def main() -> int:
    """The campaign."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--only", type=int, help="this case alone")
    asked = parser.parse_args()
    torch.set_num_threads(1)
    logging.disable()
    warnings.simplefilter("ignore")
    signal.signal(signal.SIGALRM, on_alarm)
    EVERY.update(kinds(walked()))
    for name, kind in EVERY.items():
        for file, data in kind.sound:
            if said := read(kind, file, data)[0]:
                print(f"sound {name} {file}: {said}")
                return 1
    worst: dict[str, tuple[float, int]] = dict.fromkeys(EVERY, (0.0, 0))
    counts: Counter[tuple[str, str]] = Counter()
    wrong = 0
    numbers = range(asked.cases) if asked.only is None else [asked.only]
    draw = partial(case_of, asked.seed, tuple(EVERY))
    with ProcessPoolExecutor(asked.processes, multiprocessing.get_context("fork")) as pool:
        for case, name, said, seconds, grown in pool.map(draw, numbers, chunksize=10):
            is_right = said in ("", "refused")
            counts[name, said if is_right else "wrong"] += 1
            worst[name] = max(worst[name][0], seconds), max(worst[name][1], grown)
            if case % 1000 == 999:
                print(f"{case + 1} cases", file=sys.stderr, flush=True)
            if not is_right:
                wrong += 1
                print(f"case {case}, {name}: {said}", flush=True)
    for name, (seconds, grown) in worst.items():
        taken, refused, bad = (counts[name, key] for key in ("", "refused", "wrong"))
        print(f"{name}: {taken} taken, {refused} refused, {bad} wrong; at most {seconds:.2f} s, {grown / 1e6:.0f} MB")
    print(f"{sum(counts.values())} cases, seed {asked.seed}: {wrong} wrong")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())

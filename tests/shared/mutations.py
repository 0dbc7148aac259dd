"""Changes of a sound file: bits, cuts, copies, other numbers; and small files that would take much time or memory."""

import gzip
import io
import re
import struct
import zipfile
from collections.abc import Callable

import numpy as np

Rng = np.random.Generator
NUMBER = re.compile(rb"[-+]?[0-9]+(\.[0-9]+)?(e[-+]?[0-9]+)?")
NUMBERS = (
    *(b"nan", b".nan", b"inf", b"-.inf", b"1e39", b"-1e300", b"1e-320", b"-1", b"0", b"4294967296", b"0200", b"3:20"),
    *(b"yes", b"null", b"~", b'""', b"[]", b"{}", b"[1, [2, [3]]]", b"&a 1", b"*a", b"!!python/name:os.system 1"),
    *(b"9" * 5000, b"1" * 100_000, b"\xf0\x9f\x98\x80", b"\xff", b"\0", b"|", b"'", "\u0663 \u202e \u2028".encode()),
)
WORDS = (2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**64 - 1, 10**6, 10**9, 0, 1)
FLOATS = (np.nan, np.inf, -np.inf, 1e39, -1e300, 5e-324)


def flipped(data: bytearray, rng: Rng) -> None:
    """A bit."""
    if data:
        data[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))


def cut(data: bytearray, rng: Rng) -> None:
    """The end."""
    del data[int(rng.integers(0, len(data) + 1)) :]


def spliced(data: bytearray, rng: Rng) -> None:
    """A part is taken out, put elsewhere, perhaps many times, or replaced by noise."""
    begin, at = (int(rng.integers(0, len(data) + 1)) for _ in range(2))
    part = bytes(data[begin : begin + int(rng.integers(1, 200))])
    match rng.integers(3):
        case 0:
            del data[begin : begin + len(part)]
        case 1:
            data[at:at] = part * int(rng.choice([1, 2, 50, 1000]))
        case _:
            data[begin : begin + len(part)] = rng.bytes(len(part))


def other_number(data: bytearray, rng: Rng) -> None:
    """One of a text's."""
    found = list(NUMBER.finditer(bytes(data[:200_000])))
    if found:
        match = found[rng.integers(len(found))]
        data[match.start() : match.end()] = NUMBERS[rng.integers(len(NUMBERS))]


def other_word(data: bytearray, rng: Rng) -> None:
    """An integer of 4 or 8 bytes, or a float, as in binary files."""
    at, size = int(rng.integers(0, len(data) + 1)), int(rng.choice([4, 8]))
    integer = WORDS[rng.integers(len(WORDS))].to_bytes(8, "little")[:size]
    new = struct.pack("<d", FLOATS[rng.integers(len(FLOATS))]) if rng.random() < 0.3 else integer
    data[at : at + len(new)] = new


CHANGES: tuple[Callable[[bytearray, Rng], None], ...] = (flipped, cut, spliced, other_number, other_word)


def mutated(sound: bytes, rng: Rng) -> bytes:
    """With one to three changes."""
    data = bytearray(sound)
    for _ in range(int(rng.choice([1, 1, 2, 3]))):
        CHANGES[rng.integers(len(CHANGES))](data, rng)
    return bytes(data)


def archive(content: bytes) -> bytes:
    """An npz file, or what torch would read, of members with this content."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as file:
        for name in ("q.npy", "about.npy", "archive/data.pkl", "archive/data/0", "archive/version"):
            file.writestr(name, content)
    return stream.getvalue()


ARRAY = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }".ljust(117) + b"\n"
HEADER = b'{"__metadata__": {"rabbit_policy": "' + b"[" * 3000 + b'"}, "a": {"dtype": "F32", "shape": '
HEADER += b'[4294967295, 4294967295], "data_offsets": [0, 4]}}'
ANCHORS = [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 10)]
BOMBS = {
    "anchors": "\n".join(["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]", *ANCHORS]).encode(),
    "zeros in an archive": archive(bytes(300_000_000)),
    "an array of 8 TB": archive(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(ARRAY)) + ARRAY),
    "a tensor of 2^64 numbers": struct.pack("<Q", len(HEADER)) + HEADER,
    "a header of 2^63 bytes": struct.pack("<Q", 2**63) + HEADER,
    "a header alone": struct.pack("<Q", 21) + b'{"__metadata__":null}',
    "zeros in gzip": gzip.compress(bytes(300_000_000)),
    "brackets": b"[" * 100_000,
    "nested names": b'{"a":' * 50_000,
    "dashes": b"- " * 100_000,
    "names": b"".join(b"k%d: 1\n" % i for i in range(300_000)),
    "wrong stones": b"stones:\n" + b"- {l_min: x, l_max: []}\n" * 9000,
    "empty gaits": b"gaits: [" + b"{}," * 80_000 + b"]",
    "a long word": b"a" * 5_000_000,
    "escapes": b'"' + b"\\U0001F600" * 20_000 + b'"',
    "many rows": b"l_min,l_max\n" + b"0.3,0.4,0.5\n" * 15_000,
    "many columns": b"a," * 100_000 + b"\n" + b"1," * 20_000,
    "nothing": b"",
}

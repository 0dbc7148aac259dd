"""Messages as the bytes that travel (CDR, little endian), made without rclpy's message objects.

rclpy checks and converts each field of a message in Python, which for a large one takes longer than the tick that it
reports. `Encoder(RabbitState)` makes the same bytes from any object with the message's fields; its arrays go from numpy
into the bytes as a whole.
"""

import re
import struct
from collections.abc import Iterator
from functools import lru_cache
from importlib import import_module
from operator import attrgetter
from typing import Any, Protocol

import numpy as np

HEADER = b"\x00\x01\x00\x00"  # little endian, no options
WORD = 8  # bytes; no number is aligned to more
_TYPES = {"boolean": "?", "octet": "u1", "uint8": "u1", "int8": "i1", "uint16": "<u2", "int16": "<i2", "uint32": "<u4"}
_TYPES |= {"int32": "<i4", "uint64": "<u8", "int64": "<i8", "float": "<f4", "double": "<f8"}
_OTHER, _ARRAY = re.compile(r"(\w+)/(\w+)"), re.compile(r"(\w+)\[(\d+)\]")
_SEQUENCE, _TEXT = re.compile(r"sequence<(.+?)(?:, (\d+))?>"), re.compile(r"string(?:<(\d+)>)?")
_LENGTH = struct.Struct("<I")
_ANY = 2**32 - 2  # the most of what is not bounded


class CdrError(ValueError):
    """A value that does not fit its field."""


class Encoder:
    """The fields of one kind of message, which may hold others, but no sequence of others."""

    def __init__(self, kind: Any) -> None:
        """Raises `CdrError` for a kind with a field that is not known here."""
        self._parts = list(_parts(_leaves(kind)))

    def encode(self, message: Any) -> bytes:
        """The bytes of a message; raises `CdrError` for a value that does not fit its field."""
        out = bytearray()
        try:
            for part in self._parts:
                part.write(out, message)
        except (struct.error, OverflowError, TypeError, ValueError) as error:
            raise CdrError(str(error)) from error
        return HEADER + bytes(out)


class _Part(Protocol):
    """Fields that are written together."""

    def write(self, out: bytearray, message: Any) -> None: ...


class _Block:
    """Consecutive fields of a fixed size: one structured array, filled in place."""

    def __init__(self, fields: list[tuple[str, str, int | None]]) -> None:
        """Name, type and, of an array, length."""
        self._names = [name for name, _, _ in fields]
        self._get = attrgetter(*self._names)
        # how they lie depends on where they begin
        self._buffers = [np.zeros((), _layout(fields, start)) for start in range(WORD)]
        self._views = [[buffer[name] for name in self._names] for buffer in self._buffers]
        self._lengths = [(i, length) for i, (_, _, length) in enumerate(fields) if length is not None]

    def write(self, out: bytearray, message: Any) -> None:
        start = len(out) % WORD
        values = self._get(message) if len(self._names) > 1 else (self._get(message),)
        for i, length in self._lengths:
            if len(values[i]) != length:
                raise CdrError(f"{self._names[i]} has {len(values[i])} values; expected {length}")
        for view, value in zip(self._views[start], values, strict=True):
            view[...] = value
        out += self._buffers[start].tobytes()


class _Sequence:
    """Numbers, `most` of them or fewer."""

    def __init__(self, name: str, type_: str, most: int) -> None:
        self._name, self._type, self._most = name, np.dtype(type_), most
        self._get = attrgetter(name)

    def write(self, out: bytearray, message: Any) -> None:
        values = np.asarray(self._get(message), self._type)
        _write_length(out, values.size, self._most, self._name)
        if values.size:
            out += bytes(-len(out) % self._type.itemsize)
            out += values.tobytes()


class _Text:
    """A text of `most` characters at most, or a sequence of `texts` of these at most."""

    def __init__(self, name: str, most: int, texts: int | None = None) -> None:
        self._name, self._most, self._texts = name, most, texts
        self._get = attrgetter(name)

    def write(self, out: bytearray, message: Any) -> None:
        value = self._get(message)
        if self._texts is not None:
            _write_length(out, len(value), self._texts, self._name)
        for text in (value,) if self._texts is None else value:
            if len(text) > self._most or "\0" in text:
                raise CdrError(f"{self._name} {text!r}: expected at most {self._most} characters, none of them 0")
            out += bytes(-len(out) % _LENGTH.size)
            out += _text_bytes(text)


def _leaves(kind: Any, above: str = "") -> Iterator[tuple[str, str]]:
    """Names and types of a message's fields, those of messages in it by names as `stamp.sec`."""
    for name, type_ in kind.get_fields_and_field_types().items():
        if other := _OTHER.fullmatch(type_):
            yield from _leaves(getattr(import_module(f"{other[1]}.msg"), other[2]), f"{above}{name}.")
        else:
            yield above + name, type_


def _parts(leaves: Iterator[tuple[str, str]]) -> Iterator[_Part]:
    """The fields, those of a fixed size together."""
    fixed: list[tuple[str, str, int | None]] = []
    for name, type_ in leaves:
        array, sequence = _ARRAY.fullmatch(type_), _SEQUENCE.fullmatch(type_)
        value = array[1] if array else sequence[1] if sequence else type_
        most = int(sequence[2] or _ANY) if sequence else None
        number, text = _TYPES.get(value), _TEXT.fullmatch(value)
        if number and most is None:
            fixed.append((name, number, int(array[2]) if array else None))
            continue
        if fixed:
            yield _Block(fixed)
            fixed = []
        if number and most is not None:
            yield _Sequence(name, number, most)
        elif text and not array:
            yield _Text(name, int(text[1] or _ANY), most)
        else:
            raise CdrError(f"{name}: a field of type {type_} is not known here")
    if fixed:
        yield _Block(fixed)


def _layout(fields: list[tuple[str, str, int | None]], start: int) -> np.dtype[Any]:
    """Of fields that begin `start` bytes after a word does: each is aligned to the size of its numbers."""
    formats: list[Any] = []
    offsets, at = [], start
    for _, name, length in fields:
        type_ = np.dtype(name)
        at += -at % type_.itemsize
        formats.append(type_ if length is None else (type_, (length,)))
        offsets.append(at - start)
        at += type_.itemsize * (1 if length is None else length)
    names = [name for name, _, _ in fields]
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": at - start})


@lru_cache(maxsize=256)
def _text_bytes(text: str) -> bytes:
    """With its length before and 0 behind; most of the texts in a tick's messages are those of the last tick."""
    data = text.encode()
    return _LENGTH.pack(len(data) + 1) + data + b"\0"


def _write_length(out: bytearray, length: int, most: int, name: str) -> None:
    if length > most:
        raise CdrError(f"{name} has {length}; expected at most {most}")
    out += bytes(-len(out) % _LENGTH.size)
    out += _LENGTH.pack(length)

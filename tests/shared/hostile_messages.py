"""Messages and requests of any type that a stranger may send: made of the type's own definition, or of a sound one."""

import random
from importlib import import_module
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from rosidl_parser.definition import AbstractGenericString, AbstractSequence, Array, BasicType, NamespacedType

HEADER = 4  # bytes before a message's own
LONGEST = 40  # of a sequence
FLOATS = (0.0, -0.0, 1.0, -1.0, 0.01, 1e-320, 1e9, -1e154, 1e154, 1.7e308, -1.7e308, np.nan, np.inf, -np.inf)
WORDS = (
    *("", "zero", "/", "nope", "a" * 128, "x" * 4000, "\n", "%s{}", "é", "\x00"),
    *("controller", "sigma", "pace", "/simulator"),
)
SEQUENCES = {"float": np.float32, "double": np.float64}


def type_named(name: str) -> Any:
    """The class of a message or service, as in `std_msgs/msg/Header`."""
    package, folder, kind = name.split("/")
    return getattr(import_module(f"{package}.{folder}"), kind)


def hostile(rng: random.Random, kind: Any, sound: bytes = b"") -> bytes:
    """Bytes on a topic of this kind; `sound`: a message that was heard there."""
    how = rng.choice(("made", "fields", "bytes", "cut", "again", "noise"))
    if how == "noise":
        return rng.randbytes(rng.randrange(80))
    message = kind()
    if sound and how != "made":
        message = deserialize_message(sound, kind)
    spoil(rng, message, 1.0 if how == "made" or not sound else 0.25 * (how == "fields"))
    data = bytearray(serialize_message(message))
    if how == "bytes":
        for _ in range(rng.randint(1, 6)):
            data[rng.randrange(HEADER, len(data))] = rng.randrange(256)
    return bytes(data[: rng.randrange(len(data))] if how == "cut" else data)


def hostile_request(rng: random.Random, kind: Any) -> Any:
    """A request of this kind of service: the middleware hands on typed ones alone."""
    request = kind.Request()
    spoil(rng, request, rng.choice((0.3, 1.0)))
    return request


def spoil(rng: random.Random, message: Any, share: float) -> None:
    """Set so large a share of the fields, also within the parts, to anything that their types can hold."""
    for name, kind in zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True):
        if isinstance(kind, NamespacedType):
            spoil(rng, getattr(message, name), share)
        elif rng.random() < share:
            setattr(message, name, anything(rng, kind))


def anything(rng: random.Random, kind: Any) -> Any:
    """A value of this type."""
    if isinstance(kind, BasicType):
        return number(rng, kind.typename)
    if isinstance(kind, AbstractGenericString):
        word = rng.choice(WORDS)
        return word[: kind.maximum_size] if kind.has_maximum_size() else word
    if isinstance(kind, NamespacedType):
        part = type_named("/".join(kind.namespaced_name()))()
        spoil(rng, part, 1.0)
        return part
    assert isinstance(kind, Array | AbstractSequence)
    size = kind.size if isinstance(kind, Array) else rng.choice((0, 1, 2, 4, 7, rng.randrange(LONGEST)))
    if not isinstance(kind, Array) and kind.has_maximum_size():
        size = min(size, kind.maximum_size)
    values = [anything(rng, kind.value_type) for _ in range(size)]
    if isinstance(kind.value_type, BasicType) and kind.value_type.typename == "octet":
        return values
    is_numeric = isinstance(kind, Array) and isinstance(kind.value_type, BasicType)
    return np.array(values, SEQUENCES.get(kind.value_type.typename)) if is_numeric and values else values


def number(rng: random.Random, kind: str) -> Any:
    """Of a basic type: a usual value, one at its ends, or any."""
    if kind == "boolean":
        return rng.random() < 0.5
    if kind == "octet":
        return bytes([rng.randrange(256)])
    if kind in SEQUENCES:
        value = rng.choice((*FLOATS, rng.uniform(-3, 3)))
        return float(np.float32(np.clip(value, -3e38, 3e38))) if kind == "float" else value
    bits = int("".join(filter(str.isdigit, kind)) or 8)
    low, high = (0, 2**bits - 1) if kind.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return rng.choice((0, 1, 2, 3, low, high, high - 1, rng.randint(low, high)))

"""Messages that do not belong: late, repeated, out of order, of another tick or episode, not finite, cut, garbled."""

import random
from array import array
from collections.abc import Mapping
from typing import Any

import numpy as np
from rabbit_common.ros.client import TOPIC
from rabbit_msgs.msg import TorqueCommand
from rclpy.serialization import deserialize_message, serialize_message

HEARD = {  # by the node that hears them
    "simulator": ("torque", "episode_plan"),
    "controller": ("state", "preview", "episode", "policy"),
    "trainer": ("state", "torque", "controller_state", "learner_terms", "episode"),
}
HEADER = 4  # bytes before a message's own


def wrong_message(rng: random.Random, node: str, newest: Mapping[str, bytes]) -> Any:
    """Topic and bytes, made of the newest that went over a topic that `node` hears; None if none did."""
    topics = [topic for topic in HEARD[node] if topic in newest]
    if not topics:
        return None
    topic = rng.choice(topics)
    make = rng.choice((repeated, cut, garbled, misplaced, not_finite))
    return topic, make(rng, newest[topic], TOPIC[topic].type)


def repeated(rng: random.Random, data: bytes, kind: Any) -> bytes:
    """The newest one again: late, or a second time."""
    return data


def cut(rng: random.Random, data: bytes, kind: Any) -> bytes:
    """Any beginning of it."""
    return data[: rng.randrange(len(data))]


def garbled(rng: random.Random, data: bytes, kind: Any) -> bytes:
    """With a few other bytes."""
    wrong = bytearray(data)
    for _ in range(rng.randint(1, 8)):
        wrong[rng.randrange(HEADER, len(wrong))] = rng.randrange(256)
    return bytes(wrong)


def misplaced(rng: random.Random, data: bytes, kind: Any) -> bytes:
    """Of another episode or tick."""
    message = deserialize_message(data, kind)
    for name in ("episode", "tick", "after_episode", "index"):
        if hasattr(message, name) and rng.random() < 0.7:
            setattr(message, name, max(0, getattr(message, name) + rng.choice((-1000, -2, -1, 1, 2, 1000))))
    return bytes(serialize_message(message))


def not_finite(rng: random.Random, data: bytes, kind: Any) -> bytes:
    """With NaN or infinity in one of its numbers."""
    message = deserialize_message(data, kind)
    wrong = rng.choice((np.nan, np.inf, -np.inf))
    fields = message.get_fields_and_field_types().items()
    names = [name for name, text in fields if text.startswith(("double", "sequence<double")) and name != "clf"]
    if not names:
        return cut(rng, data, kind)
    name = rng.choice(names)
    value = getattr(message, name)
    setattr(message, name, wrong if isinstance(value, float) else _spoiled(rng, value, wrong))
    if isinstance(message, TorqueCommand):
        message.fault = ""
    return bytes(serialize_message(message))


def _spoiled(rng: random.Random, values: Any, wrong: float) -> Any:
    numbers = np.array(values, dtype=float)
    if numbers.size:
        numbers[rng.randrange(numbers.size)] = wrong
    return array("d", numbers) if isinstance(values, array) else numbers

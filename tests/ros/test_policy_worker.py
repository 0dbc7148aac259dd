"""Whatever comes as a policy, by topic or by name, the thread that checks it answers, and takes the next good one."""

import json
import random
import time
from array import array
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from file_kinds import with_hash
from rabbit_msgs.msg import PolicyWeights
from rabbit_msgs.srv import LoadPolicy
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from rl_cbf_clf_controller.ros.node import ControllerNode
from rl_cbf_clf_controller.ros.policies import Policies
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP
from rl_cbf_clf_controller.weights import PolicyFile
from untrained_policy import policy_file, policy_metadata

SEGWAY = Path(__file__).parents[2] / "examples" / "segway.py"
HANGS = 60.0  # s: a guard, no bar
LEAVES: list[Any] = [
    *(
        None,
        True,
        0,
        -1,
        2**31,
        2**63,
        2**64,
        10**30,
        0.5,
        1e308,
        1e-320,
        float("nan"),
        float("inf"),
        "",
        "\ud800",
        "x",
    ),
    *(
        "a" * 300,
        "zero",
        [],
        [[]],
        {},
        {"": None},
        [None] * 70,
        "F32",
        "F64",
        "BF16",
        "F8_E4M3",
        "BOOL",
        [0, 0],
        [4, 0],
    ),
]
NAMES = (
    "",
    ".",
    "..",
    "/",
    "//",
    "~",
    "\0",
    "a\0b",
    "/dev/zero",
    "/dev/full",
    "/proc/self/mem",
    "/proc/kmsg",
    "\n",
    "ü",
    "%s",
)


def good(number: int) -> PolicyFile:
    """A small one, another for each number."""
    fill = np.random.default_rng(number).standard_normal
    return policy_file(policy_metadata(RL_CBF_CLF_QP, hidden=(4, 4), training_seed=number), fill)


GOOD = [good(number) for number in (1, 2)]


def mutated(rng: random.Random, data: bytes) -> bytes:
    """A policy file with another header, other metadata, or another body."""
    size = int.from_bytes(data[:8], "little")
    header, body = data[8 : 8 + size], data[8 + size :]
    how = rng.choice(("header", "metadata", "sealed", "bytes", "body", "length", "noise"))
    if how in ("header", "metadata", "sealed"):
        told = json.loads(header)
        if how == "header":
            told = replaced(rng, told)
        else:
            told["__metadata__"]["rabbit_policy"] = json.dumps(
                replaced(rng, json.loads(told["__metadata__"]["rabbit_policy"]))
            )
        header = json.dumps(told).encode()
        made = len(header).to_bytes(8, "little") + header + body
        return with_hash(made) if how == "sealed" else made
    if how == "length":
        return rng.choice((0, 1, size - 1, size + 1, 2**31, 2**63, 2**64 - 1)).to_bytes(8, "little") + header + body
    if how == "noise":
        return rng.randbytes(rng.randrange(60))
    wrong, first = bytearray(data), 8 + size * (how == "body")
    for _ in range(rng.randint(1, 5)):
        wrong[rng.randrange(first, len(wrong))] = rng.randrange(256)
    return bytes(wrong[: rng.randrange(len(wrong))] if rng.random() < 0.2 else wrong)


def replaced(rng: random.Random, told: Any) -> Any:
    """What JSON holds, with another value, name or nesting somewhere in it."""
    if not isinstance(told, dict | list) or not told or rng.random() < 0.15:
        return rng.choice(LEAVES)
    place = rng.choice(list(told) if isinstance(told, dict) else range(len(told)))
    value = replaced(rng, told[place])
    if isinstance(told, list):
        return [*told[:place], value, *told[place + 1 :]]
    match rng.randrange(4):
        case 0:
            return {name: each for name, each in told.items() if name != place}
        case 1:
            return {**told, rng.choice(("", "a", "__metadata__", "rabbit_policy")): value}
    return {**told, place: value}


def name(rng: random.Random, folder: Path) -> str:
    """What a service may be asked to load."""
    match rng.randrange(4):
        case 0:
            return rng.choice(NAMES)
        case 1:
            return rng.choice(("a", "../", "/x", "\0", "é")) * rng.choice((1, 50, 250, 4000, 100_000))
        case 2:
            return str(folder) + "/" + "a" * rng.choice((1, 255, 256))
    file = folder / "mutated"
    file.write_bytes(mutated(rng, rng.choice(GOOD).encode()))
    return str(file)


def message(rng: random.Random) -> bytes:
    """What may come over the topic."""
    file = rng.choice(GOOD)
    data, version = mutated(rng, file.encode()), rng.choice((file.version, "", "x" * 400, "zero"))
    sent = serialize_message(
        PolicyWeights(version=version, source="s" * rng.choice((0, 5, 500)), data=array("B", data))
    )
    return bytes(sent[: rng.randrange(len(sent))] if rng.random() < 0.1 else sent)


class Asked:
    """The policies of a node, taken between two ticks, as the node does."""

    def __init__(self, policies: Policies) -> None:
        self.policies, self.refusals, self._tick = policies, list[str](), 0

    def load(self, named: str) -> LoadPolicy.Response:
        """What the service answers."""
        answer = self.policies._on_load(LoadPolicy.Request(policy=named), LoadPolicy.Response())
        self._until(answer.done)
        return answer.result()

    def publish(self, data: bytes) -> None:
        """A message on the topic."""
        self.policies._on_bytes(data)

    def takes(self, version: str) -> None:
        """It is in force once all that came before has been looked at."""

        def is_in_force() -> bool:
            self._tick += 1
            self.policies.take((1, self._tick), lambda _: None, lambda _, error: self.refusals.append(str(error)))
            self.policies.swap((1, self._tick), "")
            return self.policies.in_force.version == version

        self._until(is_in_force)

    def _until(self, holds: Callable[[], bool]) -> None:
        end = time.monotonic() + HANGS
        while not holds():
            assert self.policies._thread.is_alive(), "the thread that checks policies has died"
            assert time.monotonic() < end
            time.sleep(0.0002)


@contextmanager
def controller(kind: type[Any], *parameters: str) -> Iterator[Asked]:
    """The policies of a controller in this process."""
    words = [word for each in parameters for word in ("-p", each)]
    rclpy.init(args=["--ros-args", *words, "--log-level", "fatal"], signal_handler_options=SignalHandlerOptions.NO)
    node = kind()
    try:
        yield Asked(node._policies)
    finally:
        node.close()
        node.destroy_node()
        rclpy.try_shutdown()


@pytest.fixture
def asked() -> Iterator[Asked]:
    """Of RABBIT's controller."""
    with controller(ControllerNode, "controller:=rl-cbf-clf-qp") as asked:
        yield asked


def test_a_file_of_a_header_alone_is_refused(asked: Asked) -> None:
    for header in (b'{"__metadata__":null}', b'{"__metadata__":{}}', b"{}", b"null", b"[" * 20):
        data = array("B", len(header).to_bytes(8, "little") + header)
        asked.publish(bytes(serialize_message(PolicyWeights(data=data))))
        for file in GOOD:
            asked.publish(sent(file))
            asked.takes(file.version)


def test_whatever_a_check_raises_is_the_reason_of_a_refusal(asked: Asked, monkeypatch: pytest.MonkeyPatch) -> None:
    """`fit` may be another package's, whose author forgot an exception, or ends the process."""
    for error in (KeyError("beta"), RuntimeError("casadi"), SystemExit(3), MemoryError()):

        def fit(_: Any, error: BaseException = error) -> Any:
            raise error

        with monkeypatch.context() as patch:
            patch.setattr(asked.policies, "_fit", fit)
            assert type(error).__name__ in asked.load("rl-cbf-clf-qp").message
    for file in GOOD:
        asked.publish(sent(file))
        asked.takes(file.version)


@pytest.mark.timeout(1800)
@pytest.mark.parametrize("cases", [200, 20_000])
def test_after_each_mutated_policy_a_good_one_is_taken(asked: Asked, tmp_path: Path, cases: int) -> None:
    rng, loaded = random.Random(cases), 0
    for case in range(cases):
        if case % 3:
            asked.publish(message(rng))
        else:
            answer = asked.load(name(rng, tmp_path))
            assert answer.success or answer.message
            loaded += answer.success
        file = GOOD[case % 2]
        asked.publish(sent(file))
        asked.takes(file.version)
    assert len(asked.refusals) > 0.8 * cases
    assert loaded < 0.1 * cases


def test_zero_is_loaded_by_its_name(asked: Asked) -> None:
    for _ in range(2):
        asked.publish(sent(GOOD[0]))
        asked.takes(GOOD[0].version)
        answer = asked.load("zero")
        assert (answer.success, answer.version, answer.message) == (True, "zero", "")
        asked.takes("zero")


def test_a_task_goes_back_to_nominal() -> None:
    """And to any other of its controllers that needs no file."""
    with controller(ControllerNode, f"task:={SEGWAY}") as asked:
        for named, version in (("oracle", "oracle"), ("zero", "nominal"), ("oracle", "oracle"), ("nominal", "nominal")):
            answer = asked.load(named)
            assert (answer.success, answer.version) == (True, version)
            asked.takes(version)
        assert "none of nominal, oracle" in asked.load("nope").message


def sent(file: PolicyFile) -> bytes:
    """As the trainer sends it."""
    return bytes(serialize_message(PolicyWeights(version=file.version, source="test", data=array("B", file.encode()))))

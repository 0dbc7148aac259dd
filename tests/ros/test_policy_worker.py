"""Whatever comes as a policy, by topic or by name, the thread that checks it answers, and takes the next good one."""

import time
from array import array
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from entrances import with_hash
from mutations import mutated
from rabbit_msgs.msg import PolicyWeights
from rabbit_msgs.srv import LoadPolicy
from rclpy.serialization import serialize_message
from rl_cbf_clf_controller.ros.node import ControllerNode
from rl_cbf_clf_controller.ros.policies import Policies
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP
from rl_cbf_clf_controller.weights import PolicyFile
from untrained_policy import policy_file, policy_metadata

from .conftest import in_process

SEGWAY = Path(__file__).parents[2] / "examples" / "segway.py"
HANGS = 60.0  # s: a guard, no bar
NAMES = ("", ".", "/", "\0", "/dev/zero", "/proc/self/mem", "/proc/kmsg", "\n", "a" * 256, "a" * 100_000)


def good(number: int) -> PolicyFile:
    """A small one, another for each number."""
    fill = np.random.default_rng(number).standard_normal
    return policy_file(policy_metadata(RL_CBF_CLF_QP, hidden=(4, 4), training_seed=number), fill)


GOOD = [good(number) for number in (1, 2)]


def changed(rng: np.random.Generator) -> bytes:
    """A policy file changed anyhow, half of them with the hash of what is in it."""
    data = mutated(GOOD[rng.integers(2)].encode(), rng)
    return with_hash(data) if rng.random() < 0.5 else data


def name(rng: np.random.Generator, folder: Path) -> str:
    """What a service may be asked to load."""
    if rng.random() < 0.5:
        return NAMES[rng.integers(len(NAMES))]
    (folder / "changed").write_bytes(changed(rng))
    return str(folder / "changed")


def message(rng: np.random.Generator) -> bytes:
    """What may come over the topic."""
    version = ("", "x" * 400, "zero", GOOD[0].version)[rng.integers(4)]
    sent = bytes(serialize_message(PolicyWeights(version=version, data=array("B", changed(rng)))))
    return sent[: rng.integers(len(sent))] if rng.random() < 0.1 else sent


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


@pytest.fixture
def asked() -> Iterator[Asked]:
    """Of RABBIT's controller, in this process."""
    with in_process(ControllerNode, "-p", "controller:=rl-cbf-clf-qp") as node:
        yield Asked(node._policies)


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
    rng, loaded = np.random.default_rng(cases), 0
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
    with in_process(ControllerNode, "-p", f"task:={SEGWAY}") as node:
        asked = Asked(node._policies)
        for named, version in (("oracle", "oracle"), ("zero", "nominal"), ("oracle", "oracle"), ("nominal", "nominal")):
            answer = asked.load(named)
            assert (answer.success, answer.version) == (True, version)
            asked.takes(version)
        assert "none of nominal, oracle" in asked.load("nope").message


def sent(file: PolicyFile) -> bytes:
    """As the trainer sends it."""
    return bytes(serialize_message(PolicyWeights(version=file.version, source="test", data=array("B", file.encode()))))

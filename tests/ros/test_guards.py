"""A callback or a service that raises refuses what came, and takes the next one; a node ends."""

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from rabbit_common.guard import guarded
from rabbit_common.ros.checked_node import FAULT, CheckedNode
from rabbit_common.ros.services import call_service, guard_services
from rabbit_msgs.msg import EpisodePlan
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.experimental import EventsExecutor
from rclpy.serialization import serialize_message
from std_srvs.srv import SetBool

from .conftest import in_process

UNKNOWN = Parameter(name="number", value=ParameterValue(type=77))  # a type that ROS has not
NUMBER = Parameter(name="number", value=ParameterValue(type=2, integer_value=5))


class Careless(CheckedNode):
    """Divides by what it hears, and by whether it is to pause."""

    def __init__(self) -> None:
        super().__init__("careless")
        self.heard, self.faults = list[float](), list[str]()
        self.declare_parameter("number", 1)
        self.subscription = self._hear(EpisodePlan, "episode_plan", self._on_plan, 10)
        self.create_service(SetBool, "pause", self._on_pause)
        guard_services(self)

    def _on_plan(self, message: EpisodePlan) -> None:
        self.heard.append(1 / message.sigma)

    def _on_fault(self, reason: str) -> None:
        self.faults.append(reason)

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.message = str(1 / request.data)
        response.success = True
        return response


@pytest.fixture
def node() -> Iterator[Careless]:
    """One in this process."""
    with in_process(Careless) as node:
        yield node


@pytest.fixture
def ask(node: Careless) -> Iterator[Callable[..., Any]]:
    """Calls a service of the node, which is spun meanwhile."""
    client, executor = rclpy.create_node("client"), EventsExecutor()
    for spun in (node, client):
        executor.add_node(spun)

    def call(kind: Any, name: str, **fields: Any) -> Any:
        answer = call_service(client.create_client(kind, name), kind.Request(**fields), executor.spin_once, 60.0)
        assert answer is not None
        return answer

    yield call
    executor.shutdown()
    client.destroy_node()


def test_a_message_on_which_a_callback_fails_is_refused(node: Careless) -> None:
    for sigma in (0.0, 0.5, 0.0, 0.25):
        node.subscription.callback(bytes(serialize_message(EpisodePlan(sigma=sigma))))
    assert node.heard == [2.0, 4.0]
    assert node._message_counter.refused == {f"episode_plan: {FAULT}": 2}
    assert node.faults[0].startswith("episode_plan: ZeroDivisionError: float division by zero (test_guards.py, line")


def test_a_request_on_which_a_service_fails_is_answered(ask: Callable[..., Any]) -> None:
    for _ in range(2):
        answer = ask(SetBool, "pause", data=False)
        assert (answer.success, "ZeroDivisionError" in answer.message) == (False, True)
        assert ask(SetBool, "pause", data=True).success


def test_a_parameter_of_no_type_is_refused(ask: Callable[..., Any]) -> None:
    """ROS's own service raises; of several parameters those before are set, and the others are not."""
    results = ask(SetParameters, "careless/set_parameters", parameters=[NUMBER, UNKNOWN, NUMBER]).results
    assert [result.successful for result in results] == [True, False, False]
    assert "77" in results[1].reason
    result = ask(SetParametersAtomically, "careless/set_parameters_atomically", parameters=[UNKNOWN]).result
    assert (result.successful, "77" in result.reason) == (False, True)
    (value,) = ask(GetParameters, "careless/get_parameters", names=["number"]).values
    assert value.integer_value == 5


def test_what_ends_a_process_is_a_reason_too_but_for_ctrl_c() -> None:
    def call(error: BaseException) -> str:
        raise error

    safe = guarded(call, lambda reason, error: f"{reason}; {error!r}")
    assert safe(SystemExit(3)).startswith("SystemExit: 3 (test_guards.py")
    assert safe(ValueError("sigma = -1: expected 0 or more")).startswith("sigma = -1: expected 0 or more; ")
    with pytest.raises(KeyboardInterrupt):
        safe(KeyboardInterrupt())


HANGS = """
import ctypes
from rabbit_common.ros import spin
from rclpy.node import Node

class Hanging(Node):
    def __init__(self):
        super().__init__("hanging")
        self.create_timer(0.1, lambda: print("runs", flush=True))

    def destroy_node(self):
        ctypes.PyDLL(None).pause()  # keeps the interpreter's lock, as a middleware that waits for itself

spin._MIDDLEWARE = 1
spin.run(Hanging)
"""


def test_a_node_whose_middleware_hangs_ends_cleanly() -> None:
    with subprocess.Popen([sys.executable, "-c", HANGS], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "runs\n"
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=180)
    assert process.returncode == 0


def test_a_missed_deadline_is_told_and_one_of_no_topic_is_refused(world: Any) -> None:
    """Of the topics that a parameter names alone."""
    deadline = f"qos_overrides./{world.namespace}/%s.publisher.deadline"
    world.start("simulator", stones=1, start_paused=False, **{deadline % "state": 50_000_000})  # ns
    world.start("controller")
    world.ended()  # nothing is said any more
    world.wait(lambda: any("deadline missed" in status.message for status in world.statuses("simulator")))
    topics = (f"/{world.namespace}/{name}" for name in ("state", "episode"))
    state, episode = map(world.node.get_publishers_info_by_topic, topics)
    assert [publisher.qos_profile.deadline.nanoseconds for publisher in state] == [50_000_000]
    assert episode[0].qos_profile.deadline.nanoseconds > 10**12
    world.start("estimator", **{deadline % "torque": 50_000_000})  # which does not publish it
    world.wait(lambda: "estimator has no parameter of this name" in world.log("estimator"))

"""Every topic of every node with sound, garbled, cut and impossible messages: they are used or refused, nothing else.

The nodes are in this process, and their callbacks are called with bytes as the middleware would.
"""

import math
import time
from array import array
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import copy
from typing import Any

import numpy as np
import pytest
import rclpy
from hypothesis import given
from hypothesis import strategies as st
from rabbit_common.ros.conversions import encoder_message, header, imu_message, preview_message, state_message
from rabbit_common.ros.qos import EVENT
from rabbit_description.gait import load_gait
from rabbit_estimator.ros.node import EstimatorNode
from rabbit_msgs.msg import (
    ControllerState,
    Episode,
    EpisodePlan,
    LearnerTerms,
    PolicySwap,
    PolicyWeights,
    TorqueCommand,
)
from rabbit_recording.open_recording import opened
from rabbit_recording.ros.recorder import SENT, RecorderNode
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.ros.node import SimulatorNode
from rabbit_sim.simulation import Simulation
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.signals import SignalHandlerOptions
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.message_fields import state_fields, terms_fields
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.ros.node import ControllerNode
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP
from rl_trainer.parameters import TrainingParameters
from rl_trainer.ros.node import TrainerNode
from rl_trainer.training import Trainer
from std_msgs.msg import Header

HEADER = 4  # bytes before a message's own
BY_TICK = ("state", "torque", "controller_state", "learner_terms")
PARAMETERS = ControllerParameters(controller="rl-cbf-clf-qp")
SMALL = {"problem": RL_CBF_CLF_QP, "hidden1": 4, "hidden2": 4, "batch": 4, "updates_least": 1, "capacity": 500}
NUMBERS: dict[str, st.SearchStrategy[Any]] = {
    "double": st.floats(),
    "boolean": st.booleans(),
    "uint8": st.integers(0, 255),
    "uint32": st.integers(0, 3) | st.integers(0, 2**32 - 1),
    "uint64": st.integers(0, 2**64 - 1),
}


def sound_messages() -> dict[str, list[Any]]:
    """What goes over each topic in the first ticks of episode 1, and the policy files."""
    gait = load_gait(PARAMETERS.gait)
    simulation = Simulation(SimulationParameters(stones=3), gait)
    controller = Controller(PARAMETERS, gait, ZeroPolicy(PARAMETERS.problem))
    policy = Trainer(TrainingParameters(**SMALL)).policy_file()
    state = simulation.reset(1)
    assert state.preview is not None
    data = array("B", policy.encode())
    made: dict[str, list[Any]] = {
        "episode": [Episode(episode=1, phase=p, sigma=math.nan, stones=3, tick=3) for p in (1, 3, 0, 2)],
        "preview": [preview_message(state.preview, 1, Header())],
        "episode_plan": [EpisodePlan(after_episode=0), EpisodePlan(after_episode=1)],
        "policy": [PolicyWeights(version=policy.version, data=data)],
        "policy_swap": [PolicySwap(accepted=True, version="zero"), PolicySwap(accepted=True, data=data)],
    }
    for _ in range(4):
        output = controller.step(state)
        asked = state_message(state, 1, Header())
        said = {"torque": array("d", output.torque), "policy_version": output.policy_version}
        head = {"header": asked.header, "episode": asked.episode, "tick": asked.tick, "sender": "a"}
        details = ControllerState(**head, **state_fields(output)), LearnerTerms(**head, **terms_fields(output))
        answers = TorqueCommand(**head, **said), *details
        for name, message in zip(BY_TICK, (asked, *answers), strict=True):
            made.setdefault(name, []).append(message)
        state = simulation.step(output.torque)
    simulation.close()
    return made


def sound_measurements() -> dict[str, list[Any]]:
    """What a simulator with a lab's sensors says in the first ticks of episode 1."""
    simulation = Simulation(SimulationParameters(stones=3, sensors="lab"), load_gait(PARAMETERS.gait))
    made: dict[str, list[Any]] = {"measured": [], "joint_states": [], "imu": []}
    state = simulation.reset(1)
    for tick in range(4):
        assert state.sensors is not None
        at = header(tick)
        sensed = encoder_message(state.sensors, at), imu_message(state.sensors, at, (1e-5, 1e-5, 1e-2))
        for name, message in zip(made, (state_message(state, 1, at), *sensed), strict=True):
            made[name].append(message)
        state = simulation.step(np.zeros(4))
    simulation.close()
    return made


SOUND = sound_messages() | sound_measurements()


@st.composite
def arriving(draw: st.DrawFn, topic: str) -> bytes:
    """Bytes on a topic: a sound message, with other fields or bytes, or cut; or noise."""
    message = draw(st.sampled_from(SOUND[topic]))
    kind = type(message)
    data = bytes(serialize_message(message))
    how = draw(st.sampled_from(("sound", "fields", "fields", "bytes", "cut", "noise")))
    if how == "fields":
        copy: Any = deserialize_message(data, kind)
        fields = copy.get_fields_and_field_types()
        for name in draw(st.lists(st.sampled_from(sorted(fields)), max_size=3)):
            spoil(draw, copy, name, fields[name])
        return bytes(serialize_message(copy))
    if how == "bytes":
        wrong = bytearray(data)
        for _ in range(draw(st.integers(1, 6))):
            wrong[draw(st.integers(HEADER, len(wrong) - 1))] = draw(st.integers(0, 255))
        return bytes(wrong)
    if how == "cut":
        return data[: draw(st.integers(0, len(data)))]
    return draw(st.binary(max_size=80)) if how == "noise" else data


def spoil(draw: st.DrawFn, message: Any, name: str, kind: str) -> None:
    """Set a field to anything that its type can hold."""
    if kind in NUMBERS:
        setattr(message, name, draw(NUMBERS[kind]))
    elif kind.startswith("string"):
        setattr(message, name, draw(st.text(st.characters(codec="utf-8"), max_size=8)))
    elif "double" in kind and len(values := np.array(getattr(message, name))) and draw(st.booleans()):
        values[draw(st.integers(0, len(values) - 1))] = draw(st.floats())
        setattr(message, name, values if kind.startswith("double[") else array("d", values))
    elif kind.startswith("sequence<double"):
        setattr(message, name, array("d", draw(st.lists(st.floats(), max_size=8))))
    elif kind == "sequence<uint8>":
        setattr(message, name, array("B", draw(st.binary(max_size=40))))


@pytest.fixture(scope="module")
def ros(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """ROS in this process, with the parameters of all nodes."""
    told = {"stones": 3, "motor_lag": 0.004, "controller": PARAMETERS.controller}
    told |= {"hidden1": 4, "hidden2": 4, "batch": 4, "updates_least": 1, "capacity": 500}
    of = {"stones": "simulator", "motor_lag": "simulator", "controller": "controller", "path": "recorder"}
    told |= {"path": str(tmp_path_factory.mktemp("recorder") / "recording")}
    words = [w for name, value in told.items() for w in ("-p", f"{of.get(name, 'trainer')}:{name}:={value}")]
    rclpy.init(args=["--ros-args", *words, "--log-level", "fatal"], signal_handler_options=SignalHandlerOptions.NO)
    yield
    rclpy.try_shutdown()


@contextmanager
def closing_node(node: Any) -> Iterator[Any]:
    """The node, which is gone from the graph afterwards, also after a failed test."""
    try:
        yield node
    finally:
        if hasattr(node, "close"):
            node.close()
        node.destroy_node()


def callbacks(node: Any) -> dict[str, Callable[..., None]]:
    """What the middleware calls, by topic."""
    hears = {each.topic_name.split("/")[-1]: each.callback for each in node.subscriptions}
    return {topic: callback for topic, callback in hears.items() if topic in SOUND}


def refused(node: Any) -> int:
    """How many messages it has refused."""
    return sum(node._message_counter.refused.values())


def feed(data: st.DataObject, hears: dict[str, Callable[..., None]]) -> None:
    """A few messages on any of the topics."""
    for topic in data.draw(st.lists(st.sampled_from(sorted(hears)), min_size=1, max_size=6)):
        hears[topic](data.draw(arriving(topic)))


@pytest.fixture(scope="module")
def simulator(ros: None) -> Iterator[SimulatorNode]:
    """A simulator whose controller is whoever sends torques."""
    with closing_node(SimulatorNode()) as node:
        yield node
        assert refused(node) > 0


@given(data=st.data())
def test_simulator(simulator: SimulatorNode, data: st.DataObject) -> None:
    """Each example begins with tick 0 of an episode of number 1."""
    simulator._player.state = None
    simulator._player.episode.episode = 0
    simulator._player.begin(data.draw(st.integers(0, 2**64 - 1)))
    feed(data, callbacks(simulator))
    simulator._look()
    simulator._status()


@pytest.fixture(scope="module")
def controller(ros: None) -> Iterator[ControllerNode]:
    """A controller."""
    with closing_node(ControllerNode()) as node:
        yield node
        assert refused(node) > 0


def test_a_state_before_the_announcement_of_its_episode_is_kept_until_then(ros: None) -> None:
    """A controller that has just started hears the latched announcements a moment after the states."""
    with closing_node(ControllerNode()) as node:
        hears = callbacks(node)
        state, preview, announcement = (copy(SOUND[topic][0]) for topic in ("state", "preview", "episode"))
        for message in (state, preview, announcement):
            message.episode = 7
        for topic, message in (("state", state), ("preview", preview)):
            hears[topic](bytes(serialize_message(message)))
        assert (node._answer.episode, refused(node)) == (0, 0)
        assert "announcement of episode 7" in node._status()[1]
        hears["episode"](bytes(serialize_message(announcement)))
        assert (node._answer.episode, node._answer.tick, node._answer.fault) == (7, 0, "")


@given(data=st.data())
def test_controller(controller: ControllerNode, data: st.DataObject) -> None:
    """Each example begins with an announced episode, or in the middle of it."""
    hears = callbacks(controller)
    controller._ticks.turn = (0, -1)
    for topic in ("episode", "preview"):
        hears[topic](bytes(serialize_message(SOUND[topic][0])))
    for state in SOUND["state"][: data.draw(st.integers(0, 3))]:
        hears["state"](bytes(serialize_message(state)))
    feed(data, hears)
    controller._go_on()
    controller._status()


@pytest.fixture(scope="module")
def estimator(ros: None) -> Iterator[EstimatorNode]:
    """An estimator."""
    with closing_node(EstimatorNode()) as node:
        yield node
        assert refused(node) > 0


def states_of(node: EstimatorNode, ticks: int, between: Callable[[int], None] = lambda _: None) -> list[Any]:
    """Its answers to a new simulator's first ticks; `between` is called before each."""
    hears, answers = callbacks(node), []
    hears["episode"](bytes(serialize_message(Episode(sigma=math.nan))))
    hears["episode"](bytes(serialize_message(SOUND["episode"][0])))
    for tick in range(ticks):
        between(tick)
        for _ in range(2):  # what was missing or is not fit is said once more
            for topic in ("measured", "joint_states", "imu"):
                hears[topic](bytes(serialize_message(SOUND[topic][tick])))
        answers.append(node._answer)
    return answers


@given(data=st.data())
def test_estimator(estimator: EstimatorNode, data: st.DataObject) -> None:
    """Each example begins with a new simulator, and a few of its ticks."""
    states_of(estimator, data.draw(st.integers(0, 3)))
    feed(data, callbacks(estimator))
    estimator._status()


def test_damaged_sensors_are_refused_and_change_nothing_that_comes_after(ros: None) -> None:
    def damage(tick: int) -> None:
        joints, imu, measured = (copy(SOUND[topic][tick]) for topic in ("joint_states", "imu", "measured"))
        joints.position = array("d", [math.nan] * 4)
        imu.orientation = type(imu.orientation)(x=0.5, y=0.5, z=0.5, w=0.5)
        measured.tick += 7 * (tick > 0)
        for topic, message in (("joint_states", joints), ("imu", imu), ("measured", measured)):
            hears[topic](bytes(serialize_message(message)))
            hears[topic](bytes(serialize_message(message))[:40])

    with closing_node(EstimatorNode()) as estimator:
        hears = callbacks(estimator)
        expected = [message.q for message in states_of(estimator, 4)]
        assert np.isfinite(expected).all()
        assert refused(estimator) == 0
        np.testing.assert_array_equal([message.q for message in states_of(estimator, 4, damage)], expected)
        assert refused(estimator) >= 4 * 4


def begin(node: TrainerNode) -> None:
    """Have the trainer begin where a simulator stands that has walked nothing yet."""
    callbacks(node)["episode"](bytes(serialize_message(Episode(phase=Episode.WAITING, sigma=math.nan))))
    node._look()
    assert node._started


@pytest.fixture(scope="module")
def trainer(ros: None) -> Iterator[TrainerNode]:
    """A trainer that has heard of a simulator."""
    with closing_node(TrainerNode()) as node:
        begin(node)
        yield node
        assert refused(node) > 0
        assert node._learning.error == ""


def test_a_trainer_that_was_led_ahead_goes_back_to_where_the_simulator_stands(ros: None) -> None:
    """Somebody announces the end of an episode that never was; the simulator waits for the plan after its own."""
    with closing_node(TrainerNode()) as node:
        begin(node)
        for number in (49, 13):
            ended = Episode(episode=number, phase=Episode.ENDED, tick=5, outcome="walked", sigma=math.nan)
            callbacks(node)["episode"](bytes(serialize_message(ended)))
            node._hand_on(node._ticks.give_up())
            assert node._ticks.done == number
        end = time.monotonic() + 60
        while node._published._planned is None or node._published._planned[1] != 13:
            assert time.monotonic() < end
            time.sleep(0.01)


@given(data=st.data())
def test_trainer(trainer: TrainerNode, data: st.DataObject) -> None:
    """Each example begins where the last one ended, or with a new simulator."""
    hears = callbacks(trainer)
    if data.draw(st.booleans()):
        hears["episode"](bytes(serialize_message(Episode(sigma=math.nan))))
    for tick in range(data.draw(st.integers(0, 3))):
        for topic in BY_TICK:
            hears[topic](bytes(serialize_message(SOUND[topic][tick])))
    feed(data, hears)
    if data.draw(st.booleans()):
        trainer._hand_on(trainer._ticks.give_up())
    trainer._look()
    trainer._status()
    assert trainer._learning.error == ""


@pytest.fixture(scope="module")
def recorder(ros: None) -> Iterator[RecorderNode]:
    """A recorder; what it has recorded can be read."""
    with closing_node(RecorderNode()) as node:
        yield node
    with opened(node._path) as reader:
        assert reader.message_count == node._writer.messages > 0


def test_a_recorder_that_is_busy_with_its_disk_misses_nothing(ros: None) -> None:
    """Pausing and stepping announces a hundred times a second."""
    with closing_node(rclpy.create_node("somebody")) as somebody:
        publisher = somebody.create_publisher(Episode, "episode", EVENT)
        with closing_node(RecorderNode()) as recorder:
            end = time.monotonic() + 60
            while not publisher.get_subscription_count() and time.monotonic() < end:
                time.sleep(0.01)
            for _ in range(100):
                publisher.publish(Episode(episode=1, phase=Episode.PAUSED))
                time.sleep(0.002)  # the middleware's threads take it; nobody reads it yet
            end = time.monotonic() + 60
            while recorder._writer.messages < 100 and time.monotonic() < end:
                rclpy.spin_once(recorder, timeout_sec=0.1)
            assert recorder._writer.messages >= 100


def test_a_recorder_that_ends_waits_for_what_was_sent_before(ros: None) -> None:
    """The state comes last: behind a message that another node sent after the recorder was asked to end."""
    with closing_node(RecorderNode()) as recorder:
        hears = callbacks(recorder)
        assert recorder.busy()  # asked; nothing was heard for long
        before = time.time_ns() - 1
        hears["torque"](bytes(serialize_message(SOUND["torque"][0])), {SENT: time.time_ns()})
        assert recorder.busy()
        hears["state"](bytes(serialize_message(SOUND["state"][0])), {SENT: before})
        end = time.monotonic() + 60
        while recorder.busy() and time.monotonic() < end:
            time.sleep(0.01)
        assert not recorder.busy()
        assert recorder._writer.messages == 2


@given(data=st.data())
def test_recorder(recorder: RecorderNode, data: st.DataObject) -> None:
    """Whatever comes is recorded as it came."""
    before, hears = recorder._writer.messages, callbacks(recorder)
    topics = data.draw(st.lists(st.sampled_from(sorted(hears)), min_size=1, max_size=6))
    for number, topic in enumerate(topics):
        hears[topic](data.draw(arriving(topic)), {SENT: number})
    recorder._status()
    assert recorder._failure == ""
    assert recorder._writer.messages == before + len(topics)

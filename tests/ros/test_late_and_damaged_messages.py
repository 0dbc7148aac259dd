"""Messages that come before their announcement, damaged, or while a node is busy or ends.

The nodes are in this process, and their callbacks are called with bytes as the middleware would.
"""

import math
import time
from array import array
from collections.abc import Callable, Iterator
from copy import copy
from typing import Any

import numpy as np
import pytest
import rclpy
from rabbit_bringup.ros.command_guard import CommandGuardNode
from rabbit_common.ros.conversions import encoder_message, header, imu_message, preview_message, state_message
from rabbit_common.ros.network import StartError
from rabbit_common.ros.qos import TICK
from rabbit_description.gait import load_gait
from rabbit_description.state import ACTUATED
from rabbit_estimator.ros.node import EstimatorNode
from rabbit_msgs.msg import Episode, RobotState, TorqueCommand
from rabbit_recording.ros.recorder import SENT, RecorderNode
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Simulation
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.ros.node import ControllerNode
from rl_trainer.ros.node import TrainerNode
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from .conftest import closing_node

PARAMETERS = ControllerParameters(controller="rl-cbf-clf-qp")


def sound_messages() -> dict[str, list[Any]]:
    """What goes over a topic at the begin of episode 1."""
    simulation = Simulation(SimulationParameters(stones=3), load_gait(PARAMETERS.gait))
    state = simulation.reset(1)
    simulation.close()
    assert state.preview is not None
    return {
        "episode": [Episode(episode=1, phase=Episode.RUNNING, sigma=math.nan, stones=3)],
        "preview": [preview_message(state.preview, 1, Header())],
        "state": [state_message(state, 1, Header())],
        "torque": [TorqueCommand(episode=1, sender="a", torque=[0.0] * 4)],
    }


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


@pytest.fixture(scope="module")
def ros(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """ROS in this process, with the parameters of all nodes."""
    parameters = {"stones": 3, "motor_lag": 0.004, "controller": PARAMETERS.controller, "timeout": 60.0}
    parameters |= {"hidden1": 4, "hidden2": 4, "batch": 4, "updates_least": 1, "capacity": 500}
    of = {"stones": "simulator", "motor_lag": "simulator", "controller": "controller", "path": "recorder"}
    of |= {"timeout": "command_guard"}
    parameters |= {"path": str(tmp_path_factory.mktemp("recorder") / "recording")}
    words = [w for name, value in parameters.items() for w in ("-p", f"{of.get(name, 'trainer')}:{name}:={value}")]
    rclpy.init(args=["--ros-args", *words, "--log-level", "fatal"], signal_handler_options=SignalHandlerOptions.NO)
    yield
    rclpy.try_shutdown()


def callbacks(node: Any) -> dict[str, Callable[..., None]]:
    """What the middleware calls, by topic."""
    hears = {subscription.topic_name.split("/")[-1]: subscription.callback for subscription in node.subscriptions}
    return {topic: callback for topic, callback in hears.items() if topic in SOUND}


def refused(node: Any) -> int:
    """How many messages it has refused."""
    return sum(node._message_counter.refused.values())


def test_a_state_before_the_announcement_of_its_episode_is_kept_until_then(ros: None) -> None:
    """A controller that has just started hears the latched announcements a moment after the states."""
    with closing_node(rclpy.create_node("somebody")) as simulator, closing_node(ControllerNode()) as node:
        simulator.create_publisher(RobotState, "state", TICK)
        hears, end = callbacks(node), time.monotonic() + 60
        state, preview, announcement = (copy(SOUND[topic][0]) for topic in ("state", "preview", "episode"))
        for message in (state, preview, announcement):
            message.episode = 7
        for topic, message in (("state", state), ("preview", preview)):
            hears[topic](bytes(serialize_message(message)))
        assert (node._answer.episode, refused(node)) == (0, 0)
        while "waiting for a simulator" in node._status()[1] and time.monotonic() < end:
            time.sleep(0.01)
        assert "announcement of episode 7" in node._status()[1]
        hears["episode"](bytes(serialize_message(announcement)))
        assert (node._answer.episode, node._answer.tick, node._answer.fault) == (7, 0, "")


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


def test_the_guard_takes_no_other_joints_for_the_robots(ros: None) -> None:
    """A gripper's broadcaster speaks on the same topic: it does not keep alive a robot that says nothing."""
    gripper = JointState(name=["finger"], position=[0.0], velocity=[0.0])
    for joints, passes in ((gripper, False), (SOUND["joint_states"][0], True)):
        with closing_node(CommandGuardNode()) as node:
            hears = {subscription.topic_name: subscription.callback for subscription in node.subscriptions}
            hears["/joint_states"](bytes(serialize_message(joints)))
            for torque in (0.0, 5.0):
                command = JointState(name=list(ACTUATED), effort=[torque] * 4)
                hears["/stamped_commands"](bytes(serialize_message(command)))
            assert node._guard.acts.all() == passes
            assert ("no joint_states" in node._guard.fault) != passes


def begin(node: TrainerNode) -> None:
    """Have the trainer begin where a simulator stands that has walked nothing yet."""
    callbacks(node)["episode"](bytes(serialize_message(Episode(phase=Episode.WAITING, sigma=math.nan))))
    node._look()
    assert node._started


def test_an_episode_of_another_tick_is_neither_estimated_nor_learned_from(ros: None) -> None:
    """Rates of change would be wrong by the ratio of the two ticks, and nobody would see it."""
    announcement = Episode(episode=1, phase=Episode.RUNNING, sigma=math.nan, tick_seconds=0.005)
    with closing_node(EstimatorNode()) as estimator:
        callbacks(estimator)["episode"](bytes(serialize_message(announcement)))
        for topic in ("measured", "joint_states", "imu"):
            callbacks(estimator)[topic](bytes(serialize_message(SOUND[topic][0])))
        assert np.isnan(estimator._answer.q).all()
    with closing_node(TrainerNode()) as trainer:
        callbacks(trainer)["episode"](bytes(serialize_message(announcement)))
        trainer._look()
        assert "tick_seconds = 0.005 of the simulator; this node has 0.01" in trainer._message_counter.last_refusal
        assert not trainer._started


def test_a_second_trainer_is_refused_until_the_first_one_has_ended(ros: None) -> None:
    with closing_node(TrainerNode()), pytest.raises(StartError, match="another trainer of this machine publishes /ep"):
        TrainerNode()
    with closing_node(TrainerNode()) as node:
        assert not node.failure


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

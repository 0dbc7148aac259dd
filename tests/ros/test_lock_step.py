"""The walk through the nodes is the walk in process, bit for bit, and the recording holds all of it."""

from pathlib import Path
from typing import Any

import drawn_runs
import numpy as np
import pytest
from rabbit_bringup.launching.walk import WalkOptions, WalkSettings
from rabbit_bringup.ros.walk_monitor import walk_through
from rabbit_experiments.assembly import Assembly
from rabbit_recording.reader import RecordedEpisode, messages
from rabbit_sim.parameters import SimulationParameters
from recorded_walk import read_episodes
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_trainer.rollout import Record
from rosbags.highlevel import AnyReader
from walked import walked

SEED = 9001


def walk_through_nodes(
    folder: Path, plant: SimulationParameters, parameters: ControllerParameters, **options: Any
) -> Any:
    """Simulator, controller and recorder."""
    request = WalkOptions(seed=SEED, trainer=False, **options)
    walk = WalkSettings(folder=folder, options=request, simulation=plant, controller=parameters, policy="zero")
    return list(walk_through(walk).ended.values())


def assert_same(through: list[Record], inside: list[Record]) -> None:
    """Every tick, every figure but the solver's wall time."""
    found, expected = ([drawn_runs.Tick.of(record) for record in records] for records in (through, inside))
    drawn_runs.assert_same(found, expected, "a walk", "through nodes")


def test_nodes_equal_the_walk_without_ros(tmp_path: Path) -> None:
    plant, parameters = SimulationParameters(stones=8, motor_lag=0.004), ControllerParameters()
    (ended,) = walk_through_nodes(tmp_path, plant, parameters, namespace="here")
    inside, simulation = walked(Assembly(plant, parameters, "zero"), SEED)
    episode: RecordedEpisode = read_episodes(tmp_path / "recording")[1]
    assert_same(episode.records, inside)
    assert (episode.seed, episode.outcome, episode.lost) == (SEED, simulation.outcome.value, 0)
    assert episode.landings == simulation.landings
    assert ended.touchdowns == len([landing for landing in simulation.landings if landing.on_stone])
    with AnyReader([tmp_path / "recording"]) as reader:
        connections = {connection.topic: connection for connection in reader.connections}
        counts = {topic: connection.msgcount for topic, connection in connections.items()}
        assert counts["/here/state"] == counts["/here/torque"] + 1 == counts["/here/joint_states"] > 1
        state = connections["/here/state"]
        assert "float64[<=64] q" in state.msgdef.data
        assert state.ext.offered_qos_profiles[0].reliability.name == "RELIABLE"  # type: ignore[union-attr]
        preview = connections["/here/preview"].ext.offered_qos_profiles[0]  # type: ignore[union-attr]
        assert preview.durability.name == "TRANSIENT_LOCAL"
        ticks = [time for connection, time, _ in reader.messages() if connection.topic == "/here/state"]
    assert np.diff(ticks).tolist() == [10_000_000] * (len(ticks) - 1)


def test_adaptation_through_nodes_is_the_one_in_process(tmp_path: Path) -> None:
    """Two episodes: what is learned comes from the messages alone, and is forgotten between them."""
    plant = SimulationParameters(stones=3, motor_lag=0.004, mass_scale=2.5, velocity_noise=0.01)
    parameters = ControllerParameters(objective="pd_centred", adaptation="identification")
    walk_through_nodes(tmp_path, plant, parameters, episodes=2)
    episodes = read_episodes(tmp_path / "recording")
    for number in (1, 2):
        inside, _ = walked(Assembly(plant, parameters, "zero"), SEED + number - 1)
        assert inside[-1].output.identified[0] == pytest.approx(30.0, rel=0.1)  # the torso, kg
        assert_same(episodes[number].records, inside)


def test_a_state_estimated_through_nodes_is_the_one_in_process(tmp_path: Path) -> None:
    """Two episodes: attitude and specific force come as an `Imu`, the encoders as a `JointState`."""
    plant = SimulationParameters(stones=3, motor_lag=0.004, sensors="lab", gyro_bias=0.01)
    parameters = ControllerParameters(objective="pd_centred")
    ended = walk_through_nodes(tmp_path, plant, parameters, episodes=2)
    episodes = read_episodes(tmp_path / "recording")
    for number in (1, 2):
        inside, simulation = walked(Assembly(plant, parameters, "zero"), SEED + number - 1)
        assert_same(episodes[number].records, inside)
        assert ended[number - 1].outcome == simulation.outcome.value
    true = [m for topic, m in messages(tmp_path / "recording", "true_state") if m.episode == 2]
    np.testing.assert_array_equal(true[-1].q, simulation.reading.q)
    assert np.abs(true[-2].q[2:] - inside[-1].state.q[2:]).max() < 0.02  # rad, of the estimate

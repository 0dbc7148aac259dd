"""Joint targets: PD on the reference, and what a network reads, of one robot and of N."""

from types import SimpleNamespace

import numpy as np
import pytest
from rabbit_description.gait import load_gaits
from rabbit_description.state import SWAP_TORQUE, Leg
from rabbit_rivals.joint_targets import (
    ACTIONS,
    BOUND,
    FEATURES,
    FRAMES,
    KD,
    KP,
    REACH,
    JointTargetController,
    Memory,
    NetworkAbout,
    NetworkPolicy,
    action_for,
    command,
    observe,
    reference_alone,
)
from rabbit_rivals.methods import PD
from rabbit_rivals.model_file import ModelFile
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Simulation

GAITS = load_gaits("paper_stones")


def controller(terrain: str, policy: NetworkPolicy) -> JointTargetController:
    return JointTargetController(PD.on(terrain).assembly().controller, GAITS, policy)


def test_without_an_action_it_is_pd_on_the_outputs() -> None:
    own = controller("flat", reference_alone())
    simulation = Simulation(SimulationParameters(plant="rigid", terrain="flat"), GAITS)
    state = simulation.reset(1)
    own.reset(1)
    legs = set()
    while state.running and state.touchdowns < 2:
        output = own.step(state)
        wanted = np.clip(-KP * output.eta[:4] - KD * output.eta[4:], -200, 200)
        legs.add(output.stance)
        assert output.torque == pytest.approx(wanted if output.stance is Leg.LEFT else wanted[SWAP_TORQUE])
        state = simulation.step(output.torque)
    assert legs == {Leg.LEFT, Leg.RIGHT}


def test_an_action_moves_the_targets_and_is_cut() -> None:
    scene = SimpleNamespace(seen=SimpleNamespace(eta=np.full((1, 8), 0.01)))
    action, nothing = np.array([[1.0, -0.5, 0.25, 0.0]]), np.zeros((1, 4))
    moved = command(Memory.of(1), scene, action) - command(Memory.of(1), scene, nothing)
    assert moved == pytest.approx(KP * REACH * action)
    assert (command(Memory.of(1), scene, 3 * action)[0, 0]) == command(Memory.of(1), scene, action)[0, 0]


def test_an_action_gives_the_torque_it_was_found_for_or_the_nearest() -> None:
    rng = np.random.default_rng(1)
    scene = SimpleNamespace(seen=SimpleNamespace(eta=0.3 * rng.standard_normal((200, 8))))
    torque = rng.uniform(-200, 200, (200, ACTIONS))
    action = action_for(scene, torque)
    given, (least, most) = command(Memory.of(200), scene, action), (-np.ones((200, 4)), np.ones((200, 4)))
    low, high = (command(Memory.of(200), scene, policy) for policy in (least, most))
    assert given == pytest.approx(np.clip(torque, low, high))
    assert 0.2 < (np.abs(action) < 1).mean() < 0.9


def test_the_history_is_of_this_episode_the_newest_last() -> None:
    about = NetworkAbout(learner="none", hidden=(16, 16), ticks=0, hours=0.0, seed=1, command="")
    rng = np.random.default_rng(1)
    arrays = {name: (0.03 * rng.standard_normal(shape)).astype(np.float32) for name, shape in about.shapes.items()}
    own = controller("stones", NetworkPolicy(ModelFile(about, arrays)))
    simulation = Simulation(SimulationParameters(plant="rigid"), GAITS)
    state, memory, frames = simulation.reset(1), Memory.of(1), []
    own.reset(1)
    for tick in range(FRAMES + 2):
        scene = own.see(state)
        read = observe(memory, scene).reshape(FRAMES, FEATURES)
        frames.append(read[-1])
        expected = [frames[max(0, tick - FRAMES + 1 + i)] for i in range(FRAMES)]
        assert np.array_equal(read, expected)
        said = np.full((1, ACTIONS), 0.1 * (tick % 3))
        command(memory, scene, said)
        if tick:
            assert read[-1, -ACTIONS:] == pytest.approx(0.1 * ((tick - 1) % 3))
        state = simulation.step(own.step(state).torque)
    assert np.abs(frames).max() <= BOUND
    assert len({frame.tobytes() for frame in frames}) == len(frames)

    own.reset(1)
    again = observe(memory, own.see(simulation.reset(1))).reshape(FRAMES, FEATURES)
    assert np.array_equal(again, [frames[0]] * FRAMES)

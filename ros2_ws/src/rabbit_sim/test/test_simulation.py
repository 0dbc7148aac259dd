"""Episodes: counting, preview, outcomes; on a scripted plant where the truth is written down, and on the real ones."""

import numpy as np
import pytest
from rabbit_description.gait import load_gait
from rabbit_description.state import Leg
from rabbit_sim import simulation as module
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.plant import PlantReading, Touch
from rabbit_sim.simulation import Outcome, Simulation

GAIT = load_gait("authors_035")
UP = np.array([0, 0.75, 0.1, 0, 0, 0, 0])
GROUNDED = np.array([True, False])


def up(touches=(), q=UP, contact=GROUNDED, feet=((0, 0), (0, 0))):
    return PlantReading(q, np.zeros(7), np.zeros((2, 2)), np.array(feet, float), np.array(contact), tuple(touches))


class ScriptedPlant:
    """Gives one written reading a tick."""

    def __init__(self, readings):
        self.readings = [up(), *readings]
        self.stones, self.pushes = [], []

    def reset(self, q, dq, stance):
        self.start = q, dq, stance

    def set_stones(self, spans):
        self.stones.append(list(spans))

    def push_for_tick(self, forces):
        self.pushes.append(forces)

    def advance(self, command):
        self.readings.pop(0)

    def observe(self):
        return self.readings[0]

    def close(self):
        pass


@pytest.fixture
def play(monkeypatch):
    """Run a script through a simulation: its states, and the simulation."""

    def run(readings, **changes):
        plant = ScriptedPlant(readings)
        monkeypatch.setattr(module, "load", lambda group, name: lambda parameters: plant)
        simulation = Simulation(SimulationParameters(**{"l_min_std": 0.0, "stones": 3, **changes}), GAIT)
        states = [simulation.reset(0)]
        while states[-1].running and len(plant.readings) > 1:
            states.append(simulation.step(np.zeros(4)))
        return states, simulation

    return run


def right(x, stance=0.0, hold=True):
    return Touch(Leg.RIGHT, x, stance, hold)


def left(x, stance, hold=True):
    return Touch(Leg.LEFT, x, stance, hold)


def test_a_walk_over_all_stones_and_its_preview(play):
    """Stone k + 1 is seen from the tick of touchdown k on, never earlier; the last one leaves nothing to see."""
    feet = [((0, 0), (0, 0)), ((0, 0), (0.37, 0)), ((0.75, 0), (0.37, 0))]
    script = [
        up(),
        up([right(0.37)], feet=feet[1]),
        up(feet=feet[1]),
        up([left(0.75, 0.37)], feet=feet[2]),
        up([right(1.13, 0.75)]),
    ]
    states, simulation = play(script)
    assert [state.touchdowns for state in states] == [0, 0, 1, 1, 2, 3]
    assert [state.preview and state.preview.index for state in states] == [1, 1, 2, 2, 3, None]
    assert [state.preview.l_min for state in states[:-1]] == pytest.approx([0.35] * 5)
    assert [state.running for state in states] == [True] * 5 + [False]
    assert simulation.outcome is Outcome.WALKED
    assert [(landing.index, landing.tick, landing.missed) for landing in simulation.landings] == [
        (1, 2, False),
        (2, 4, False),
        (3, 5, False),
    ]
    assert [landing.l for landing in simulation.landings] == pytest.approx([0.37, 0.38, 0.38])
    expected = [(0.35, 0.40), (0.72, 0.77), (1.10, 1.15)]
    assert np.array(simulation.stones[1:])[:, :2] == pytest.approx(np.array(expected))


@pytest.mark.parametrize("x", [0.349, 0.401, -0.3])
def test_a_foot_off_its_stone_is_a_miss_though_it_holds(play, x):
    states, simulation = play([up([right(x)]), up()])
    assert simulation.outcome is Outcome.MISS
    assert simulation.landings[0].missed
    assert simulation.landings[0].on_stone
    assert not states[-1].running


@pytest.mark.parametrize(("x", "missed"), [(0.345, True), (0.405, True), (0.36, False)])
def test_a_stone_does_not_go_with_a_stance_foot_that_slides(play, x, missed):
    """The foot has slid by 2 cm: lengths and edges count from where it is, and the stone lies where it lay."""
    _, simulation = play([up([right(x, stance=0.02)])])
    (landing,) = simulation.landings
    assert (landing.l, landing.l_min, landing.l_max) == pytest.approx((x - 0.02, 0.33, 0.38))
    assert landing.missed == missed


@pytest.mark.parametrize("stop_at_miss", [True, False])
def test_a_gap_is_counted_apart_and_once(play, stop_at_miss):
    """Also where the episode goes on after it, which ends as a fall into the gap."""
    fallen = np.array([0, 0.6, 0.1, 0, 0, 0, 0])
    script = [up([right(0.42, hold=False)]), up([right(0.43, hold=False)]), up(q=fallen)]
    states, simulation = play(script, stop_at_miss=stop_at_miss)
    (landing,) = simulation.landings
    assert simulation.outcome is Outcome.GAP_FALL
    assert (landing.on_stone, landing.missed, states[-1].touchdowns) == (False, True, 0)


@pytest.mark.parametrize(("height", "pitch"), [(0.699, 0.0), (0.75, 1.05), (0.75, -1.05)])
def test_falls_are_by_pose_and_numbers_that_are_not_finite_have_a_name_of_their_own(play, height, pitch):
    assert play([up(q=np.array([0, height, pitch, 0, 0, 0, 0]))])[1].outcome is Outcome.FALL
    assert play([up(q=np.full(7, np.nan))])[1].outcome is Outcome.DIVERGED


@pytest.mark.parametrize(("stiffness", "ticks"), [(None, 5), (1e6, 5), (5e4, 12), (2e4, 18)])
def test_flight_needs_five_ticks_in_a_row_and_on_soft_ground_half_a_period_of_the_robot_on_it(play, stiffness, ticks):
    """pi sqrt(64 kg / k): 25, 112 and 178 ms."""
    air, soft = up(contact=(False, False)), {"ground_stiffness": stiffness, "mass_scale": 2.0} if stiffness else {}
    fewer = [air] * (ticks - 1)
    assert play([*fewer, up(), *fewer], **soft)[1].outcome is Outcome.RUNNING
    assert play([*fewer, air], **soft)[1].outcome is Outcome.FLIGHT


def test_a_robot_that_takes_no_step_for_five_seconds_has_stalled(play):
    """It stands upright with a foot on the ground, and no other rule would ever end the episode."""
    assert play([up()] * 499)[1].outcome is Outcome.RUNNING
    assert play([up()] * 500)[1].outcome is Outcome.STALL
    landed = up([Touch(Leg.RIGHT, 0.35, 0.0, True)], feet=((0, 0), (0.35, 0)))
    assert play([up()] * 300 + [landed] + [up()] * 499)[1].outcome is Outcome.RUNNING


@pytest.mark.parametrize(("friction", "outcome"), [(0.8, Outcome.SLIP), (1.5, Outcome.RUNNING)])
def test_slips_count_on_slippery_ground(play, friction, outcome):
    assert play([up(feet=((0.0051, 0), (0, 0)))], ground_friction=friction)[1].outcome is outcome
    assert play([up(feet=((-0.0049, 0), (0, 0)))], ground_friction=friction)[1].outcome is Outcome.RUNNING


def test_a_foot_that_hops_slides_from_where_it_came_down_again(play):
    hop = [up(contact=(False, False), feet=((0.02, 0), (0, 0))), up(feet=((0.0249, 0), (0, 0)))]
    assert play(hop, ground_friction=0.6)[1].outcome is Outcome.RUNNING
    assert play([*hop, up(feet=((0.0251, 0), (0, 0)))], ground_friction=0.6)[1].outcome is Outcome.SLIP


def test_flat_ground_has_no_preview_and_no_miss(play):
    states, simulation = play([up([right(0.6)], feet=((0, 0), (0.6, 0)))], terrain="flat")
    assert [state.preview for state in states] == [None, None]
    assert not simulation.landings[0].missed
    assert simulation.outcome is Outcome.RUNNING


@pytest.mark.parametrize(
    ("hip", "outcome"),
    [
        ((0.375, 0.749), Outcome.FALL),  # over the stone, 5 cm up
        ((0.375, 0.751), Outcome.RUNNING),
        ((0.1875, 0.724), Outcome.FALL),  # over the middle of the gap before it, from 0.025 to 0.35 m: 2.5 cm
        ((0.1875, 0.726), Outcome.RUNNING),
        ((0.0, 0.701), Outcome.RUNNING),  # still over the platform
        ((0.555, 0.724), Outcome.FALL),  # over the middle of the next gap, from 0.40 to 0.72 m: 2.5 cm
        ((0.555, 0.726), Outcome.RUNNING),
    ],
)
def test_the_hip_counts_from_the_line_over_the_tops(play, tmp_path, hip, outcome):
    course = tmp_path / "course.yaml"
    course.write_text("stones: [{l_min: 0.35, height: 0.05}, {l_min: 0.35}, {l_min: 0.35}]")
    feet = ((0, 0), (0.37, 0.05))
    script = [up([right(0.37)], feet=feet), up(q=np.array([*hip, 0.1, 0, 0, 0, 0]), feet=feet)]
    assert play(script, course=str(course))[1].outcome is outcome


def test_a_stone_gives_way_under_the_foot_and_the_fall_onto_it_is_no_flight(play):
    """By 2 cm: 64 ms, seven ticks beyond the five. The next stone is previewed as it was."""
    air, feet = up(contact=(False, False)), ((0, 0), (0.37, 0))
    script = [up([right(0.37)], feet=feet), *[air] * 11]
    states, simulation = play(script, loose_stone=1, loose_depth=0.02)
    assert [stone.top for stone in simulation.stones] == [0.0, -0.02, 0.0]
    assert [span.top for span in simulation.plant.stones[-1]] == [0.0, -0.02, 0.0]
    assert states[-1].preview.height == 0.0
    assert simulation.outcome is Outcome.RUNNING
    assert play([*script, air], loose_stone=1, loose_depth=0.02)[1].outcome is Outcome.FLIGHT


def episodes(seeds, ticks=15, **changes):
    """One after the other in one plant."""
    simulation = Simulation(SimulationParameters(**changes), GAIT)
    try:
        for seed in seeds:
            states = [simulation.reset(seed)]
            while states[-1].running and len(states) <= ticks:
                states.append(simulation.step(np.array([-10.0, -25.0, 10.0, -10.0])))
            yield states
    finally:
        simulation.close()


NOISY = {"velocity_noise": 0.1, "force_noise": 3.0, "motor_lag": 0.004}


@pytest.mark.parametrize("plant", ["mujoco", "pybullet", "rigid"])
@pytest.mark.parametrize("terrain", ["flat", "stones"])
def test_an_episode_is_its_seed(plant, terrain):
    made = {"plant": plant, "terrain": terrain, **NOISY}
    (first, other, again), (elsewhere,) = episodes((5, 6, 5), **made), episodes((5,), **made)
    for a, b in zip(2 * first, again + elsewhere, strict=True):
        assert (a.q == b.q).all()
        assert (a.dq == b.dq).all()
        assert (a.foot_force == b.foot_force).all()
        assert a.preview == b.preview
    assert np.abs(first[0].q - other[0].q).max() > 1e-3
    assert np.abs(first[-1].q[2:] - other[-1].q[2:]).max() > 1e-3


def step_short(plant):
    """A swing leg drawn forward too slowly: its foot comes down between the platform and stone 1."""
    changes = {"fall_height": 0.0, "fall_pitch": 3.1, "x0_spread": 0.0}
    simulation = Simulation(SimulationParameters(plant=plant, **changes), GAIT)
    state = simulation.reset(0)
    while state.running:
        state = simulation.step(np.array([0.0, 0.0, -23.0, 0.0]))
    simulation.close()
    return simulation


@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
def test_a_short_step_falls_into_the_real_gap_and_misses_on_the_rigid_plant(engine):
    """Both plants agree on where it came down, to a few mm after 0.4 s."""
    bullet, rigid = step_short(engine), step_short("rigid")
    assert bullet.outcome is Outcome.GAP_FALL
    assert rigid.outcome is Outcome.MISS
    (short,), (missed,) = bullet.landings, rigid.landings
    assert not short.on_stone
    assert missed.on_stone
    assert bullet.stones[0][1] < short.l < bullet.stones[1][0]
    assert short.l == pytest.approx(missed.l, abs=0.005)
    assert abs(short.tick - missed.tick) <= 1

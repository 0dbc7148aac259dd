"""The plant of any planar robot, here a three-link walker: energy, momentum, impacts, the guard, the door."""

from pathlib import Path

import numpy as np
import pinocchio
import pytest
from pinned_motion import accelerations, drift
from planar_robot import PlanarPlant, UrdfFeet, dynamics_of
from rabbit_description import URDF_PATH
from rabbit_description.planar_urdf import UrdfError, scaled, with_planar_base
from rabbit_description.state import TICK_SECONDS, Leg
from rabbit_sim.kinematics import RabbitFeet

WALKER = Path(__file__).resolve().parents[4] / "examples" / "three_link_walker.urdf"
if not WALKER.is_file():
    pytest.skip("the package is not in the project", allow_module_level=True)
URDF = with_planar_base(WALKER.read_text())
MODEL = pinocchio.buildModelFromXML(URDF)
DATA = MODEL.createData()
WEIGHT = 35 * 9.81  # N


def energy(q, dq):
    return pinocchio.computeKineticEnergy(MODEL, DATA, q, dq) + pinocchio.computePotentialEnergy(MODEL, DATA, q)


def momentum(q, dq, point):
    """Linear (x, z), and angular about +y and `point`."""
    spin = pinocchio.computeCentroidalMomentum(MODEL, DATA, q, dq)
    linear, arm = np.asarray(spin.linear)[[0, 2]], np.asarray(DATA.com[0])[[0, 2]] - point
    return linear, spin.angular[1] + arm[1] * linear[0] - arm[0] * linear[1]


def state(stance_angle, swing_angle, rates=(0.2, 1.5, -1.5), pitch=0.1):
    """`(q, dq)` with the left foot at rest at the origin; leg angles from the vertical, the body's rates in rad/s."""
    q = np.array([0.0, 0.0, pitch, stance_angle - pitch, swing_angle - pitch])
    dq = np.array([0.0, 0.0, rates[0], rates[1] - rates[0], rates[2] - rates[0]])
    feet = UrdfFeet(URDF)
    q[:2] -= feet.positions(q)[Leg.LEFT]
    dq[:2] -= feet.jacobian(q, Leg.LEFT) @ dq
    return q, dq


@pytest.fixture(params=range(3))
def random_state(request):
    q, dq = np.random.default_rng(request.param).uniform(-0.6, 0.6, (2, 5))
    return q, 5 * dq


@pytest.mark.parametrize("leg", Leg)
def test_the_foot_of_a_urdf_moves_as_its_jacobian_says(random_state, leg):
    (q, dq), h, feet = random_state, 1e-6, UrdfFeet(URDF)
    velocity = (feet.positions(q + h * dq) - feet.positions(q - h * dq))[leg] / (2 * h)
    change = (feet.jacobian(q + h * dq, leg) - feet.jacobian(q - h * dq, leg)) / (2 * h) @ dq
    assert feet.jacobian(q, leg) @ dq == pytest.approx(velocity, abs=1e-8)
    assert drift(dynamics_of(URDF), q, dq, leg) == pytest.approx(change, abs=1e-7)


def test_the_urdf_kinematics_of_rabbit_are_the_written_ones():
    urdf, q = URDF_PATH.read_text(), np.random.default_rng(0).normal(0, 0.5, 7)
    ours, written = UrdfFeet(urdf), RabbitFeet()
    assert ours.positions(q) == pytest.approx(written.positions(q), abs=1e-12)
    for leg in Leg:
        assert ours.jacobian(q, leg) == pytest.approx(written.jacobian(q, leg), abs=1e-12)


@pytest.mark.parametrize("leg", Leg)
def test_the_pinned_foot_does_not_accelerate_and_newton_holds(random_state, leg):
    (q, dq), torque, model = random_state, np.array([20.0, -15.0]), dynamics_of(URDF)
    ddq, force = accelerations(model, q, dq, torque, leg)
    assert model.feet.jacobian(q, leg) @ ddq + drift(model, q, dq, leg) == pytest.approx([0, 0], abs=1e-10)
    h, foot = 1e-6, model.feet.positions(q)[leg]
    ends = [momentum(q + s * h * dq, dq + s * h * ddq, foot) for s in (1, -1)]
    assert (ends[0][0] - ends[1][0]) / (2 * h) == pytest.approx(force - [0, WEIGHT], rel=1e-5, abs=1e-3)


@pytest.mark.parametrize("leg", Leg)
def test_impact_identities(random_state, leg):
    (q, dq), model = random_state, dynamics_of(URDF)
    after, impulse = model.impact(q, dq, leg)
    contact = model.feet.positions(q)[leg]
    assert model.feet.jacobian(q, leg) @ after == pytest.approx([0, 0], abs=1e-12)
    assert energy(q, after) <= energy(q, dq)
    before, kept = momentum(q, dq, contact), momentum(q, after, contact)
    assert kept[1] == pytest.approx(before[1], rel=1e-9, abs=1e-9)
    assert kept[0] - before[0] == pytest.approx(impulse, rel=1e-9, abs=1e-9)


def test_twice_the_mass_moves_alike_under_twice_the_torque_and_needs_twice_the_force(random_state):
    (q, dq), torque = random_state, np.array([20.0, -15.0])
    ddq, force = accelerations(dynamics_of(URDF), q, dq, torque, Leg.LEFT)
    heavy_ddq, heavy_force = accelerations(dynamics_of(scaled(URDF, 2.0)), q, dq, 2 * torque, Leg.LEFT)
    assert heavy_ddq == pytest.approx(ddq)
    assert heavy_force == pytest.approx(2 * force)


def test_energy_is_kept_without_torque_and_the_foot_stays():
    q, dq = state(-0.2, 0.2)
    plant = PlanarPlant(dynamics_of(URDF), only_ahead=True)
    plant.reset(q, dq, Leg.LEFT)
    for _ in range(15):
        plant.advance(np.zeros(2))
    reading = plant.observe()
    assert reading.contact.tolist() == [True, False]
    assert energy(reading.q, reading.dq) == pytest.approx(energy(q, dq), rel=1e-9)
    assert reading.foot_position[Leg.LEFT] == pytest.approx([0, 0], abs=1e-10)


def step_down(only_ahead, way=1):
    """Let a robot fall forward, or backward with `way` = -1, until a foot lands; readings before and after, or None."""
    plant = PlanarPlant(dynamics_of(URDF), only_ahead)
    plant.reset(*state(0.3 * way, -0.5 * way, (0.0, 0.8 * way, 0.0)), Leg.LEFT)
    for _ in range(60):
        before = plant.observe()
        plant.advance(np.zeros(2))
        if plant.observe().touches:
            return before, plant.observe()
    return None


def test_the_touchdown_is_located_and_pins_the_foot_that_landed():
    before, after = step_down(only_ahead=True)
    (touch,) = after.touches
    feet = UrdfFeet(URDF)
    assert touch.leg is Leg.RIGHT
    assert touch.x > touch.other_x
    assert after.contact.tolist() == [False, True]
    assert after.foot_position[Leg.RIGHT] == pytest.approx([touch.x, 0], abs=1e-9)
    assert feet.jacobian(after.q, Leg.RIGHT) @ after.dq == pytest.approx([0, 0], abs=1e-9)
    point = np.zeros(2)
    gained = momentum(after.q, after.dq, point)[0] - momentum(before.q, before.dq, point)[0]
    given = after.foot_force.sum(axis=0) * TICK_SECONDS - [0, WEIGHT * TICK_SECONDS]
    assert given == pytest.approx(gained, rel=1e-7)


def test_a_foot_behind_lands_only_if_the_guard_allows_it():
    (touch,) = step_down(only_ahead=False, way=-1)[1].touches
    assert touch.x < touch.other_x - 0.1
    assert step_down(only_ahead=True, way=-1) is None


def test_a_robot_that_is_not_planar_is_refused():
    with pytest.raises(UrdfError, match="not XML"):
        with_planar_base("<robot>")
    with pytest.raises(UrdfError, match="root links"):
        with_planar_base('<robot name="two"><link name="a"/><link name="b"/></robot>')

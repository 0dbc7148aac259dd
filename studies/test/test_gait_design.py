"""A gait found by IPOPT, judged by pinocchio between the nodes too; every shipped one walks as it says."""

import signal

import numpy as np
import pytest
from rabbit_description import GAITS, LIBRARIES
from rabbit_description.gait import Gait, GaitError, load_gait, load_gaits, shipped
from rabbit_gait_design import GaitSpecification, design_gait
from rabbit_gait_design.guess import leg_angles
from rabbit_gait_design.orbit import Orbit

SPECIFICATION = GaitSpecification(
    name="test", step_length=0.36, speed=0.7, friction_limit=0.45, min_normal_force=150, intervals=30
)
Designed = tuple[Gait, list[tuple[int, float, float]]]
BETWEEN_NODES = 0.02  # share by which a limit may be passed between two nodes


@pytest.fixture(scope="module")
def designed() -> Designed:
    iterations: list[tuple[int, float, float]] = []
    gait = design_gait(SPECIFICATION, lambda *progress: iterations.append(progress))
    return gait, iterations


@pytest.fixture(scope="module")
def orbit(designed: Designed) -> Orbit:
    return Orbit(designed[0], 601)


def test_the_orbit_keeps_its_specification(orbit: Orbit) -> None:
    """Step and speed, forces and torques, the swing foot, the knees, the barriers."""
    last = orbit.instants[-1]
    assert last.swing == pytest.approx([0.36, 0], abs=1e-7)
    assert orbit.times[-1] == pytest.approx(0.36 / 0.7, rel=1e-3)
    force, torque = orbit.series("force"), orbit.series("torque")
    assert force[:, 1].min() >= SPECIFICATION.min_normal_force * (1 - BETWEEN_NODES)
    assert np.abs(force[:, 0] / force[:, 1]).max() <= SPECIFICATION.friction_limit * (1 + BETWEEN_NODES)
    assert np.abs(torque).max() <= SPECIFICATION.torque_limit * (1 + BETWEEN_NODES)
    height, landing = orbit.series("swing")[1:-1, 1], last.swing_rate
    bump = 4 * orbit.phases * (1 - orbit.phases)
    assert (height >= SPECIFICATION.clearance * bump[1:-1] * (1 - BETWEEN_NODES) - 1e-5).all()
    assert height.max() <= SPECIFICATION.max_foot_height * (1 + BETWEEN_NODES)
    assert SPECIFICATION.landing_speed - 1e-6 <= -landing[1] <= SPECIFICATION.max_landing_speed + 1e-3
    assert abs(landing[0]) <= SPECIFICATION.max_landing_slide + 1e-3
    assert orbit.series("q")[:, [4, 6]].min() >= SPECIFICATION.knee_range[0] - 1e-4
    assert SPECIFICATION.stone is not None
    conditions = orbit.ecbf_conditions(SPECIFICATION.stone)
    slack = BETWEEN_NODES * np.abs(conditions).max()
    assert conditions.min() >= -min(slack, 1.0)  # m/s^2, against thousands mid-step


def test_impact_and_relabelling_return_to_the_start_and_the_walk_is_stable(designed: Designed, orbit: Orbit) -> None:
    """And it has momentum to spare."""
    coeffs, figures = designed[0].coeffs, designed[0].metadata["figures"]
    q, dq, impulse = orbit.after_impact()
    start_q, start_dq = designed[0].x_start
    assert q == pytest.approx(start_q, abs=1e-7)
    assert dq == pytest.approx(start_dq, abs=1e-3)  # the collocation error of 12 intervals
    assert impulse[1] > 0
    assert abs(impulse[0]) <= 0.8 * impulse[1]
    assert coeffs[[2, 3, 0, 1], -1] == pytest.approx(coeffs[:, 0], abs=1e-7)
    assert 0 < figures["eigenvalue"] < 1
    assert figures["start_phase_rate"] > figures["least_phase_rate"]


def test_a_signal_stops_the_search_and_is_heard(request: pytest.FixtureRequest) -> None:
    """Not as a search that found nothing, and not lost in CasADi."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell in the background ignores it
    request.addfinalizer(lambda: signal.signal(signal.SIGINT, before))
    iterations: list[int] = []

    def interrupt(iteration: int, *_: float) -> None:
        iterations.append(iteration)
        if iteration == 2:
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        design_gait(SPECIFICATION, interrupt)
    assert iterations[-1] == 2
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_leg_angles_reach_the_foot() -> None:
    rng = np.random.default_rng(0)
    wanted = np.column_stack([rng.uniform(-0.3, 0.3, 20), rng.uniform(-0.74, -0.5, 20)])
    hip, knee = leg_angles(wanted, 0.2).T
    thigh, shin = 0.2 + hip, 0.2 + hip + knee
    reached = -0.4 * np.column_stack([np.sin(thigh) + np.sin(shin), np.cos(thigh) + np.cos(shin)])
    assert reached == pytest.approx(wanted, abs=1e-12)
    assert (knee > 0).all()


DESIGNED = [name for name in shipped(GAITS) if "specification" in load_gait(name).metadata]
OF_LIBRARIES = [
    pytest.param(gait, marks=pytest.mark.thorough, id=gait.name)
    for name in shipped(LIBRARIES)
    for gait in load_gaits(name).gaits  # type: ignore[union-attr]
]


@pytest.mark.parametrize("name", shipped(GAITS))
def test_shipped_gait_starts_near_its_own_curve(name: str) -> None:
    """The first author's start is a state of his closed loop, some 0.02 rad beside his curves; ours lie on them."""
    gait, tolerance = load_gait(name), 1e-6 if name in DESIGNED else 0.03
    q, dq = gait.x_start
    assert gait.name == name
    assert q[2] + q[3] + q[4] / 2 == pytest.approx(gait.phase_angle_start, abs=tolerance)
    assert q[3:] == pytest.approx(gait.coeffs[:, 0], abs=tolerance)
    assert np.isfinite(dq).all()


@pytest.mark.parametrize("gait", [*map(load_gait, DESIGNED), *OF_LIBRARIES], ids=lambda gait: gait.name)
def test_shipped_gait_keeps_its_specification_and_its_figures(gait: Gait) -> None:
    spec, orbit = GaitSpecification(**gait.metadata["specification"]), Orbit(gait)
    figures = orbit.figures()
    assert figures.closure_error < 2e-4
    assert figures.speed == pytest.approx(spec.speed, rel=1e-3)
    assert figures.friction_used <= 1.02 * spec.friction_limit
    assert figures.least_normal_force >= 0.97 * spec.min_normal_force
    assert figures.peak_torque <= 1.02 * spec.torque_limit
    assert figures.least_phase_rate < figures.start_phase_rate
    for key, value in gait.metadata["figures"].items():
        assert getattr(figures, key) == pytest.approx(value, rel=1e-3, abs=2e-4), key


def test_no_such_gait_names_those_that_exist() -> None:
    with pytest.raises(GaitError, match=DESIGNED[0]):
        load_gait("moonwalk")

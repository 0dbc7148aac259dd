"""One tick of the controller: what goes in, which rows there are, what comes out, and why."""

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp import Barrier, Clf, Estimates, Rows, System, Terms, Tick, at_most
from rabbit_description import DEFAULT_GAIT
from rabbit_description.gait import load_gait
from rabbit_description.robot_states import RobotStates
from rabbit_description.state import SWAP_STATE, SWAP_TORQUE, Leg, StonePreview
from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.explanation import Explanation, explain
from rl_cbf_clf_controller.policy import Policy
from rl_cbf_clf_controller.scene import ControllerError
from rl_cbf_clf_controller.walking import GAINS
from scipy.optimize import nnls
from walking_states import make_controller, state_of

GAIT = load_gait(DEFAULT_GAIT)


def make(controller="cbf-clf-qp", policy=None, **changes):
    return make_controller(policy, controller=controller, **changes)


def state(tick=0, swap=False, **changes):
    order = SWAP_STATE if swap else np.arange(7)
    start = {name: value[order] for name, value in zip(("q", "dq"), GAIT.x_start, strict=True)}
    return state_of(tick=tick, **start | changes)


def precontrol(scene, mu):
    """u (4,) that gives the outputs the acceleration `mu`, by the nominal model."""
    return scene.seen.control_a @ mu + scene.seen.control_b


class FixedPolicy(Policy):
    """The same estimates at every tick."""

    version = "fixed"

    def __init__(self, alpha, beta):
        self._estimates = Estimates(alpha, beta)

    def estimate(self, scene, before):
        return self._estimates


@pytest.mark.parametrize(
    ("controller", "changes", "names"),
    [
        ("clf-qp", {}, ["CLF"]),
        ("io-rl-clf-qp", {}, ["CLF"]),
        ("l1-clf-qp", {}, ["CLF"]),
        ("clf-qp", {"flat_force_rows": True}, ["CLF", "C1", "C2+", "C2-"]),
        ("io-rl-clf-qp", {"flat_force_rows": True}, ["CLF", "C1", "C2+", "C2-"]),
        ("l1-clf-qp", {"flat_force_rows": True, "cone": "literal"}, ["CLF", "C1", "C2"]),
        ("cbf-clf-qp", {}, ["CLF", "B1", "B2", "C1", "C2+", "C2-"]),
        ("rl-cbf-clf-qp", {}, ["CLF", "B1", "B2", "C1", "C2+", "C2-"]),
        ("robust-cbf-clf-qp", {}, 2 * ["CLF", "B1", "B2", "C1", "C2+", "C2-"]),
        ("cbf-clf-qp", {"force_rows": False}, ["CLF", "B1", "B2"]),
        ("cbf-clf-qp", {"barrier_rows": False}, ["CLF", "C1", "C2+", "C2-"]),
        ("cbf-clf-qp", {"cone": "literal"}, ["CLF", "B1", "B2", "C1", "C2"]),
    ],
)
def test_which_qp_has_which_rows(controller, changes, names):
    assert make(controller, **changes).qp.layout.names == (*names, "u1", "u2", "u3", "u4")


def test_the_robot_is_symmetric():
    """With legs and names swapped the torque is the same but for the legs' order."""
    left, right = make(), make()
    right.memory.stance[:] = Leg.RIGHT
    torque = left.step(state()).torque
    mirrored = right.step(state(swap=True, contact=np.array([False, True]))).torque
    assert mirrored == pytest.approx(torque[SWAP_TORQUE], abs=1e-9)


@pytest.mark.parametrize("sigma", [0.0, 1000.0])
def test_torque_is_the_precontrol_of_mu_also_where_noise_saturates_it(sigma):
    built = make(sigma=sigma)
    output, scene = built.step(state()), built.look(state())
    assert output.torque == pytest.approx(precontrol(scene, output.mu), abs=1e-6)
    assert output.saturated == (sigma > 0)
    if sigma:
        assert np.abs(output.torque).max() == pytest.approx(200.0)
    else:
        assert output.mu == pytest.approx(output.mu_qp)


def test_l1_adds_its_compensation():
    built = make("l1-clf-qp")
    built.step(state())
    q, dq = GAIT.x_start
    later = state(tick=1, q=q + 0.01 * dq, dq=dq + 0.3)  # not what the model says
    output = built.step(later)
    assert output.alpha == pytest.approx(0)
    assert np.abs(output.beta).max() > 1
    assert output.torque == pytest.approx(precontrol(built.look(later), output.mu + output.beta))


def test_legs_swap_at_a_touchdown_and_not_before_its_time_and_a_touchdown_unseen_is_a_fault():
    built, landed = make("clf-qp"), np.array([True, True])
    end = GAIT.x_start[0].copy()
    end[2] += GAIT.phase_angle_end - GAIT.phase_angle_start  # the phase of the impact
    assert built.step(state(tick=5, q=end, contact=landed)).stance is Leg.LEFT
    assert built.step(state(tick=40, contact=landed)).stance is Leg.LEFT  # the phase of the start
    output = built.step(state(tick=41, q=end, contact=landed, touchdowns=1))
    assert (output.stance, output.step_index, output.fault) == (Leg.RIGHT, 1, "")
    assert "contact disagreement" in make("clf-qp").step(state(touchdowns=1)).fault


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"q": np.full(7, np.nan)}, "state.q"),
        ({"dq": np.zeros(6)}, "state.dq"),
        ({"preview": None}, "expected stone 1"),
        ({"preview": StonePreview(2, 0.35, 0.4)}, "expected stone 1"),
        ({"preview": StonePreview(1, 0.4, 0.35)}, "0 < l_min < l_max"),
        ({"preview": StonePreview(1, np.nan, 0.35)}, "0 < l_min < l_max"),
    ],
)
def test_bad_states_are_refused(changes, message):
    with pytest.raises(ControllerError, match=message):
        make().step(state(**changes))


CHANGED = {
    "eps": 0.05,
    "slack_weight": 100.0,
    "torque_change_weight": 0.02,
    "barrier_pole_1": 30.0,
    "barrier_pole_2": 110.0,
    "R1": 2.0,
    "R2": 0.3,
    "stone_margin": 0.015,
    "friction_coeff": 0.6,
    "friction_margin": 0.35,
    "min_normal_force": 80.0,
    "torque_limit": 60.0,
    "robust_scale_min": 0.6,
    "robust_scale_max": 2.7,
}


def states_of_a_walk(count, seed):
    """States beside the gait, as far apart as a walk's ticks are not."""
    rng = np.random.default_rng(seed)
    q, dq = GAIT.x_start
    for tick in range(count):
        stone = StonePreview(1, 0.30 + 0.05 * rng.random(), 0.42)
        yield state(tick, q=q + rng.normal(0, 0.03, 7), dq=dq + rng.normal(0, 0.3, 7), preview=stone)


@pytest.mark.parametrize(("kind", "objective"), [("rl-cbf-clf-qp", "pd_centred"), ("robust-cbf-clf-qp", "paper")])
def test_a_parameter_that_changes_between_two_ticks_holds_from_the_next_one_on(kind, objective):
    """Half of them at random, those left, and all: the torque is that of a controller built with these values."""
    assert set(CHANGED) == set(GAINS)
    rng, walking = np.random.default_rng(0), make(kind, objective=objective, qp_solver="daqp")
    half = rng.choice(GAINS, len(GAINS) // 2, replace=False)
    settings = [{name: CHANGED[name] for name in chosen} for chosen in (half, set(GAINS) - {*half}, GAINS)]
    for changes, at in zip(settings, states_of_a_walk(len(settings), 1), strict=True):
        at = replace(at, applied=np.array([10.0, -20.0, 30.0, 5.0]))
        built = make(kind, objective=objective, qp_solver="daqp", **changes)
        walking.parameters = built.parameters
        assert walking.step(at).torque == pytest.approx(built.step(at).torque, abs=1e-7)


@pytest.mark.parametrize("tracks", [False, True])
def test_a_stone_stays_in_its_place_while_the_foot_falls_with_its_own(tracks):
    """By 2 cm down and 1 cm ahead, in a tick in which it carries nothing; a foot that carries the robot stands."""
    walking, carries = make(stone_tracking=tracks), np.array([[0.0, 300.0], [0.0, 0.0]])
    fallen = GAIT.x_start[0] + np.array([0.01, -0.02, 0, 0, 0, 0, 0])
    seen = []
    for tick, (q, force) in enumerate(((0, carries), (1, 0 * carries), (0, carries), (0, carries), (1, carries))):
        walking.step(replace(state(tick, q=fallen if q else GAIT.x_start[0]), foot_force=force))
        seen.append(walking.scene.seen.stone)
    there, moved = (0.35, 0.40, 0.0), (0.34, 0.39, 0.02)
    expected = [there, moved, there, there, there] if tracks else [there] * 5
    assert np.array(seen) == pytest.approx(np.array(expected), abs=1e-12)


def test_nothing_is_measured_over_a_tick_in_which_a_gain_changed():
    """V before is that of another gain, so that their difference is no rate."""
    walking = make("rl-cbf-clf-qp")
    for tick, changes in enumerate(({}, {}, {"eps": 0.05}, {}, {"sigma": 0.1})):
        walking.parameters = walking.parameters.model_copy(update=changes)
        assert np.isfinite(walking.step(state(tick)).measured).all() == (tick not in (0, 2))


def test_another_policy_between_two_ticks_gives_its_own_torque():
    """Two that look alike but for their numbers."""
    estimates = [(np.full((5, 4), share), np.full(5, 10 * share)) for share in (0.0, 0.1, 0.2)]
    walking = make("rl-cbf-clf-qp", FixedPolicy(*estimates[0]))
    for tick, said in enumerate([*estimates, *estimates[::-1]]):
        walking.policy = FixedPolicy(*said)
        fresh = make("rl-cbf-clf-qp", FixedPolicy(*said))
        assert walking.step(state(tick)).torque == pytest.approx(fresh.step(state(tick)).torque, abs=1e-6)


MASS, LIMIT, POLE = 2.0, 100.0, 8.0
M, ROWS = 3, 6


def cart(limit: float | None = LIMIT, **options: Any) -> Tick:
    """Pulled to x = 1 m between two walls."""
    x, v, u, left, right = (ca.SX.sym(name) for name in ("x", "v", "u", "left", "right"))
    system = System(ca.vertcat(x, v), u, ca.vertcat(v, u / MASS), [left, right])
    walls = [Barrier(name, B, (POLE, POLE)) for name, B in (("left", x - left), ("right", right - x))]
    return Tick(system, [Clf(x - 1, eps=0.2), *walls], limit=limit, **options)


def explained(tick: Tick, x: float, v: float, left: float = -9.0, right: float = 0.9, **estimates: Any) -> Explanation:
    """At a state, between these walls."""
    error = Estimates(**estimates) if estimates else None
    return explain(tick, np.array([x, v]), tick.p(left=left, right=right), error)


def asked(B: float, rate: float) -> float:
    """B'' of a barrier, at least."""
    return -(POLE**2) * B - 2 * POLE * rate


def test_a_wall_that_is_too_near_excludes_the_limit() -> None:
    told = explained(cart(), x=0.8, v=5.0)
    least = asked(0.1, -5.0)  # 73.6 m/s^2
    assert told.excluding == {"right": "at least 73.6", "u1": "at least -100"}
    assert told.factor == pytest.approx(least * MASS / LIMIT, rel=1e-5)
    rows = {row.name: row for row in told.rows}
    wall = rows["right"]
    assert wall.lower == pytest.approx(least)
    assert wall.upper == np.inf
    assert wall.value == pytest.approx(-told.w[0] / MASS)
    assert wall.gives_way == pytest.approx(least - LIMIT / MASS, rel=1e-4)
    assert (wall.kind, rows["CLF"].kind, rows["u1"].kind) == ("last resort", "soft", "hard")
    assert rows["u1"].value == told.w[0] == pytest.approx(-LIMIT)
    assert rows["right"].state == "gives way"
    assert rows["left"].state == ""
    assert "  right: at least 73.6" in told.lines()
    assert "  right, keep off: at least 73.6 m/s²" in told.lines({"right": ("keep off", "m/s²")})


@pytest.mark.parametrize("limit", [LIMIT, None])
def test_walls_that_have_changed_places_exclude_each_other_whatever_the_force(limit: float | None) -> None:
    told = explained(cart(limit), x=0.95, v=0.3, left=1.0, right=0.9)
    assert set(told.excluding) == {"left", "right"}
    assert told.factor == (None if limit is None else np.inf)
    assert any("No input would do" in line for line in told.lines()) == (limit is not None)


def test_where_nothing_excludes_the_soft_row_pays() -> None:
    told = explained(cart(), x=0.85, v=0.1)
    assert told.excluding == {}
    least = max(asked(0.05, -0.1), 0) * MASS / LIMIT  # the wall asks for less than the cart is pulled by
    assert told.factor == pytest.approx(least, abs=1e-5)
    (paying,) = (row for row in told.rows if row.gives_way > 1e-3)
    assert paying.name == "CLF"
    assert any(line.startswith("CLF gives way by") and "soft" in line for line in told.lines())


def test_a_row_that_the_model_kept_and_the_cart_did_not_says_so() -> None:
    """A cart of twice the mass brakes half as much as the model promised, so the wall's row is not kept."""
    tick, x = cart(), np.array([0.8, 1.0])
    p = tick.p(left=-9.0, right=0.9)
    promised = {row.name: row for row in explain(tick, x, p).rows}
    assert promised["right"].value == pytest.approx(asked(0.1, -1.0), rel=1e-3)
    B = np.array([promised["left"].value, promised["right"].value]) / 2
    told = explain(tick, x, p, measured=np.array([np.nan, *B]))
    rows = {row.name: row for row in told.rows}
    assert rows["right"].measured == pytest.approx(B[1])
    assert {name for name, row in rows.items() if row.is_broken} == {"right"}
    assert {name for name, row in rows.items() if np.isnan(row.measured)} == {"CLF", "u1"}
    assert any(line.startswith("right was kept in the model, not by the robot: promised") for line in told.lines())


def test_a_row_is_the_model_and_the_share_of_the_estimates() -> None:
    alpha, beta = np.array([[0.0], [0.3], [0.5]]), np.array([0.0, 1.0, -4.0])
    told = explained(cart(), x=0.8, v=1.0, alpha=alpha, beta=beta)
    mu, rows = told.w[0] / MASS, {row.name: row for row in told.rows}
    assert rows["right"].nominal == pytest.approx(-mu)
    assert rows["right"].estimated == pytest.approx(0.5 * mu - 4)
    assert rows["left"].nominal == pytest.approx(mu)
    assert rows["left"].estimated == pytest.approx(0.3 * mu + 1)
    assert rows["u1"].estimated == pytest.approx(0.0)


def rows_of_random() -> Tick:
    """Rows of last resort that are parameters, over u in R^3 with a limit."""
    A, upper, x, u = ca.SX.sym("A", ROWS, M), ca.SX.sym("upper", ROWS), ca.SX.sym("x"), ca.SX.sym("u", M)
    system = System(x, u, ca.sum1(u), {"A": A, "upper": upper})

    def rows(terms: Terms) -> list[Rows]:
        return [at_most([f"r{i}" for i in range(ROWS)], A, upper, 10.0)]

    return Tick(system, [], constraints=[rows], limit=1.0)


def excludes(A: Any, b: Any) -> bool:
    """Whether A u <= b has no solution: y >= 0 with A'y = 0 and b'y = -1 (Farkas), by Lawson and Hanson's algorithm."""
    return len(b) > 0 and bool(nnls(np.vstack([A.T, b]), np.append(np.zeros(A.shape[1]), -1.0))[1] < 1e-8)


def test_random_rows_have_a_certificate_and_every_proper_subset_a_solution() -> None:
    tick, rng, found = rows_of_random(), np.random.default_rng(3), set()
    for _ in range(60):
        A, upper = rng.normal(size=(ROWS, M)) * rng.integers(2, size=(ROWS, M)), rng.normal(size=ROWS) - 0.3
        told = explain(tick, np.zeros(1), tick.p(A=A, upper=upper))
        every_A, every_b = np.vstack([A, np.eye(M), -np.eye(M)]), np.concatenate([upper, np.ones(2 * M)])
        names = [f"r{i}" for i in range(ROWS)] + [f"u{i + 1}" for i in range(M)] * 2
        sides = ["at most"] * (ROWS + M) + ["at least"] * M
        assert bool(told.excluding) == excludes(every_A, every_b)
        chosen = [i for i, name in enumerate(names) if told.excluding.get(name, "").startswith(sides[i])]
        assert len(chosen) == len(told.excluding) <= M + 1
        if chosen:
            assert excludes(every_A[chosen], every_b[chosen])
            assert not any(excludes(every_A[rest], every_b[rest]) for rest in (np.setdiff1d(chosen, i) for i in chosen))
        assert told.factor is not None
        for factor in (0.99 * told.factor, 1.01 * told.factor) if 0 < told.factor < np.inf else ():
            limited = np.concatenate([upper, factor * np.ones(2 * M)])
            assert excludes(every_A, limited) == (factor < told.factor)
        found.add((len(chosen), told.factor < np.inf))
    assert {(0, True), (1, False), (2, True), (3, True), (4, True), (2, False)} <= found


def test_robots_with_policies_of_their_own_walk_as_alone():
    """Whichever comes first."""
    policies = make().policy, FixedPolicy(np.full((5, 4), 0.1), np.full(5, 5.0))
    alone = [make(policy=policy).step(state()) for policy in policies]
    for order in ((0, 1, 0), (1, 0, 0)):
        output = BatchController(make(), [policies[i] for i in order]).step(RobotStates.of([state()] * 3))
        for robot, i in enumerate(order):
            assert np.array_equal(output[robot].beta, alone[i].beta)
            assert np.array_equal(output[robot].mu, alone[i].mu)


def test_noise_ends_with_sigma_also_where_robots_have_gone_meanwhile():
    robots = BatchController(walking := make(sigma=50.0), [walking.policy] * 2)
    robots.step(RobotStates.of([state()] * 2))
    robots.set_parameters(make().parameters)
    robots.keep(np.array([1]))
    output = robots.step(RobotStates.of([state(tick=1)]))[0]
    assert np.array_equal(output.mu, output.mu_qp)

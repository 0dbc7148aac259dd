"""The methods as the benchmark takes them, and files that are refused."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from cbf_clf_qp.constraints import ResClf
from rabbit_benchmark.cells import cells
from rabbit_benchmark.methods import method
from rabbit_benchmark.protocol import Protocol
from rabbit_description.gait import load_gaits
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.provenance import plain
from rabbit_reproduce.controllers import BEST
from rabbit_rivals import methods
from rabbit_rivals.gp_controller import GpAbout, GpController, GpPolicy
from rabbit_rivals.model_file import read

TINY = Protocol(courses=1, stones=1)


@pytest.mark.parametrize("name", ["dagger", "ddpg-sb3", "gp-socp", "pd", "ppo", "regression", "sac"])
@pytest.mark.parametrize("terrain", ["stones", "flat"])
def test_each_takes_a_step_in_the_benchmark(name: str, terrain: str) -> None:
    if name == "gp-socp":
        pytest.importorskip("clarabel")
    (walk,) = TINY.walks(method(name), cells()[f"{terrain}/scale-1"])
    row = walk.do().row
    assert row.ticks > (5 if name == "ddpg-sb3" else 30)


def test_a_controller_mixed_with_itself_is_itself() -> None:
    """The student's file decides the result as its own does."""
    best, dagger = BEST["stones"], methods.DAGGER.on("stones")
    mixed, own = (replace(best, kind=kind) for kind in (partial(methods.MixedAssembly, student=best), Assembly))
    simulation, controller = mixed.assembly(mass_scale=2.0).build()
    alone, state = own.assembly().make_controller(), simulation.reset(1)
    controller.reset(1)
    alone.reset(1)
    assert controller.step(state).torque == pytest.approx(alone.step(state).torque, rel=1e-12)
    simulation.close()
    assert dagger.policy in str(plain(methods.MIXTURE.on("stones").assembly()))


def test_a_gp_without_confidence_decides_as_the_qp() -> None:
    pytest.importorskip("clarabel")
    assembly = methods.GP_SOCP.on("stones").assembly(mass_scale=2.0)
    simulation, _ = assembly.build()
    policy = GpPolicy(read(Path(assembly.policy), GpAbout), 0.0)
    controller = GpController(assembly.controller, load_gaits(assembly.controller.gait), policy)
    state = simulation.reset(1)
    controller.reset(1)
    for _ in range(20):
        state = simulation.step(controller.step(state).torque)
    scene = controller.scene
    qp = controller.qp.decide(scene.x, scene.p, controller.estimates)
    assert controller.decided.mu == pytest.approx(qp.mu, abs=1e-2)
    simulation.close()


def test_more_confidence_asks_for_more() -> None:
    pytest.importorskip("clarabel")
    assembly = methods.GP_SOCP.on("flat").assembly(mass_scale=2.0)
    simulation, _ = assembly.build()
    state = simulation.reset(1)
    file, found = read(Path(assembly.policy), GpAbout), []
    for confidence in (0.0, 1.0, 3.0):
        controller = GpController(assembly.controller, load_gaits(assembly.controller.gait), GpPolicy(file, confidence))
        controller.reset(1)
        controller.step(state)
        mu, estimates = controller.decided.mu, controller.estimates
        seen, p = controller.scene.seen, controller.parameters
        a, b = seen.nominal_a[0] + estimates.alpha[0], seen.nominal_b[0] + estimates.beta[0]
        slack = controller.decided.values.slack.sum() * np.linalg.norm(a)  # it is in units of mu
        deviation = np.linalg.norm(controller.policy.deviations[0] @ [1, *mu])
        bound = -float(ResClf(4, p.eps, (p.kp, p.kd)).rate) * seen.V[0]
        assert a @ mu + b + confidence * deviation <= bound + slack + 1e-3 * abs(bound)
        found.append(np.linalg.norm(mu))
    assert found == sorted(found)
    simulation.close()

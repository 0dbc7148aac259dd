"""The walk in the browser, without one: its code in node against Python, torque by torque and course by course."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from built_walk_page import build
from rabbit_experiments.assembly import Assembly, resolve_policy
from rabbit_experiments.walk_records import about_walk
from rabbit_in_browser.build import FOLDER
from rabbit_in_browser.numbers import CONTROLLERS
from rabbit_sim.mujoco_plant import robot_mjcf
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.robot_urdf import perturbed_urdf
from rabbit_sim.simulation import Simulation
from rabbit_viewer.page.rows import RowMaker
from rl_cbf_clf_controller.controller import Controller
from rl_trainer.rollout import Record, rollout

ROOT = Path(__file__).resolve().parents[2]
NODE = Path(__file__).with_name("walk_in_node.mjs")
OPTIMAL = 1e-9  # KKT residual of an answer, DAQP's own tolerance
EQUAL = 1e-6  # N m
SEEDS = range(1, 21)
SETTINGS: dict[str, float] = {"mass_scale": 2.0, "payload": 0.0, "ground_friction": 1.5, "stone_width": 0.05}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page, built."""
    return build(tmp_path_factory.mktemp("site")) / FOLDER


def ask(folder: Path, **question: Any) -> Any:
    """What the page's code answers in node."""
    command = [str(shutil.which("node")), str(NODE), str(folder)]
    done = subprocess.run(command, input=json.dumps(question), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def assembly(name: str, **settings: float) -> Assembly:
    """Of one of the page's controllers in Python."""
    parameters, policy = CONTROLLERS[name]
    plant = SimulationParameters.model_validate({"plant": "mujoco", **SETTINGS, **settings})
    return Assembly(plant, parameters, resolve_policy(policy, parameters))


def as_json(record: Record) -> dict[str, Any]:
    """A state as the page's controller reads it."""
    state = record.state
    assert state.preview
    return {
        **{"tick": state.tick, "q": state.q.tolist(), "dq": state.dq.tolist(), "force": state.foot_force.tolist()},
        **{"contact": state.contact.tolist(), "touchdowns": state.touchdowns},
        "preview": vars(state.preview),
        "applied": state.applied.tolist() if np.isfinite(state.applied).all() else None,
    }


def endings(simulation: Simulation, controller: Controller) -> list[tuple[str, int]]:
    """How the walks of 20 seeds end, and after how many stones."""
    found = []
    for seed in SEEDS:
        records: list[Record] = []
        last = rollout(simulation, controller, seed, records.append)
        found.append((records[-1].output.fault or simulation.outcome.value, last.touchdowns))
    return found


@pytest.mark.parametrize("name", CONTROLLERS)
def test_torques_and_rows_on_the_same_states(folder: Path, name: str) -> None:
    parts = assembly(name, mass_scale=1.5)
    records: list[Record] = []
    simulation, controller = parts.build()
    rollout(simulation, controller, 1, records.append)
    assert records[-1].state.touchdowns == 19  # 20 stones
    wanted = np.array([record.output.torque for record in records])
    found = ask(folder, ask="torques", name=name, states=[as_json(record) for record in records])
    assert max(answer["residual"] for answer in found) < OPTIMAL
    torques = np.array([answer["torque"] for answer in found])
    np.testing.assert_allclose(torques, wanted, rtol=0, atol=EQUAL)
    about = about_walk(parts.controller, parts.simulation, "", 1, "")
    maker = RowMaker(about, controller.qp.names, controller.barrier_names)
    rows = np.array([maker.row(record.state, record.output) for record in records])
    drawn = np.array([answer["row"] for answer in found], dtype=float)  # JSON has null for NaN
    is_slack = np.array(["slack" in name for name in maker.columns])  # near 0 where the CLF's row is: a step's start
    np.testing.assert_allclose(drawn[:, ~is_slack], rows[:, ~is_slack], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(drawn[:, is_slack], rows[:, is_slack], rtol=1e-6, atol=1e-4)
    print(f"{name}: {np.abs(torques - wanted).max():.2g} N m")


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        *((name, {}) for name in CONTROLLERS),
        ("best", {"mass_scale": 3.0, "payload": 40.0}),
        ("nominal, tuned", {"mass_scale": 3.0}),
        ("learned", {"mass_scale": 3.0}),
        ("learned", {"mass_scale": 1.0, "payload": 40.0}),
        ("nominal, tuned", {"ground_friction": 0.7, "stone_width": 0.03}),
    ],
)
def test_twenty_courses_end_as_in_python(folder: Path, name: str, settings: dict[str, float]) -> None:
    """Also where robots fall, and a rounding decides after which stone."""
    answers = ask(folder, ask="walks", name=name, settings={**SETTINGS, **settings}, seeds=[*SEEDS])
    wanted = endings(*assembly(name, **settings).build())
    assert [(answer["outcome"], answer["stones"]) for answer in answers] == wanted
    assert not settings or {outcome for outcome, _ in wanted} > {"walked"}


@pytest.mark.parametrize("settings", [{}, {"mass_scale": 1.7, "payload": 30.0, "ground_friction": 0.6}])
def test_the_robot_in_mujocos_xml(folder: Path, settings: dict[str, float]) -> None:
    plant = SimulationParameters.model_validate({"plant": "mujoco", **SETTINGS, **settings})
    text = robot_mjcf(perturbed_urdf(plant), plant.ground_friction, plant.sole_radius)
    found = ElementTree.fromstring(ask(folder, ask="mjcf", settings={**SETTINGS, **settings}))
    for one, other in zip(found.iter(), ElementTree.fromstring(text).iter(), strict=True):
        assert one.attrib.keys() == other.attrib.keys()
        for name, value in other.attrib.items():
            try:
                wanted = [float(word) for word in value.split()]
            except ValueError:
                assert one.attrib[name] == value
            else:
                assert [float(word) for word in one.attrib[name].split()] == pytest.approx(wanted, rel=1e-14)


def test_mujoco_has_pythons_version() -> None:
    package = json.loads((ROOT / "requirements/npm/package.json").read_text())
    assert package["dependencies"]["@mujoco/mujoco"] == mujoco.__version__

"""What `rabbit export` writes: compiled, it walks as in Python. A tick has the same bits however it is computed."""

import ctypes
import re
import subprocess
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cbf_clf_qp.compiled import COMPILE
from rabbit_description.state import RobotState
from rabbit_description.task_source import load_task
from rabbit_estimator.contact_aided_filter import sensors_row
from rabbit_experiments.assembly import Assembly, exported_estimator, resolve_policy
from rabbit_sim.c_example import ExampleError, check_plant, write_example
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.export import ExportError, export, export_ride
from rl_cbf_clf_controller.kinds import NAMES
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.task_controller import TaskController
from rl_trainer.task_episode import ride_of
from rl_trainer.task_training import train
from walked import walked

SEED, STONES = 17, 6
EXAMPLES = Path(__file__).parents[2] / "examples"
THOROUGH = pytest.mark.thorough
CASES = [
    ("ours", "zero", {"mass_scale": 1.0}),
    ("l1-clf-qp", "zero", {"mass_scale": 1.2, "terrain": "flat"}),
    pytest.param("best", "zero", {}, marks=THOROUGH),
    pytest.param("ours", "rl-cbf-clf-qp", {}, marks=THOROUGH),
    pytest.param("best", "zero", {"sensors": "lab"}, marks=THOROUGH),
]


@pytest.mark.parametrize(("name", "policy", "plant"), CASES)
def test_each_torque_has_the_bits_of_pythons(name: str, policy: str, plant: dict[str, Any], tmp_path: Path) -> None:
    own, terrain = {"controller": name} if name in NAMES else {}, plant.get("terrain", "stones")
    parameters = load_parameters("ours" if own else name, terrain, qp_solver="daqp", **own)
    robot = SimulationParameters(**{"plant": "mujoco", "mass_scale": 2.0, "stones": STONES, **plant})
    parts = Assembly(robot, parameters, resolve_policy(policy, parameters))
    simulation, controller = parts.build()
    export(controller, tmp_path, None, exported_estimator(robot))
    write_example(tmp_path, simulation, SEED)
    subprocess.run(["make", "-s", "-C", tmp_path], check=True)
    said = subprocess.run(["./example", "torques"], cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    in_python = np.array([record.output.torque for record in walked(parts, SEED)[0]])
    assert (tmp_path / "torques").read_bytes() == in_python.tobytes()
    assert said == f"{STONES} of {STONES} stones in {len(in_python)} ticks\n"


@THOROUGH
def test_a_call_says_what_is_wrong_and_a_tick_calls_nothing_that_waits(tmp_path: Path) -> None:
    """With the library that it makes, called from here."""
    parameters = load_parameters("best", "stones", qp_solver="daqp")
    robot = SimulationParameters(plant="mujoco", sensors="lab", mass_scale=2.0)
    simulation, controller = Assembly(robot, parameters, "zero").build()
    export(controller, tmp_path, None, exported_estimator(robot))
    write_example(tmp_path, simulation, SEED)
    subprocess.run(["make", "-s", "-C", tmp_path, "daqp/daqp.a"], check=True)
    flags = ["-O0", "-w", "-shared", "-fPIC", "-Idaqp/include", "-Idaqp/include/daqp"]
    made = [*flags, "controller.c", "daqp/daqp.a", "-lm", "-o", "made.so"]
    subprocess.run(["cc", *made], cwd=tmp_path, check=True)
    called = subprocess.run(["nm", "-Du", "made.so"], cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    assert not re.search("alloc|free|pthread|open", called)

    library, text = ctypes.CDLL(str(tmp_path / "made.so")), (tmp_path / "controller.h").read_text()
    at = {name: int(place) for name, place in re.findall(r"#define (\w+) (\d+)", text)}
    memory, sensors, reading, settings, report = (
        (ctypes.c_double * at[f"{name}_SIZE"])() for name in ("MEMORY", "SENSORS", "READING", "SETTINGS", "REPORT")
    )
    first = simulation.reset(SEED)

    def code(tick: int, **changes: float) -> int:
        """Of a tick of the robot as it stands at first."""
        assert first.sensors
        assert first.preview
        library.controller_settings(settings)
        said = sensors_row(replace(first, tick=tick), first.sensors)
        sensors[:] = np.nan_to_num(said)
        reading[at["READING_STONE"] : at["READING_STONE"] + 4] = astuple(first.preview)
        for name, value in changes.items():
            row = {"SENSORS": sensors, "READING": reading, "SETTINGS": settings}[name.split("_")[0]]
            row[at[name]] = value
        before = bytes(memory)
        found = int(library.controller_step_from_sensors(memory, sensors, reading, settings, report))
        assert (bytes(memory) == before) == (found in (3, 8, 12))
        return found

    library.controller_first(memory)
    assert code(1) == 12
    assert [code(0), code(1), code(3), code(2)] == [0, 0, 12, 0]
    assert code(3, SENSORS_JOINT_RATES=np.nan) == 8
    assert code(3, READING_STONE=7.0) == 3
    assert code(3, SETTINGS_EPS=np.nan) == 5
    assert code(4, READING_TOUCHDOWNS=2.0) == 3


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("motor_lag", 0.02), ("push", 5.0), ("friction_spread", 0.2), ("loose_stone", 1), ("link_bend", 0.05)),
        *(("leg_stretch", 1.03), ("sole_radius", 0.05), ("stone_placement", "absolute"), ("tick_seconds", 0.005)),
    ],
)
def test_a_plant_that_the_example_lacks_is_refused(name: str, value: float) -> None:
    check_plant(SimulationParameters(plant="mujoco", payload=10.0, ground_friction=0.8, sensors="lab"))
    with pytest.raises(ExampleError, match=f"{name} = {value}: expected "):
        check_plant(SimulationParameters(**{"plant": "mujoco", name: value}))


def test_what_is_python_is_refused(tmp_path: Path) -> None:
    for policy, solver in (("oracle", "daqp"), ("zero", "osqp")):
        parameters = load_parameters("ours", controller="cbf-clf-qp", qp_solver=solver)
        controller = Assembly(SimulationParameters(), parameters, policy).make_controller()
        with pytest.raises(ExportError, match="expected policy zero"):
            export(controller, tmp_path / "out")
        assert not (tmp_path / "out").exists()


TASKS = [
    ("segway.py", "nominal"),
    ("obstacle_arm.py", "nominal"),
    pytest.param("three_link_walker.yaml", "nominal", marks=THOROUGH),
    pytest.param("cart_pole.py", "learned", marks=THOROUGH),
]


@pytest.mark.parametrize(("name", "controller"), TASKS)
def test_a_task_answers_a_rides_readings_as_in_python(name: str, controller: str, tmp_path: Path) -> None:
    task = load_task(str(EXAMPLES / name))
    made = TaskController(task)
    made.policy = train(task, 1, episodes=1)[0] if controller == "learned" else controller
    ride = ride_of(made, made.policy, 1)
    export(made, tmp_path)
    readings = np.concatenate([made.robots.reading(moment.state) for moment in ride.moments])
    inputs = np.array([moment.u for moment in ride.moments])
    inputs[-1] = np.nextafter(inputs[-1], np.inf)  # the program finds it
    export_ride(tmp_path, readings, inputs)
    subprocess.run(["make", "-s", "-C", tmp_path], check=True)
    said = subprocess.run(["./example"], cwd=tmp_path, check=False, capture_output=True, text=True).stdout
    assert re.fullmatch(rf"{len(inputs)} ticks, [0-9.]+ us each, 1 with other inputs than Python's\n", said)
    made.policy = "oracle"
    with pytest.raises(ExportError, match="policy oracle"):
        export(made, tmp_path / "out")


THREADS = 2
FIELDS = "torque", "mu", "eta", "alpha", "beta", "margins", "slacks", "multipliers", "measured", "identified"
CONTROLLERS: dict[str, dict[str, Any]] = {
    **{name: {} for name in (*NAMES, "best")},
    **{"rl-cbf-clf-qp, exploring": {"sigma": 5.0}, "rl-cbf-clf-qp, osqp": {"qp_solver": "osqp"}},
}


def assembly_of(name: str, changes: dict[str, Any]) -> Assembly:
    kind = {} if name == "best" else {"controller": name.split(",")[0]}
    parameters = load_parameters("ours" if kind else "best", **{"qp_solver": "daqp", **kind, **changes})
    plant = SimulationParameters(plant="mujoco", mass_scale=2.0, stones=3, terrain=parameters.terrain)
    return Assembly(plant, parameters, resolve_policy(None, parameters))


def ticks(controller: Controller, states: Sequence[RobotState]) -> list[tuple[bytes, ...]]:
    controller.reset(SEED)
    outputs = [controller.step(state) for state in states]
    return [tuple(np.asarray(getattr(output, name)).tobytes() for name in FIELDS) for output in outputs]


@pytest.mark.parametrize(
    "name", [kind if kind == "cbf-clf-qp" else pytest.param(kind, marks=THOROUGH) for kind in CONTROLLERS]
)
def test_a_tick_has_the_same_bits_wherever_it_is_computed(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assembly = assembly_of(name, CONTROLLERS[name])
    monkeypatch.setenv(COMPILE, "0")
    states = [record.state for record in walked(assembly, SEED)[0]]
    expected = ticks(assembly.make_controller(), states)
    assert len(set(expected)) > len(expected) // 2  # they differ from tick to tick
    monkeypatch.delenv(COMPILE)
    compiled = [assembly.make_controller() for _ in range(THREADS)]
    for controller in compiled:
        controller.compile(wait=True)
    assert ticks(compiled[0], states) == expected
    with ThreadPoolExecutor(THREADS) as pool:
        assert all(found == expected for found in pool.map(ticks, compiled, [states] * THREADS))

"""What `rabbit export` writes: compiled, it walks as in Python."""

import subprocess
from pathlib import Path

import numpy as np
import pytest
from cbf_clf_qp.daqp_source import SourceError, unpack_daqp
from rabbit_experiments.assembly import Assembly, resolve_policy
from rabbit_sim.c_example import write_example
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.export import ExportError, export
from rl_cbf_clf_controller.parameters import load_parameters
from rl_trainer.rollout import Record, rollout

SEED, STONES = 17, 6


def walked_in_python_and_c(
    name: str, policy: str, folder: Path, mass_scale: float = 2.0, daqp: Path | None = None
) -> tuple[np.ndarray, np.ndarray, str]:
    """The torques of all ticks, and what the program says."""
    parameters = load_parameters(name, "stones", qp_solver="daqp")
    plant = SimulationParameters(plant="mujoco", mass_scale=mass_scale, stones=STONES)
    simulation, controller = Assembly(plant, parameters, resolve_policy(policy, parameters)).build()
    export(controller, folder, daqp)
    write_example(folder, simulation, SEED)
    subprocess.run(["make", "-s", "-C", folder], check=True)
    said = subprocess.run(["./example", "torques"], cwd=folder, check=True, capture_output=True, text=True).stdout
    torques = list[np.ndarray]()

    def keep(record: Record) -> None:
        torques.append(record.output.torque)

    rollout(simulation, controller, SEED, keep)
    return np.array(torques), np.fromfile(folder / "torques").reshape(-1, 4), said


THOROUGH = pytest.mark.thorough
CASES = [("ours", "zero", 1.0), pytest.param("best", "zero", 2.0, marks=THOROUGH)]
CASES.append(pytest.param("ours", "rl-cbf-clf-qp", 2.0, marks=THOROUGH))


@pytest.mark.parametrize(("name", "policy", "mass_scale"), CASES)
def test_each_torque_has_the_bits_of_pythons(name: str, policy: str, mass_scale: float, tmp_path: Path) -> None:
    in_python, in_c, said = walked_in_python_and_c(name, policy, tmp_path, mass_scale)
    assert in_c.tobytes() == in_python.tobytes()
    assert f"in {len(in_python)} ticks" in said


@THOROUGH
def test_daqps_source_has_the_bits_of_casadis_library(tmp_path: Path) -> None:
    try:
        source = unpack_daqp(tmp_path)
    except SourceError as error:
        pytest.skip(str(error))
    in_python, in_c, _ = walked_in_python_and_c("best", "zero", tmp_path / "out", daqp=source)
    assert in_c.tobytes() == in_python.tobytes()
    assert (tmp_path / "out" / "daqp" / "src" / "api.o").is_file()


def test_what_is_python_is_refused(tmp_path: Path) -> None:
    for changes in ({"controller": "l1-clf-qp"}, {"controller": "cbf-clf-qp", "qp_solver": "osqp"}):
        parameters = load_parameters("ours", **{"qp_solver": "daqp", **changes})
        controller = Assembly(SimulationParameters(terrain=parameters.terrain), parameters, "zero").make_controller()
        with pytest.raises(ExportError, match="expected no estimator in Python"):
            export(controller, tmp_path / "out")
        assert not (tmp_path / "out").exists()

"""In a process whose locale has a decimal comma every engine has the URDF's robot."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

PROGRAM = """
import json, locale, sys
import mujoco, pinocchio
from rabbit_description.gait import load_gaits
from rabbit_sim.mujoco_plant import robot_mjcf
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.robot_urdf import perturbed_urdf
from rabbit_sim.simulation import Simulation

locale.setlocale(locale.LC_ALL, sys.argv[1])
plant = SimulationParameters(mass_scale=1.37, payload=3.3, payload_ahead=0.1, link_bend=0.05)
urdf = perturbed_urdf(plant)
model = pinocchio.buildModelFromXML(urdf)
robot = mujoco.MjModel.from_xml_string(robot_mjcf(urdf, 0.8))
found = {
    "pinocchio": [model.inertias[i].toDynamicParameters().tolist() for i in range(model.njoints)]
    + [placement.translation.tolist() for placement in model.jointPlacements],
    "limits": model.lowerPositionLimit.tolist() + model.upperPositionLimit.tolist(),
    "mujoco": [robot.body_mass.tolist(), robot.body_inertia.tolist(), robot.body_ipos.tolist()],
    "places": [robot.body_pos.tolist(), robot.geom_size.tolist(), robot.opt.timestep, robot.jnt_range.tolist()],
}
simulation = Simulation(plant, load_gaits("stones_0350_080"))
simulation.reset(1)
client, loaded = simulation.plant._client, simulation.plant._robot
links = [client.getDynamicsInfo(loaded, link) for link in range(client.getNumJoints(loaded))]
found["pybullet"] = [[info[0], *info[2], *info[3]] for info in links]
found["heavy"] = [max(info[0] for info in links), max(inertia.mass for inertia in model.inertias)]
print(json.dumps(found))
"""


def robots(locale: str, folder: Path) -> dict[str, Any]:
    """What the engines have under a locale, in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, locale],
        env={**os.environ, "LOCPATH": str(folder)},
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
    return dict(json.loads(done.stdout.splitlines()[-1]))


@pytest.fixture(scope="module")
def german(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a locale that has a decimal comma."""
    folder = tmp_path_factory.mktemp("locales")
    localedef = shutil.which("localedef")
    if localedef is None:
        pytest.skip("no localedef to make a locale with")
    made = subprocess.run([localedef, "-i", "de_DE", "-f", "UTF-8", folder / "de_DE.UTF-8"], capture_output=True)
    if made.returncode:
        pytest.skip(f"localedef makes no de_DE: {made.stderr.decode(errors='replace')[:200]}")
    return folder


def test_engines_under_a_decimal_comma(german: Path) -> None:
    """MuJoCo and pinocchio do not read by the locale; PyBullet does, so it reads under another."""
    usual, other = robots("C", german), robots("de_DE.UTF-8", german)
    assert other == usual
    heaviest, in_the_urdf = other["heavy"]
    assert heaviest == pytest.approx(in_the_urdf, rel=1e-9)

"""In a process whose locale has a decimal comma every engine has the URDF's robot, which so moves as ever."""

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
import numpy as np
from rabbit_description.gait import load_gaits
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Simulation

locale.setlocale(locale.LC_ALL, sys.argv[1])
moved = {}
for plant in ("pybullet", "mujoco", "rigid"):
    robot = SimulationParameters(plant=plant, mass_scale=1.37, payload=3.3, payload_ahead=0.1, link_bend=0.05)
    simulation = Simulation(robot, load_gaits("stones_0350_080"))
    state = simulation.reset(1)
    while state.running and state.tick < 20:
        state = simulation.step(np.array([-10.0, -25.0, 10.0, -10.0]))
    moved[plant] = [*state.q, *state.dq, *state.foot_force.ravel()]
print(json.dumps(moved))
"""


def moved(locale: str, folder: Path) -> dict[str, Any]:
    """Where each engine's robot is after 0.2 s under a locale, in a process of its own."""
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
    assert moved("de_DE.UTF-8", german) == moved("C", german)

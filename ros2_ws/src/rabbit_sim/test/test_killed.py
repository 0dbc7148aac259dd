"""A killed simulator leaves no files behind."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

WALK = """
from rabbit_description import DEFAULT_GAIT
from rabbit_description.gait import load_gait
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Simulation
simulation = Simulation(SimulationParameters(plant="{plant}"), load_gait(DEFAULT_GAIT))
simulation.reset(1)
print("walks", flush=True)
input()
"""


@pytest.mark.parametrize("plant", ["pybullet", "mujoco", "rigid"])
def test_a_killed_simulator_leaves_no_files(tmp_path: Path, plant: str) -> None:
    command = [sys.executable, "-c", WALK.format(plant=plant)]
    here = {**os.environ, "TMPDIR": str(tmp_path)}
    with subprocess.Popen(command, env=here, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"walks\n"
        process.kill()
    assert list(tmp_path.iterdir()) == []

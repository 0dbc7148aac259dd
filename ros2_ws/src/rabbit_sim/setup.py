"""Installs rabbit_sim, with what package.xml and ../package_setup.py say."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

from package_setup import install

install(
    "numpy>=2",
    "scipy",
    "pin>=4.1,<5",
    "pybullet>=3.2.7",
    "pydantic>=2",
    entry_points={
        "rabbit.plants": [
            "mujoco = rabbit_sim.mujoco_plant:MujocoPlant",
            "pybullet = rabbit_sim.pybullet_plant:PybulletPlant",
            "rigid = rabbit_sim.rigid_plant:RigidPlant",
        ],
        "rabbit.nodes": ["simulator = rabbit_sim.ros.node:main"],
    },
    extras={"mujoco": ["mujoco>=3.3.6"]},
)

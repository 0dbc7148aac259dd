"""Installs rl_cbf_clf_controller, with what package.xml and ../package_setup.py say."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

from package_setup import install

install(
    "casadi>=3.8",
    "numpy>=2",
    "scipy",
    "pin>=4.1,<5",
    "pydantic>=2",
    "safetensors",
    entry_points={
        "rabbit.nodes": ["controller = rl_cbf_clf_controller.ros.node:main"],
        "rabbit.controllers": ["rabbit = rl_cbf_clf_controller.recipes:KINDS"],
    },
)

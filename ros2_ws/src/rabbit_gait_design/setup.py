"""Installs rabbit_gait_design, with what package.xml and ../package_setup.py say."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

from package_setup import install

install(
    "casadi>=3.8",
    "matplotlib",
    "numpy>=2",
    "pin>=4.1,<5",
    "pydantic>=2",
    "rich",
    "scipy",
    "typer",
    entry_points={"rabbit.commands": ["gait = rabbit_gait_design.commands.gait:app"]},
)

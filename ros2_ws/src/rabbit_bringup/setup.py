"""Installs rabbit_bringup, with what package.xml and ../package_setup.py say."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

from package_setup import install

install(
    "numpy>=2",
    "pydantic>=2",
    "rich",
    "typer",
    entry_points={
        "rabbit.nodes": [
            "launcher = rabbit_bringup.ros.launcher:main",
            "ros2_control = rabbit_bringup.ros.ros2_control:main",
        ],
        "rabbit.commands": ["run = rabbit_bringup.commands.run:app", "walk = rabbit_bringup.commands.walk:app"],
    },
    on_path="rabbit",
)

"""Installs rabbit_recording, with what package.xml and ../package_setup.py say."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

from package_setup import install

install(
    "numpy>=2",
    "pydantic>=2",
    "rich",
    "rosbags>=0.11.9,<0.12",
    "typer",
    entry_points={
        "rabbit.nodes": ["recorder = rabbit_recording.ros.recorder:main"],
        "rabbit.commands": ["bag = rabbit_recording.commands.bag:app"],
    },
)

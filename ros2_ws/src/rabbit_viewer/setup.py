"""Installs rabbit_viewer, with what package.xml and ../package_setup.py say."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

from package_setup import install

install(
    "matplotlib",
    "numpy>=2",
    "pydantic>=2",
    "typer",
    "websockets>=14",
    entry_points={
        "rabbit.nodes": ["viewer = rabbit_viewer.ros.viewer:main"],
        "rabbit.commands": [f"{name} = rabbit_viewer.commands.{name}:app" for name in ("play", "video", "view")],
        "rabbit.pictures": [
            "recording = rabbit_viewer.walk_pictures:draw_pictures",
            "page = rabbit_viewer.page.recording:show_recording",
        ],
    },
    extras={"film": ["imageio-ffmpeg"]},
)

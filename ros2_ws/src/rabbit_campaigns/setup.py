"""Installs rabbit_campaigns, with what package.xml and ../package_setup.py say."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

from package_setup import install

install(
    "numpy>=2",
    "pydantic>=2",
    "rich",
    "scipy",
    "typer",
    "websockets>=14",
    entry_points={
        "rabbit.commands": [
            "bench = rabbit_campaigns.commands.bench:app",
            "faults = rabbit_campaigns.commands.faults:app",
            "jitter = rabbit_campaigns.commands.jitter:app",
            "soak = rabbit_campaigns.commands.soak:app",
        ]
    },
)

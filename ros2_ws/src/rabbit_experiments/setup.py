"""Installs rabbit_experiments, with what package.xml and ../package_setup.py say."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

from package_setup import install

install(
    "gymnasium",
    "joblib",
    "numpy>=2",
    "pydantic>=2",
    "rich",
    "scipy",
    "typer",
    entry_points={
        "rabbit.commands": [
            "evaluate = rabbit_experiments.commands.evaluate:app",
            "policy = rabbit_experiments.commands.policy:app",
            "train = rabbit_experiments.commands.train:app",
        ]
    },
)

"""Installs rabbit_experiments, with what package.xml and ../package_setup.py say."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

from package_setup import install

install(
    "casadi",
    "joblib",
    "matplotlib",
    "numpy>=2",
    "pydantic>=2",
    "rich",
    "scipy",
    "typer",
    entry_points={
        "rabbit.commands": [
            "benchmark = rabbit_experiments.commands.benchmark:app",
            "estimator = rabbit_experiments.commands.estimator:app",
            "evaluate = rabbit_experiments.commands.evaluate:app",
            "misses = rabbit_experiments.commands.misses:app",
            "policy = rabbit_experiments.commands.policy:app",
            "reproduce = rabbit_experiments.commands.reproduce:app",
            "speed = rabbit_experiments.commands.speed:app",
            "train = rabbit_experiments.commands.train:app",
        ]
    },
    extras={"ray": ["ray>=2.40"], "search": ["optuna>=4"]},
)

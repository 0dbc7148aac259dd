"""Installs rabbit_rivals, with what package.xml and ../package_setup.py say."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

from package_setup import install

install(
    "gymnasium",
    "matplotlib",
    "numpy>=2",
    "pydantic>=2",
    "safetensors",
    "scipy",
    "torch==2.13.0",
    "typer",
    entry_points={
        "rabbit.commands": ["rival = rabbit_rivals.commands.rival:app"],
        "rabbit.methods": [
            f"{name} = rabbit_rivals.methods:{name.upper().replace('-', '_')}"
            for name in ("ddpg-sb3", "gp-socp", "pd", "ppo", "regression", "sac")
        ],
    },
    extras={"socp": ["clarabel>=0.11"], "rl": ["stable-baselines3>=2.9"]},
)

"""Installs rl_trainer, with what package.xml and ../package_setup.py say."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

from package_setup import install

install(
    "numpy>=2",
    "pydantic>=2",
    entry_points={
        "rabbit.learners": [
            "ddpg = rl_trainer.ddpg:Ddpg",
            "paper_ddpg = rl_trainer.paper_ddpg:PaperDdpg",
            "regression = rl_trainer.regression:Regression",
        ],
        "rabbit.nodes": ["trainer = rl_trainer.ros.node:main"],
    },
    extras={"learn": ["torch==2.13.0", "tensorboard"]},  # all but learning does without
)

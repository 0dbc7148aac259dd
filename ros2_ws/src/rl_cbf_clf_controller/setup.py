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
        "rabbit.controllers": [
            "clf-qp = rl_cbf_clf_controller.recipes:CLF",
            "rl-clf-qp = rl_cbf_clf_controller.recipes:RL_CLF",
            "l1-clf-qp = rl_cbf_clf_controller.recipes:L1_CLF",
            "io-rl-clf-qp = rl_cbf_clf_controller.recipes:IO_RL_CLF",
            "cbf-clf-qp = rl_cbf_clf_controller.recipes:CBF_CLF",
            "rl-cbf-clf-qp = rl_cbf_clf_controller.recipes:RL_CBF_CLF",
            "robust-cbf-clf-qp = rl_cbf_clf_controller.recipes:ROBUST_CBF_CLF",
        ],
    },
)

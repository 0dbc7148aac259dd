"""Installs rl_trainer: `pip install` anywhere, `colcon build` in a ROS 2 workspace."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "rl_trainer"
# Where the packages are that no registry has. colcon reads no address without a host.
BESIDE = Path(__file__).resolve().parents[1].as_uri().replace("file://", "file://localhost")

setup(
    name=NAME,
    version="0.1.0",
    description="Reward, replay, DDPG and the other learners of the model uncertainty; node: the trainer",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"lib/{NAME}", sorted(map(str, Path().glob("bin/*")))),
    ],
    install_requires=[
        f"cbf_clf_qp @ {BESIDE}/cbf_clf_qp",
        f"rabbit_description @ {BESIDE}/rabbit_description",
        f"rl_cbf_clf_controller @ {BESIDE}/rl_cbf_clf_controller",
        "numpy>=2",
        "torch==2.13.0",
        "pydantic>=2",
        "pyyaml",
        "tensorboard",
        "gymnasium",
    ],
    extras_require={"test": ["pytest"]},
    entry_points={
        "rabbit.learners": ["ddpg = rl_trainer.ddpg:Ddpg", "regression = rl_trainer.regression:Regression"],
        "rabbit.nodes": ["trainer = rl_trainer.ros.node:main"],
    },
)

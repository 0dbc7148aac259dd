"""Installs rabbit_experiments: `pip install` anywhere, `colcon build` in a ROS 2 workspace."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "rabbit_experiments"
# Where the packages are that no registry has. colcon reads no address without a host.
BESIDE = Path(__file__).resolve().parents[1].as_uri().replace("file://", "file://localhost")

setup(
    name=NAME,
    version="0.1.0",
    description="Seeded runs of plant, controller and policy: metrics, ablations, the paper reproduced",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "reproduce/*.csv"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=[
        f"cbf_clf_qp @ {BESIDE}/cbf_clf_qp",
        f"rabbit_description @ {BESIDE}/rabbit_description",
        f"rabbit_cli @ {BESIDE}/rabbit_cli",
        f"rabbit_sim @ {BESIDE}/rabbit_sim",
        f"rl_cbf_clf_controller @ {BESIDE}/rl_cbf_clf_controller",
        f"rl_trainer @ {BESIDE}/rl_trainer",
        f"rabbit_gait_design @ {BESIDE}/rabbit_gait_design",
        f"rabbit_viewer @ {BESIDE}/rabbit_viewer",
        "joblib",
        "matplotlib",
        "numpy>=2",
        "pydantic>=2",
        "rich",
        "scipy",
        "tensorboard",
        "typer",
    ],
    extras_require={"test": ["pytest"], "ray": ["ray>=2.40"]},
    entry_points={
        "rabbit.commands": [
            "evaluate = rabbit_experiments.commands.evaluate:app",
            "policy = rabbit_experiments.commands.policy:app",
            "reproduce = rabbit_experiments.commands.reproduce:app",
            "train = rabbit_experiments.commands.train:app",
        ],
    },
)

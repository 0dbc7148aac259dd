"""Installs rabbit_gait_design: `pip install` anywhere, `colcon build` in a ROS 2 workspace."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "rabbit_gait_design"
# Where the packages are that no registry has. colcon reads no address without a host.
BESIDE = Path(__file__).resolve().parents[1].as_uri().replace("file://", "file://localhost")

setup(
    name=NAME,
    version="0.1.0",
    description="Gaits and gait libraries by trajectory optimisation, offline",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=[
        f"cbf_clf_qp @ {BESIDE}/cbf_clf_qp",
        f"rabbit_description @ {BESIDE}/rabbit_description",
        f"rabbit_cli @ {BESIDE}/rabbit_cli",
        f"rl_cbf_clf_controller @ {BESIDE}/rl_cbf_clf_controller",
        "casadi>=3.8",
        "matplotlib",
        "numpy>=2",
        "pin>=4.1,<5",
        "pydantic>=2",
        "rich",
        "scipy",
        "typer",
    ],
    extras_require={"test": ["pytest"]},
    entry_points={
        "rabbit.commands": ["gait = rabbit_gait_design.commands.gait:app"],
    },
)

"""Installs rl_cbf_clf_controller: `pip install` anywhere, `colcon build` in a ROS 2 workspace."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "rl_cbf_clf_controller"
# Where the packages are that no registry has. colcon reads no address without a host.
BESIDE = Path(__file__).resolve().parents[1].as_uri().replace("file://", "file://localhost")

setup(
    name=NAME,
    version="0.1.0",
    description="The CBF-CLF-QP controller of bipedal walking under learned uncertainty; node: the controller",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "config/*.yaml", "policies/*.safetensors"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"lib/{NAME}", sorted(map(str, Path().glob("bin/*")))),
        (f"share/{NAME}/config", sorted(map(str, Path().glob(f"{NAME}/config/*.yaml")))),
    ],
    install_requires=[
        f"cbf_clf_qp @ {BESIDE}/cbf_clf_qp",
        f"rabbit_description @ {BESIDE}/rabbit_description",
        "numpy>=2",
        "scipy",
        "pin>=4.1,<5",
        "pydantic>=2",
        "safetensors",
    ],
    extras_require={"test": ["pytest"]},
    entry_points={
        "rabbit.nodes": ["controller = rl_cbf_clf_controller.ros.node:main"],
        "rabbit.controllers": ["rabbit = rl_cbf_clf_controller.recipes:KINDS"],
    },
)

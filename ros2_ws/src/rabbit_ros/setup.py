"""Installs rabbit_ros: `pip install` anywhere, `colcon build` in a ROS 2 workspace."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "rabbit_ros"
HERE = Path(__file__).resolve().parent


def sibling(name: str) -> str:
    """A package beside this one, required by its path, since no registry has it."""
    return f"{name} @ {(HERE.parent / name).as_uri()}"


setup(
    name=NAME,
    version="0.1.0",
    description="What the nodes share: parameters from pydantic models, QoS profiles, conversions",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "**/*.xml", "**/*.yaml", "**/*.urdf", "**/*.json", "**/*.safetensors"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=[
        sibling("rabbit_description"),
        "numpy",
        "pydantic>=2",
        "pyyaml",
    ],
    extras_require={"test": ["pytest"]},
)

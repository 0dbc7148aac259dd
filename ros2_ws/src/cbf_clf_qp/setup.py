"""Installs cbf_clf_qp: `pip install` anywhere, `colcon build` in a ROS 2 workspace."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "cbf_clf_qp"

setup(
    name=NAME,
    version="0.2.0",
    description="CBF-CLF quadratic programmes for any control-affine system, with estimates of the model's error",
    long_description=Path(__file__).resolve().with_name("README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["numpy>=2", "scipy", "casadi>=3.7", "osqp>=1.1,<2"],
    extras_require={"test": ["pytest"]},
)

"""Installs rabbit_campaigns: `pip install` anywhere, `colcon build` in a ROS 2 workspace."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "rabbit_campaigns"
# Where the packages are that no registry has. colcon reads no address without a host.
BESIDE = Path(__file__).resolve().parents[1].as_uri().replace("file://", "file://localhost")

setup(
    name=NAME,
    version="0.1.0",
    description="For maintainers: faults at random ticks, soak, jitter and benchmarks of the running graph",
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
        f"rabbit_sim @ {BESIDE}/rabbit_sim",
        f"rl_cbf_clf_controller @ {BESIDE}/rl_cbf_clf_controller",
        f"rl_trainer @ {BESIDE}/rl_trainer",
        f"rabbit_recording @ {BESIDE}/rabbit_recording",
        f"rabbit_viewer @ {BESIDE}/rabbit_viewer",
        f"rabbit_experiments @ {BESIDE}/rabbit_experiments",
        f"rabbit_bringup @ {BESIDE}/rabbit_bringup",
        "numpy>=2",
        "pydantic>=2",
        "rich",
        "scipy",
        "typer",
    ],
    extras_require={"test": ["pytest"]},
    entry_points={
        "rabbit.commands": [
            "bench = rabbit_campaigns.commands.bench:app",
            "faults = rabbit_campaigns.commands.faults:app",
            "jitter = rabbit_campaigns.commands.jitter:app",
            "soak = rabbit_campaigns.commands.soak:app",
        ],
    },
)

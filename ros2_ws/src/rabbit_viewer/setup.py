"""Installs rabbit_viewer: `pip install` anywhere, `colcon build` in a ROS 2 workspace."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "rabbit_viewer"
# Where the packages are that no registry has. colcon reads no address without a host.
BESIDE = Path(__file__).resolve().parents[1].as_uri().replace("file://", "file://localhost")

setup(
    name=NAME,
    version="0.1.0",
    description="Pictures and films of a walk, and the same live; node: the viewer",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "live/*.json"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"lib/{NAME}", sorted(map(str, Path().glob("bin/*")))),
    ],
    install_requires=[
        f"rabbit_description @ {BESIDE}/rabbit_description",
        f"rabbit_cli @ {BESIDE}/rabbit_cli",
        f"rabbit_sim @ {BESIDE}/rabbit_sim",
        f"rl_cbf_clf_controller @ {BESIDE}/rl_cbf_clf_controller",
        f"rl_trainer @ {BESIDE}/rl_trainer",
        f"rabbit_recording @ {BESIDE}/rabbit_recording",
        "foxglove-sdk>=0.30.3,<0.31",
        "imageio-ffmpeg",
        "matplotlib",
        "numpy>=2",
        "pydantic>=2",
        "typer",
        "websockets>=16",
    ],
    extras_require={"test": ["pytest"]},
    entry_points={
        "rabbit.nodes": ["viewer = rabbit_viewer.ros.viewer:main"],
        "rabbit.commands": ["video = rabbit_viewer.commands.video:app", "view = rabbit_viewer.commands.view:app"],
        "rabbit.pictures": ["recording = rabbit_viewer.bag_pictures:draw_bag"],
    },
)

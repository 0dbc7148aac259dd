"""What the setup.py files share. A package installs with `pip install` anywhere, with `colcon build` in a workspace.

What package.xml says is read from there. cbf_clf_qp alone does without this file: it can be taken out of the project.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

SOURCES = Path(__file__).resolve().parent
DATA = ("css", "csv", "html", "js", "json", "safetensors", "txt", "urdf", "xml", "yaml")  # kinds of files packed
SHARED = ("config", "gait_libraries", "gaits", "launch", "urdf")  # folders that ROS users find under share/

EntryPoints = Mapping[str, Sequence[str]]


def install(
    *requires: str, entry_points: EntryPoints | None = None, extras: EntryPoints | None = None, on_path: str = ""
) -> None:
    """Call setuptools for the package in the current folder.

    Args:
        requires: the libraries that pip fetches; the packages next to this one are those of package.xml.
        entry_points: by group.
        extras: libraries, by the name of the extra.
        on_path: the file of `bin/` that is a command, not only an executable of `ros2 run`.
    """
    xml = ElementTree.parse("package.xml")
    name = xml.findtext("name", "")
    data = {
        "share/ament_index/resource_index/packages": [f"resource/{name}"],
        f"share/{name}": ["package.xml"],
        f"lib/{name}": files("bin/*"),
        "bin": files(f"bin/{on_path}") if on_path else [],
        **{f"share/{name}/{folder}": files(f"{folder}/*.*", f"{name}/{folder}/*.*") for folder in SHARED},
    }
    setup(
        name=name,
        version=xml.findtext("version"),
        description=xml.findtext("description"),
        license=xml.findtext("license"),
        python_requires=">=3.11",
        packages=find_packages(include=[name, f"{name}.*"]),
        package_data={name: ["py.typed", *(f"**/*.{kind}" for kind in DATA)]},
        data_files=[(folder, found) for folder, found in data.items() if found],
        install_requires=[*packages_of(xml), *requires],
        extras_require={"test": ["pytest"], **(extras or {})},
        entry_points=entry_points,
    )


def files(*patterns: str) -> list[str]:
    """The package's files of these patterns."""
    return sorted(str(path) for pattern in patterns for path in Path().glob(pattern))


def packages_of(xml: ElementTree.ElementTree) -> list[str]:
    """The packages that package.xml names and no registry has, with their addresses."""
    needed = [SOURCES / (tag.text or "") for tag in xml.iter("exec_depend")]
    uris = {path.name: path.as_uri() for path in needed if (path / "setup.py").is_file()}
    # colcon reads no address without a host
    return [f"{name} @ {uri.replace('file://', 'file://localhost')}" for name, uri in uris.items()]

"""A mapping in YAML has no order: sorted or reversed, each shipped file gives the same numbers, to the bit."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from rabbit_benchmark.cells import Storm
from rabbit_benchmark.families import Families
from rabbit_description.gait import load_gaits
from rabbit_description.yaml_file import read_mapping
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.planar_walker import read_walker
from rl_trainer.task_episode import Rider

ROOT = Path(__file__).resolve().parents[2]
PLACES = ("examples", "studies", "ros2_ws/src")
BUILT = {"build", "install", "node_modules"}
SHIPPED = sorted(
    path for place in PLACES for path in (ROOT / place).rglob("*.yaml") if not BUILT.intersection(path.parts)
)


def reversed_keys(value: Any) -> Any:
    """Of every mapping in it."""
    if isinstance(value, dict):
        return {key: reversed_keys(value[key]) for key in reversed(value)}
    return [reversed_keys(each) for each in value] if isinstance(value, list) else value


ORDERS: dict[str, Callable[[Any], str]] = {
    "sorted": lambda value: yaml.safe_dump(value, sort_keys=True),
    "reversed": lambda value: yaml.safe_dump(reversed_keys(value), sort_keys=False),
}


def walker(path: Path) -> Any:
    """All numbers of its task that depend on the file."""
    own = read_walker(path)
    kept = own.outputs, own.motors, own.start, own.path, own.angles.phase_angle.tolist(), own.angles.controlled.tolist()
    return repr(kept), {name: value for name, value in own.file if name not in ("outputs", "path")}


def drawn(model: Any) -> Callable[[Path], Any]:
    """What it says, in the order in which it is drawn."""

    def read(path: Path) -> str:
        found = model.model_validate(read_mapping(path))
        return repr(list(found))

    return read


def reader(path: Path) -> Callable[[Path], Any]:
    """What the project reads the file by."""
    if path.parent.name in ("examples", "urdf"):
        return walker
    if path.parent.name in ("gaits", "gait_libraries"):
        return load_gaits
    if path.parent.parent.name == "rl_cbf_clf_controller":
        return lambda file: [load_parameters(file, terrain) for terrain in ("stones", "flat")]
    own = {"storm.yaml": drawn(Storm), "families.yaml": drawn(Families)}
    by_name = {"claims.yaml", "controllers.yaml", "graph.yaml", "rosbag2_qos.yaml"}  # of which each value is looked up
    assert path.name in own or path.name in by_name, f"{path}: expected a reader here"
    return own.get(path.name, read_mapping)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_the_order_of_keys_changes_nothing(path: Path, tmp_path: Path) -> None:
    read, other = reader(path), tmp_path / path.name
    for urdf in path.parent.glob("*.urdf"):
        (tmp_path / urdf.name).write_text(urdf.read_text())
    expected, content = read(path), yaml.safe_load(path.read_text())
    for order, dumped in ORDERS.items():
        other.write_text(dumped(content))
        assert read(other) == expected, order


def test_a_walk_has_the_same_torques(tmp_path: Path) -> None:
    path, torques = ROOT / "examples" / "three_link_walker.yaml", []
    (tmp_path / "three_link_walker.urdf").write_text(path.with_suffix(".urdf").read_text())
    for order in ("", *ORDERS):
        file = tmp_path / path.name
        file.write_text(ORDERS[order](yaml.safe_load(path.read_text())) if order else path.read_text())
        ride = Rider(replace(read_walker(file).task, impacts=2)).ride("oracle", 3)
        assert ride.outcome == "done"
        torques.append([each.hex() for moment in ride.moments for each in moment.u.tolist()])
    assert torques[0] == torques[1] == torques[2]

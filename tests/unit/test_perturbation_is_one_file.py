"""Wind is one file: its option, ROS parameter, control on the page and provenance follow from it."""

import subprocess
from pathlib import Path

from rabbit_common.options import described
from rabbit_experiments import source_code
from rabbit_experiments.source_code import code_of, hash_of
from rabbit_sim.parameters import SimulationParameters
from rabbit_viewer.play.settings import PLANT_AT_ONCE, PlaySettings, controls, plant_of

FIELDS = ("wind", "gusts", "gust_seconds")
SOURCES = Path(__file__).resolve().parents[2] / "ros2_ws" / "src"
FILE = SOURCES / "rabbit_sim" / "rabbit_sim" / "perturbations" / "wind.py"


def test_no_other_file_of_the_product_names_it() -> None:
    assert FILE.is_file()
    modules = [path for path in SOURCES.glob("*/*/**/*.py") if "test" not in path.parts and path != FILE]
    assert len(modules) > 150
    for path in modules:
        text = path.read_text(encoding="utf-8")
        assert not any(f"{quote}{name}" in text for name in FIELDS for quote in ('"', ".", "'", "import ")), path
        assert "Wind(" not in text, path


def test_it_is_a_parameter_of_every_command_and_node() -> None:
    """A node declares the properties of this schema; commands have an option for each field."""
    assert set(FIELDS) <= set(SimulationParameters.model_json_schema()["properties"])
    assert all(described([SimulationParameters])[name] for name in FIELDS)


def test_a_command_takes_it_and_refuses_it_by_name(tmp_path: Path) -> None:
    words = ["rabbit", "evaluate", "--plant", "rigid", "--wind", "5", "--out", str(tmp_path)]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=60)
    assert done.stderr.strip() == "rabbit: wind = 5 with plant rigid: expected 0, pybullet or mujoco"
    assert done.returncode == 2


def test_it_is_a_control_of_the_page_and_reaches_the_plant() -> None:
    control = next(each for each in controls() if each["name"] == "wind")
    assert (control["minimum"], control["maximum"], control["unit"], control["when"]) == (-200, 200, "N", "now")
    assert "wind" in PLANT_AT_ONCE
    plant = plant_of(SimulationParameters(), PlaySettings.model_validate({"wind": 35.0}))
    assert [type(each).__name__ for each in plant.in_force()][-1] == "Wind"


def test_a_result_is_made_with_the_files_of_all_perturbations(monkeypatch) -> None:
    """A changed file is another provenance, though no file imports it by name."""
    asked = frozenset({"rabbit_sim.parameters"})
    before = code_of.__wrapped__(asked)["rabbit_sim"]
    monkeypatch.setattr(source_code, "hash_of", lambda path: "changed" if path.name == FILE.name else hash_of(path))
    assert code_of.__wrapped__(asked)["rabbit_sim"] != before

"""The set-up's errors each name the cause and what to do; its stamps and its mending of the ROS wheels."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch):
    """Loads a script of the set-up as a module."""
    monkeypatch.syspath_prepend(str(SCRIPTS))

    def load(name: str) -> ModuleType:
        spec = importlib.util.spec_from_file_location(name, SCRIPTS / f"{name}.py")
        assert spec
        assert spec.loader
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, name, module)
        spec.loader.exec_module(module)
        return module

    return load


def test_a_stamp_holds_only_for_the_same_inputs(script, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    common = script("common")
    monkeypatch.setattr(common, "STATE", tmp_path)
    lock = tmp_path / "lock.txt"
    lock.write_text("numpy==1")
    key = common.digest([lock], "place")
    common.mark_done("step", key)
    assert common.is_done("step", common.digest([lock], "place"))
    assert not common.is_done("step", common.digest([lock], "elsewhere"))
    lock.write_text("numpy==2")
    assert not common.is_done("step", common.digest([lock], "place"))
    common.forget("step")
    assert not common.is_done("step", key)


def test_mending_wheels_twice_changes_nothing_more(script, tmp_path: Path) -> None:
    mend = script("mend_ros_wheels")
    cmake = tmp_path / "share" / "std_msgs" / "cmake" / "export_std_msgs__rosidl_generator_pyExport.cmake"
    cmake.parent.mkdir(parents=True)
    baked = "/opt/python/cp312-cp312"
    cmake.write_text(
        f'"{baked}/include/python3.12;{baked}/lib/python3.12/site-packages/numpy/_core/include;{baked}/lib/x.so"'
    )
    assert mend.mend_cmake(tmp_path, "/py", "/np") == 1
    assert cmake.read_text() == '"/py;/np;${_IMPORT_PREFIX}/lib/x.so"'
    assert mend.mend_cmake(tmp_path, "/py", "/np") == 0


def test_locks_name_hashes_for_all_and_no_place() -> None:
    for lock in (SCRIPTS.parent / "requirements").glob("*.txt"):
        text = lock.read_text()
        packages = [line for line in text.splitlines() if line[:1].isalnum()]
        assert packages
        assert all("==" in line for line in packages)
        assert text.count("--hash=sha256:") >= len(packages)
        assert not any(word in text for word in ("http", "--index", "--find-links", "file:", " @ "))

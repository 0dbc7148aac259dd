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


def test_a_missing_compiler_is_named(script, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    common, checks = script("common"), script("checks")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(common.SetUpError, match=r"cc is not installed; .*build-essential"):
        checks.check_tools()


def test_missing_headers_are_named(script, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    common, checks = script("common"), script("checks")
    monkeypatch.setattr(checks.sysconfig, "get_path", lambda _: str(tmp_path))
    with pytest.raises(common.SetUpError, match=r"no headers for Python 3\.\d+ .* install python3\.\d+-dev"):
        checks.check_python()


def test_a_missing_venv_is_named(script, monkeypatch: pytest.MonkeyPatch) -> None:
    common, checks = script("common"), script("checks")
    monkeypatch.setattr(checks, "find_spec", lambda _: None)
    with pytest.raises(common.SetUpError, match=r"has no venv; install python3\.\d+-venv"):
        checks.check_python()


def test_a_full_disk_is_named_with_what_is_needed(script, tmp_path: Path) -> None:
    common, checks = script("common"), script("checks")
    with pytest.raises(common.SetUpError, match=r"GB free at .* 1e\+12 GB needed; make room"):
        checks.check_room(tmp_path, 1e12)


def test_a_ros_for_another_python_is_refused(script, tmp_path: Path) -> None:
    common, checks = script("common"), script("checks")
    (tmp_path / "lib" / "python3.8" / "site-packages" / "rclpy").mkdir(parents=True)
    with pytest.raises(common.SetUpError, match="call make with PYTHON="):
        checks.check_ros(tmp_path)


@pytest.mark.parametrize(
    ("output", "advice"),
    [
        ("ERROR: Could not install packages due to an OSError: [Errno 28] No space left on device", "make room"),
        ("pip._vendor.urllib3.exceptions.ReadTimeoutError: HTTPSConnectionPool: Read timed out.", "registry"),
        ("ERROR: No matching distribution found for numpy==2.4.6", "registry"),
        ("error: command 'x86_64-linux-gnu-gcc' failed: No such file or directory", "build-essential"),
        ("fatal error: Python.h: No such file or directory", "python3-dev"),
        ("ERROR: THESE PACKAGES DO NOT MATCH THE HASHES FROM THE REQUIREMENTS FILE.", "pip cache purge"),
        ("something else", "another reason"),
    ],
)
def test_pip_errors_become_advice(script, output: str, advice: str) -> None:
    script("common")
    assert advice in script("pip_install").cause(output)


def test_without_node_the_site_has_its_other_pages(script, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    script("common"), script("pip_install")
    tools = script("browser_tools")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert tools.missing() == "node and npm not installed"
    assert tools.install() == "node and npm not installed"


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

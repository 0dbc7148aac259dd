"""What is read is data: no file that is handed to the project, whatever it pretends to be, gets to run code."""

import ast
import contextlib
from pathlib import Path

import pytest
from rabbit_recording import RecordingError
from rabbit_recording.open_recording import one_line_errors, opened
from rosbags.rosbag2 import StoragePlugin, Writer

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ROOT / "ros2_ws" / "src", ROOT / "studies", ROOT / "qa"
RUNS_CODE = {"eval", "exec", "compile", "__import__"}
RUNS_CODE |= {"pickle.load", "pickle.loads", "marshal.load", "marshal.loads", "joblib.load", "shelve.open"}
RUNS_CODE |= {"yaml.load", "yaml.load_all", "yaml.unsafe_load", "yaml.full_load", "os.system", "os.popen"}


@pytest.mark.parametrize(
    ("kind", "definition"),
    [
        ("a/msg/B:\n    pass\n{code}\nclass C", "float64 x\n"),
        ("a/msg/B", "float64 x\n{code}\n"),
        ("a/msg/B", "float64 x = {code}\n"),
        ("a/msg/B", "string X = \"'''\n{code}\n'''\"\n"),
        ("a/msg/B", "float64[({code})] x\n"),
    ],
)
def test_message_definitions_in_a_recording_run_nothing(kind: str, definition: str, tmp_path: Path) -> None:
    """The library that reads recordings makes Python out of the definitions in them."""
    mark, bag = tmp_path / "code_was_run", tmp_path / "bag"
    code = f"__import__('pathlib').Path('{mark}').touch()"
    with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        told = {"msgdef": definition.format(code=code), "rihs01": "RIHS01_0"}
        connection = writer.add_connection("/t", kind.format(code=code), **told)
        writer.write(connection, 0, bytes(12))
    with contextlib.suppress(RecordingError), opened(bag) as reader, one_line_errors(bag):
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
    assert not mark.exists()


def test_no_module_runs_what_it_reads() -> None:
    found = []
    for path in [path for folder in FOLDERS for path in sorted(folder.rglob("*.py")) if path.parent.name != "test"]:
        for call in (n for n in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(n, ast.Call)):
            name, given = ast.unparse(call.func), {k.arg: ast.unparse(k.value) for k in call.keywords}
            unsafe = name in RUNS_CODE or given.get("allow_pickle") == "True" or given.get("shell") == "True"
            if unsafe or (name == "torch.load" and given.get("weights_only") != "True"):
                found.append((str(path.relative_to(ROOT)), name))
    assert not found

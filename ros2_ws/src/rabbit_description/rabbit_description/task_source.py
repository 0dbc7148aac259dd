"""Where a task comes from: a Python file, a walker's data file, or a package that brings it under a name."""

import importlib.util
import sys
from pathlib import Path

from rabbit_description import plugins
from rabbit_description.bounded_file import is_file
from rabbit_description.task import ControlTask, TaskError
from rabbit_description.user_code import fault_in_user_code
from rabbit_description.validation import one_line
from rabbit_description.yaml_file import read_mapping

GROUP = "rabbit.systems"  # entry points that name a ControlTask
FILES = "rabbit.task_files"  # entry points by a file's ending: functions of its path that give one


def load_task(source: str) -> ControlTask:
    """The only ControlTask of a Python file, a walker (a .yaml file), or what a package brings under this name.

    A Python file is code, and runs. Raises `TaskError`, also where the parts do not fit together, as a barrier and its
    relative degree.
    """
    try:
        task = _loaded(source)
        _ = task.tick
        return task
    except Exception as error:
        where = fault_in_user_code(error)
        if isinstance(error, TaskError) and not where:
            raise
        raise TaskError(where or f"{source}: {one_line(error)}") from error


def files_of(source: str) -> tuple[Path, ...]:
    """The files that a task is made of: `source`, and the URDF that a walker names; of a package's task none."""
    path = Path(source)
    if path.suffix == ".yaml":
        return path, path.parent / str(read_mapping(path).get("urdf", ""))
    return (path,) if path.suffix == ".py" else ()


def _loaded(source: str) -> ControlTask:
    if not source:
        raise TaskError("no task is given: expected a file that ends in .py or .yaml, or an installed task's name")
    path = Path(source)
    if path.suffix not in (".py", ".yaml"):
        try:
            task = plugins.load(GROUP, source)
        except LookupError as error:
            raise TaskError(f"{error}; or a file that ends in .py or .yaml") from error
        if not isinstance(task, ControlTask):
            raise TaskError(f"{GROUP} {source}: expected a ControlTask, found {task!r}")
        return task
    if not is_file(path):
        raise TaskError(f"{source}: no such file")
    if path.suffix == ".yaml":
        return plugins.load(FILES, "yaml")(path)
    spec = importlib.util.spec_from_file_location(f"task {path.stem}", path)  # no package has such a name
    assert spec
    assert spec.loader
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)  # where `dataclass` looks for it
    try:
        spec.loader.exec_module(module)
    finally:
        del sys.modules[spec.name]
    tasks = [value for value in vars(module).values() if isinstance(value, ControlTask)]
    if len(tasks) != 1:
        raise TaskError(f"{source}: {len(tasks)} objects of ControlTask; expected one")
    return tasks[0]

"""Single changes of all that decides a result, each followed by the question whether the old result is still found.

    python qa/test/provenance_changes.py WORKSPACE walk|own|training CHANGES SEED

WORKSPACE is from `make_workspace`: copies of the project's packages and of files, which this process imports, reads and
changes. What decides a run is seen from outside: every module that was loaded and every file that was opened in the
workspace while the run was made. The last line is how many changes of each kind were made, and those after which the
old result was served.
"""

import csv
import importlib
import importlib.metadata
import json
import os
import shutil
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

PACKAGES = (
    *("cbf_clf_qp", "rabbit_common", "rabbit_description", "rabbit_estimator", "rabbit_experiments", "rabbit_sim"),
    *("rabbit_viewer", "rl_cbf_clf_controller", "rl_trainer"),
)
LIBRARIES = {
    "walk": ("numpy", "pybullet", "osqp", "casadi", "pin", "scipy"),
    "own": ("numpy", "mujoco", "osqp", "casadi", "pin", "scipy"),  # casadi brings DAQP
    "training": ("numpy", "torch", "casadi", "pin", "scipy"),
}
OWN = {
    "__init__.py": "",
    "assembly.py": """
from dataclasses import dataclass
from rabbit_experiments.assembly import Assembly
from .helper import weaker

@dataclass(frozen=True)
class Weaker(Assembly):
    share: float = 0.9

    def build(self):
        simulation, controller = super().build()
        return simulation, weaker(controller, self.share)

class Weakest(Weaker):
    pass
""",
    "helper.py": """
from pathlib import Path

def weaker(controller, share):
    from own_package.late import scale

    return scale(controller, share * float(Path(__file__).with_name("share.txt").read_text()))
""",
    "late.py": """
def scale(controller, share):
    step = controller.step

    def weaker_step(state):
        output = step(state)
        output.torque[:] *= share
        return output

    controller.step = weaker_step
    return controller
""",
    "share.txt": "0.95\n",
    "plant.py": """
from rabbit_sim.mujoco_plant import MujocoPlant

class Own(MujocoPlant):
    pass

class Other(MujocoPlant):
    pass
""",
    "kind.py": """
from dataclasses import replace
from rl_cbf_clf_controller.recipes import CBF_CLF

OWN = replace(CBF_CLF)
OTHER = replace(CBF_CLF)
""",
}
ENTRIES = "[rabbit.plants]\nown = own_package.plant:Own\n[rabbit.controllers]\nown = own_package.kind:OWN\n"


def make_workspace(folder: Path) -> None:
    """Copies of packages in `packages`, a package of one's own, and `files`."""
    for name in PACKAGES:
        (source,) = find_spec(name).submodule_search_locations
        shutil.copytree(source, folder / "packages" / name, ignore=shutil.ignore_patterns("__pycache__"))
    own = folder / "packages" / "own_package"
    own.mkdir()
    for name, text in OWN.items():
        (own / name).write_text(text)
    distribution(folder, "own_package", "1.0")
    entry_points(folder).write_text(ENTRIES)
    (folder / "files").mkdir()
    shutil.copy(folder / "packages/rabbit_description/gaits/stones_0350_084.yaml", folder / "files/gait.yaml")
    shutil.copy(folder / "packages/rl_cbf_clf_controller/policies/rl-cbf-clf-qp.safetensors", folder / "files")
    with (folder / "files/course.csv").open("w") as file:
        csv.writer(file).writerows([("l_min", "l_max"), *[(0.3, 0.4)] * 5])


def distribution(folder: Path, name: str, version: str) -> Path:
    """What pip leaves of an installed library, first on the path."""
    path = folder / "packages" / f"{name}-{version}.dist-info"
    path.mkdir()
    (path / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    return path


def entry_points(folder: Path) -> Path:
    """Of the package of one's own."""
    return folder / "packages" / "own_package-1.0.dist-info" / "entry_points.txt"


def job_of(what: str, folder: Path, **changes: Any) -> Any:
    """A walk with files of one's own, one with parts of one's own, or a training; `changes` of its parameters."""
    from rabbit_experiments.assembly import Assembly
    from rabbit_experiments.evaluation import Walk
    from rabbit_sim.parameters import SimulationParameters
    from rl_cbf_clf_controller.parameters import ControllerParameters, load_parameters
    from rl_trainer.parameters import TrainingParameters

    def changed(kind: type) -> dict[str, Any]:
        return {name: value for name, value in changes.items() if name in kind.model_fields}

    files = folder / "files"
    if what == "training":
        from rabbit_reproduce.training import training_job  # here alone: its modules decide no walk

        known = {"problem": "rl-cbf-clf-qp", "episodes": 1}
        return training_job(TrainingParameters(**known | changed(TrainingParameters)), gait=str(files / "gait.yaml"))
    if what == "walk":
        plant = {"stones": 1, "course": str(files / "course.csv")}
        tuning = load_parameters("ours", controller="rl-cbf-clf-qp", gait=str(files / "gait.yaml"))
        kind, policy = Assembly, str(files / "rl-cbf-clf-qp.safetensors")
    else:
        from own_package.assembly import Weaker

        plant = {"stones": 1, "plant": "own"}
        tuning = load_parameters("ours", controller="own", qp_solver="daqp")
        kind, policy = Weaker, "zero"
    tuning = ControllerParameters.model_validate(tuning.model_dump() | changed(ControllerParameters))
    simulation = SimulationParameters.model_validate(plant | changed(SimulationParameters))
    return Walk(kind(simulation, tuning, policy), changes.get("episode_seed", 7))


class Changes:
    """The result of a job in a cache, and single changes."""

    def __init__(self, folder: Path, what: str, seed: int) -> None:
        self.folder, self.what = folder, what
        self.rng = np.random.default_rng([seed, len(what)])
        opened: set[Path] = set()
        root = str(folder)

        def watch(event: str, arguments: tuple[Any, ...]) -> None:
            if event == "open" and isinstance(arguments[0], str) and arguments[0].startswith(root):
                opened.add(Path(arguments[0]))

        sys.addaudithook(watch)
        job = job_of(what, folder)
        if what == "training":
            from rabbit_reproduce.training import TrainingReport

            for name in ("rl_trainer.ddpg", "rl_trainer.session", "rabbit_experiments.training_setup"):
                importlib.import_module(name)
            result = TrainingReport(commit="", episodes=[])
        else:
            result = job.do()
        loaded = {Path(str(file)) for module in [*sys.modules.values()] if (file := getattr(module, "__file__", None))}
        seen = {path for path in {*opened, *loaded} if path.is_relative_to(folder) and path.is_file()}
        seen = {path for path in seen if "__pycache__" not in path.parts and path.stat().st_size}
        packages = folder / "packages"
        self.files = {
            "course, gait, policy": sorted(path for path in seen if path.is_relative_to(folder / "files")),
            "plugin code": sorted(path for path in seen if path.is_relative_to(packages / "own_package")),
            "project code": sorted(
                path
                for path in seen
                if path.is_relative_to(packages) and path.relative_to(packages).parts[0] in PACKAGES
            ),
        }
        self.cache().put(job, result)
        assert self.served(job), "expected the result that was just kept"

    def cache(self) -> Any:
        """As a new process has it."""
        from rabbit_experiments import provenance, source_code
        from rabbit_experiments.cache import Cache

        for each in (source_code.code_of, provenance._parts):
            each.cache_clear()
        importlib.invalidate_caches()
        return Cache(self.folder / "cache")

    def served(self, job: Any) -> bool:
        """Whether a result is found."""
        return self.cache().get(job) is not None

    def draw(self) -> tuple[str, str, bool]:
        """A change: its kind, what was changed, and whether the old result was served."""
        kinds: dict[str, Callable[[], Any]] = {
            kind: lambda files=files: self.byte(files) for kind, files in self.files.items() if files
        }
        kinds |= {"library version": self.version, "parameters": self.parameter}
        if self.what != "own":
            kinds.pop("plugin code", None)  # loaded, since all controllers are looked through; it decides nothing here
        else:
            kinds |= {"entry point": self.entry_point, "class": self.other_class}
        kind = str(self.rng.choice(sorted(kinds)))
        with kinds[kind]() as (name, job):
            served = job is not None and self.served(job)
        assert self.served(job_of(self.what, self.folder)), f"{name} changed back: expected the old result"
        return kind, name, served

    @contextmanager
    def byte(self, files: list[Path]) -> Iterator[tuple[str, Any]]:
        """One byte of one file; its time of change stays."""
        path = files[self.rng.integers(len(files))]
        data, times = path.read_bytes(), path.stat()
        at, other = self.rng.integers(len(data)), self.rng.integers(1, 256)
        changed = bytearray(data)
        changed[at] ^= int(other)
        path.write_bytes(changed)
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
        try:
            yield f"{path.relative_to(self.folder)}, byte {at}", job_of_loaded(self)
        finally:
            path.write_bytes(data)

    @contextmanager
    def version(self) -> Iterator[tuple[str, Any]]:
        """Of a library."""
        name = str(self.rng.choice(LIBRARIES[self.what]))
        path = distribution(self.folder, name, f"99.{self.rng.integers(1000)}")
        try:
            yield path.name, job_of_loaded(self)
        finally:
            shutil.rmtree(path)

    @contextmanager
    def parameter(self) -> Iterator[tuple[str, Any]]:
        """A number or a choice of plant, controller, training or seed."""
        job = job_of(self.what, self.folder)
        models = [job.parameters] if self.what == "training" else [job.assembly.simulation, job.assembly.controller]
        values = {name: value for model in models for name, value in model if isinstance(value, bool | int | float)}
        values |= {} if self.what == "training" else {"episode_seed": 7}
        while True:
            name = str(self.rng.choice(sorted(values)))
            value = values[name]
            if isinstance(value, bool):
                other: Any = not value
            elif isinstance(value, int):
                other = value + int(self.rng.integers(1, 4))
            else:
                other = value * (1 + self.rng.choice([-1, 1]) * 10.0 ** -self.rng.integers(1, 15)) + (value == 0) * 1e-3
            try:
                changed = job_of(self.what, self.folder, **{name: other})
            except ValueError:
                continue  # out of bounds
            if other != value:
                yield f"{name} {value} {other}", changed
                return

    @contextmanager
    def entry_point(self) -> Iterator[tuple[str, Any]]:
        """Another plant or controller under the same name."""
        path = entry_points(self.folder)
        old, new = [("plant:Own", "plant:Other"), ("kind:OWN", "kind:OTHER")][self.rng.integers(2)]
        path.write_text(ENTRIES.replace(old, new))
        try:
            yield f"{old} {new}", job_of_loaded(self)
        finally:
            path.write_text(ENTRIES)

    @contextmanager
    def other_class(self) -> Iterator[tuple[str, Any]]:
        """An assembly of another class with the same values, or a record in place of figures."""
        from own_package.assembly import Weakest
        from rabbit_experiments.assembly import Assembly
        from rabbit_experiments.evaluation import RecordedWalk, Walk

        job = job_of(self.what, self.folder)
        its = job.assembly
        others = [
            Walk(Weakest(its.simulation, its.controller, its.policy), job.seed),
            Walk(Assembly(its.simulation, its.controller, its.policy), job.seed),
            RecordedWalk(its, job.seed),
        ]
        other = others[self.rng.integers(len(others))]
        yield f"{type(other).__name__} {type(other.assembly).__name__}", other


def job_of_loaded(changes: Changes) -> Any:
    """The job as the code that is loaded makes it; None where a file is refused."""
    try:
        return job_of(changes.what, changes.folder)
    except ValueError:
        return None


def main(folder: Path, what: str, number: int, seed: int) -> None:
    """Make changes; print what came of them."""
    changes = Changes(folder, what, seed)
    made, wrong = Counter[str](), []
    for _ in range(number):
        kind, name, served = changes.draw()
        made[kind] += 1
        if served:
            wrong.append(f"{kind}: {name}")
    files = {kind: len(found) for kind, found in changes.files.items()}
    print(json.dumps({"made": made, "served": wrong, "files": files}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))

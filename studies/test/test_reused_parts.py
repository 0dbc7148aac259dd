"""A process walks its runs with one plant and one controller: the same runs as from fresh parts."""

import os
import shutil
from pathlib import Path

import pytest
from rabbit_experiments.assembly import Assembly, resolve_policy
from rabbit_experiments.evaluation import forget_parts, parts, record_walk, walk
from rabbit_experiments.metrics import RunResult
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.weights import SHIPPED

NOISY = {"mass_scale": 2.0, "stones": 3, "motor_lag": 0.004, "torque_delay": 0.003, "velocity_noise": 0.05}
IDENTIFIED = {"adaptation": "identification", "objective": "pd_centred"}


def assembly(
    controller: str = "rl-cbf-clf-qp", policy: str | None = None, plant: str = "pybullet", **changes: str
) -> Assembly:
    tuning = ControllerParameters.model_validate({"controller": controller, **changes})
    simulation = SimulationParameters.model_validate({**NOISY, "plant": plant, "terrain": tuning.terrain})
    return Assembly(simulation, tuning, resolve_policy(policy, tuning))


def figures(result: RunResult) -> dict[str, object]:
    """All but the times; NaN as text."""
    row = result.row.model_dump(exclude={"tick_ms_p50", "tick_ms_p99", "plant_ms_p50", "walk_seconds"})
    return {name: repr(value) for name, value in row.items()} | {"violations": result.violations}


@pytest.mark.parametrize(
    "made_of",
    [
        assembly(),
        assembly(plant="mujoco"),
        assembly(plant="rigid"),
        assembly(policy="zero", **IDENTIFIED),
        assembly("l1-clf-qp"),
    ],
    ids=["pybullet", "mujoco", "rigid", "identified", "l1"],
)
def test_a_run_is_the_same_after_other_runs(made_of: Assembly) -> None:
    forget_parts()
    alone = figures(walk(made_of, 0, 11))
    with parts(made_of) as (first, _):
        pass
    walk(made_of, 1, 12)
    assert figures(walk(made_of, 0, 11)) == alone
    with parts(made_of) as (again, _):
        assert again is first


def copied(source: Path, path: Path) -> None:
    """A file's bytes in another, whose time of change and size stay; a remark fills a YAML file up."""
    data, before = source.read_bytes(), path.stat()
    path.write_bytes(data + b"#" * (before.st_size - len(data)) if path.suffix == ".yaml" else data)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def test_a_policy_file_of_the_same_age_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "policy.safetensors"
    shutil.copy(SHIPPED / "rl-cbf-clf-qp.safetensors", path)
    made_of = assembly(policy=str(path), plant="rigid")
    before = record_walk(made_of, 5).about
    copied(SHIPPED / "rl-cbf-clf-qp-scale-0.7.safetensors", path)
    assert record_walk(made_of, 5).about["policy"] != before["policy"]

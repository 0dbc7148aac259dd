"""The tasks of the examples, learned: five trainings each, with seeds that nobody had looked at."""

from pathlib import Path

import pytest
from rabbit_description.task_source import load_task
from rl_cbf_clf_controller.task_controller import TaskController
from rl_trainer.task_episode import ride_of
from rl_trainer.task_training import train

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    ("name", "first"),
    [
        ("cart_pole.py", 11),
        ("segway.py", 11),
        ("obstacle_arm.py", 11),
        ("amber_3m.yaml", 21),
        ("three_link_walker.yaml", 21),
    ],
)
def test_five_trainings_keep_what_the_nominal_controller_breaks(name, first):
    task = load_task(str(EXAMPLES / name))
    controller, kept = TaskController(task), dict.fromkeys(("nominal", "learned", "oracle"), 0)
    for seed in range(first, first + 5):  # none of them was looked at while tasks and defaults were chosen
        policy, _ = train(task, seed)
        for label, controlling in (("nominal", "nominal"), ("learned", policy), ("oracle", "oracle")):
            kept[label] += sum(ride_of(controller, controlling, 1_000_000 * seed + k).is_kept for k in range(10))
    assert (kept["learned"], kept["oracle"]) == (50, 50)
    assert kept["nominal"] < 25  # it breaks the limit in most

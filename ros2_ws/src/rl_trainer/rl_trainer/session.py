"""The episode loop in process, in a folder if wanted, where it goes on if it was killed, and TensorBoard.

DIR/tensorboard/     reward terms, losses, steps walked, if TensorBoard is installed; all else in DIR: `checkpoint.py`
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rl_cbf_clf_controller.policy import LearnedPolicy

from rl_trainer.checkpoint import Checkpoint
from rl_trainer.rollout import Controller, Simulation, rollout
from rl_trainer.training import EpisodeReport, Trainer

MakeController = Callable[[LearnedPolicy, float], Controller]  # (policy, sigma)


def train(trainer: Trainer, simulation: Simulation, make_controller: MakeController) -> Iterator[EpisodeReport]:
    """Walk and learn until the trainer's number of episodes is reached; yields after each."""
    while trainer.episode < trainer.parameters.episodes:
        plan = trainer.begin_episode()
        controller = make_controller(plan.policy, plan.sigma)
        last = rollout(simulation, controller, plan.seed, lambda record: trainer.observe(record.state, record.output))
        yield trainer.end_episode(plan, last)


def resume(checkpoint: Checkpoint, simulation: Simulation, make_controller: MakeController) -> Iterator[EpisodeReport]:
    """The rest of a training's episodes; all is on disk when an episode's report is yielded."""
    trainer = checkpoint.trainer
    newest = trainer.reports[-1:]  # a kill after its checkpoint may have kept it from TensorBoard
    with tensorboard(checkpoint.folder / "tensorboard", trainer.episode - len(newest)) as log:
        for report in newest:
            log(report)
        for report in train(trainer, simulation, make_controller):
            checkpoint.save()
            log(report)
            yield report


@contextmanager
def tensorboard(folder: Path, first: int) -> Iterator[Callable[[EpisodeReport], None]]:
    """A function that logs an episode's report, from number `first` on; without TensorBoard it does nothing."""
    try:
        from torch.utils.tensorboard import SummaryWriter  # half a second, for this alone
    except ModuleNotFoundError:
        yield lambda _: None
        return
    before, threading.excepthook = threading.excepthook, tell_of_thread
    try:
        with SummaryWriter(folder, purge_step=first) as writer:

            def log(report: EpisodeReport) -> None:
                for name, value in report.scalars.items():
                    writer.add_scalar(name, value, report.episode)
                writer.flush()

            yield log
    finally:
        threading.excepthook = before


def tell_of_thread(told: threading.ExceptHookArgs) -> None:
    """Reports a thread's error, but not TensorBoard's: that one is raised again where an episode is logged."""
    if not type(told.thread).__module__.startswith("tensorboard."):
        threading.__excepthook__(told)

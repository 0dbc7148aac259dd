"""A training session put together: the true plant, the controller with the policy of the episode, the trainer."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rabbit_description.gait import load_gaits
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import Policy, ZeroPolicy
from rl_trainer.checkpoint import CHECKPOINT, Checkpoint, CheckpointError
from rl_trainer.parameters import TrainingParameters
from rl_trainer.session import resume
from rl_trainer.training import EpisodeReport, Provenance, Trainer

from rabbit_experiments import provenance
from rabbit_experiments.assembly import make_simulation


@contextmanager
def training(
    folder: Path,
    parameters: TrainingParameters,
    controller: ControllerParameters,
    plant: SimulationParameters,
    command: str | None = None,
) -> Iterator[tuple[Trainer, Iterator[EpisodeReport]]]:
    """A trainer, and the reports of the episodes that are left.

    It begins, or goes on with the training in `folder` if plant, gait and code are those that this one began with.
    `command` goes into the policy files; by default it is this process's.

    Raises `GaitError`, `CourseError`, `CheckpointError`.
    """
    gait = load_gaits(controller.gait)
    source = Provenance(plant.model_dump(), provenance.commit(), command or provenance.command())
    asked, parts = provenance.plain((training, parameters)), provenance.plain((controller, plant))
    made_with = {"plant or controller": provenance.key_of(parts), **provenance.provenance([asked, parts])}
    if changed := provenance.changed_since(folder / CHECKPOINT, made_with):
        raise CheckpointError(f"{folder}: was begun with another {', '.join(changed)}: expected another folder")
    one = Controller(controller, gait, ZeroPolicy(controller.problem))

    def with_policy(policy: Policy, sigma: float) -> Controller:
        one.policy, one.parameters = policy, controller.model_copy(update={"sigma": sigma})
        return one

    simulation = make_simulation(plant, gait)
    try:
        trainer = Trainer(parameters, source)
        yield trainer, resume(Checkpoint(folder, trainer), simulation, with_policy)
    finally:
        simulation.close()

"""A training next to the walk, as `rabbit train` does it, in a process of its own: a policy after each episode."""

import json
import os
from dataclasses import asdict
from multiprocessing.connection import Connection
from pathlib import Path

from rabbit_viewer.play.settings import Start


def learn(channel: Connection, start: Start, folder: Path) -> None:
    """Train on the chosen plant's masses until done; sends each episode's report with its policy's path, as JSON."""
    from rabbit_experiments.conditions import TRAINING_PLANT, TRAINING_SLACK_WEIGHT
    from rabbit_experiments.training_setup import training
    from rabbit_sim.parameters import SimulationParameters
    from rl_cbf_clf_controller.parameters import load_parameters
    from rl_trainer.parameters import TrainingParameters

    os.nice(10)  # the walk comes first
    parameters = TrainingParameters(seed=start.settings.seed)
    controller = load_parameters("ours", controller=parameters.problem.name, slack_weight=TRAINING_SLACK_WEIGHT)
    course = {"terrain": controller.terrain, "stones": parameters.walking_steps}
    masses = {"mass_scale": start.settings.mass_scale, "payload": start.settings.payload}
    plant = SimulationParameters.model_validate({**TRAINING_PLANT, **course, **masses})
    with training(folder, parameters, controller, plant) as (_, reports):
        for report in reports:
            policy = folder / "policies" / f"{report.episode + 1:03d}.safetensors"
            word = {**asdict(report), "policy": str(policy), "of": parameters.episodes}
            channel.send_bytes(json.dumps(word).encode())

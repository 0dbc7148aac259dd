"""A training next to the walk, as `rabbit train` does it, in another process: a policy after each episode."""

import os
from collections.abc import Callable
from dataclasses import asdict
from multiprocessing.queues import Queue
from pathlib import Path
from typing import Any

from rabbit_viewer.play.messages import Asked, Learned
from rabbit_viewer.play.settings import Start

SHOWN = ("episode", "steps", "ticks", "reward", "losses")  # of an episode's report


def learn(send: Callable[..., None], start: Start, folder: Path, wishes: "Queue[Asked | Learned]") -> None:
    """Train on the chosen plant's masses until done; show each episode, and give the player its policy."""
    episodes: list[dict[str, Any]] = []

    def say(text: str) -> None:
        send("say", "learning", {"text": text, "episodes": episodes})

    say("the first episode begins")
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
    try:
        with training(folder, parameters, controller, plant) as (_, reports):
            for report in reports:
                shown = asdict(report)
                episodes.append({name: shown[name] for name in SHOWN})
                say(f"{len(episodes)} of {parameters.episodes} episodes")
                wishes.put(Learned(str(folder / "policies" / f"{report.episode + 1:03d}.safetensors")))
    finally:
        say(f"ended after {len(episodes)} episodes")

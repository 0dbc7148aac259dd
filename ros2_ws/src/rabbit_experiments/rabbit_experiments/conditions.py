"""Under which conditions controllers are evaluated and policies trained, unless a command says otherwise."""

from typing import Any

EVALUATION_LAG = 0.004  # s, of the motors in evaluation, as in the paper
TRAINING_SCALE = 2.0  # the paper's training plant: twice the mass, no motor lag, no noise
TRAINING_PLANT: dict[str, Any] = {"mass_scale": TRAINING_SCALE, "stop_at_miss": False}  # the pose ends an episode
TRAINING_SLACK_WEIGHT = 3.0  # p while learning: the softer CLF keeps the first, wrong policies on their feet

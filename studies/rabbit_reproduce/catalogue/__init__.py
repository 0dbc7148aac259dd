"""All experiments, in the order of the page."""

from rabbit_reproduce.catalogue.discussion import (
    DELAY,
    JOINT_DAMPING,
    LINK_BENDING,
    MOTOR_POWER,
    VELOCITY_NOISE,
    SmallMass,
)
from rabbit_reproduce.catalogue.feasibility import ClfAssumption, FeasibilityByEpisode, FeasibilityShare
from rabbit_reproduce.catalogue.flat import ClfResults, ClfTorsoResults
from rabbit_reproduce.catalogue.l1_sweep import L1Sweep
from rabbit_reproduce.catalogue.learning_curves import LearningCurves
from rabbit_reproduce.catalogue.payloads import PayloadFlat, PayloadStones
from rabbit_reproduce.catalogue.stones import NominalStones, RlCbfClfResults, SteppingStone
from rabbit_reproduce.catalogue.wide_stones import WideStones
from rabbit_reproduce.experiment import Experiment

EXPERIMENTS: tuple[Experiment, ...] = (
    *(ClfResults(), ClfTorsoResults(), L1Sweep(), PayloadFlat()),
    *(RlCbfClfResults(), SteppingStone(), NominalStones(), PayloadStones()),
    *(MOTOR_POWER, JOINT_DAMPING, LINK_BENDING, SmallMass()),
    *(LearningCurves(), VELOCITY_NOISE),
    *(ClfAssumption(), FeasibilityShare(), FeasibilityByEpisode(), DELAY),
    WideStones(),
)

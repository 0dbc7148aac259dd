"""All experiments, in the order of the page."""

from rabbit_experiments.reproduce.catalogue.clf_assumption import ClfAssumption
from rabbit_experiments.reproduce.catalogue.clf_results import ClfResults, ClfTorsoResults
from rabbit_experiments.reproduce.catalogue.discussion import (
    DELAY,
    JOINT_DAMPING,
    LINK_BENDING,
    MOTOR_POWER,
    VELOCITY_NOISE,
)
from rabbit_experiments.reproduce.catalogue.every_plant import EveryPlantFlat, EveryPlantStones
from rabbit_experiments.reproduce.catalogue.feasibility_by_episode import FeasibilityByEpisode
from rabbit_experiments.reproduce.catalogue.feasibility_share import FeasibilityShare
from rabbit_experiments.reproduce.catalogue.l1_sweep import L1Sweep
from rabbit_experiments.reproduce.catalogue.learning_curves import LearningCurves
from rabbit_experiments.reproduce.catalogue.nominal_stones import NominalStones
from rabbit_experiments.reproduce.catalogue.numerical_derivatives import NumericalDerivatives
from rabbit_experiments.reproduce.catalogue.payloads import PayloadFlat, PayloadStones
from rabbit_experiments.reproduce.catalogue.rl_cbf_clf_results import RlCbfClfResults
from rabbit_experiments.reproduce.catalogue.small_mass import SmallMass
from rabbit_experiments.reproduce.catalogue.stepping_stone import SteppingStone
from rabbit_experiments.reproduce.catalogue.wide_stones import WideStones
from rabbit_experiments.reproduce.experiment import Experiment

EXPERIMENTS: tuple[Experiment, ...] = (
    ClfResults(),
    ClfTorsoResults(),
    L1Sweep(),
    PayloadFlat(),
    RlCbfClfResults(),
    SteppingStone(),
    NominalStones(),
    PayloadStones(),
    MOTOR_POWER,
    JOINT_DAMPING,
    LINK_BENDING,
    SmallMass(),
    LearningCurves(),
    NumericalDerivatives(),
    VELOCITY_NOISE,
    ClfAssumption(),
    FeasibilityShare(),
    FeasibilityByEpisode(),
    DELAY,
    EveryPlantStones(),
    EveryPlantFlat(),
    WideStones(),
)

"""All experiments, in the order of the page."""

from rabbit_reproduce.catalogue.clf_assumption import ClfAssumption
from rabbit_reproduce.catalogue.clf_results import ClfResults, ClfTorsoResults
from rabbit_reproduce.catalogue.discussion import (
    DELAY,
    JOINT_DAMPING,
    LINK_BENDING,
    MOTOR_POWER,
    VELOCITY_NOISE,
)
from rabbit_reproduce.catalogue.every_plant import EveryPlantFlat, EveryPlantStones
from rabbit_reproduce.catalogue.feasibility_by_episode import FeasibilityByEpisode
from rabbit_reproduce.catalogue.feasibility_share import FeasibilityShare
from rabbit_reproduce.catalogue.l1_sweep import L1Sweep
from rabbit_reproduce.catalogue.learning_curves import LearningCurves
from rabbit_reproduce.catalogue.nominal_stones import NominalStones
from rabbit_reproduce.catalogue.numerical_derivatives import NumericalDerivatives
from rabbit_reproduce.catalogue.payloads import PayloadFlat, PayloadStones
from rabbit_reproduce.catalogue.rl_cbf_clf_results import RlCbfClfResults
from rabbit_reproduce.catalogue.small_mass import SmallMass
from rabbit_reproduce.catalogue.stepping_stone import SteppingStone
from rabbit_reproduce.catalogue.wide_stones import WideStones
from rabbit_reproduce.experiment import Experiment

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

"""All experiments, in the order of the page."""

from rabbit_reproduce.catalogue.discussion import Perturbation, SmallMass, Tolerance
from rabbit_reproduce.catalogue.feasibility import ClfAssumption, FeasibilityByEpisode, FeasibilityShare
from rabbit_reproduce.catalogue.flat import ClfResults, TenSteps
from rabbit_reproduce.catalogue.higher_gain import HigherGain
from rabbit_reproduce.catalogue.l1_sweep import L1Sweep
from rabbit_reproduce.catalogue.learning_curves import LearningCurves
from rabbit_reproduce.catalogue.payloads import PayloadFlat, PayloadStones
from rabbit_reproduce.catalogue.stones import NominalStones, RlCbfClfResults, SteppingStone
from rabbit_reproduce.experiment import Experiment

EXPERIMENTS: tuple[Experiment, ...] = (
    *(ClfResults(), TenSteps("clf-torso-results"), L1Sweep(), PayloadFlat()),
    *(RlCbfClfResults(), SteppingStone(), NominalStones(), PayloadStones()),
    *(*map(Perturbation, ("motor-power", "joint-damping", "link-bending")), SmallMass()),
    *(LearningCurves(), Tolerance("velocity-noise")),
    *(ClfAssumption(), FeasibilityShare(), FeasibilityByEpisode(), Tolerance("delay")),
    HigherGain(),
)

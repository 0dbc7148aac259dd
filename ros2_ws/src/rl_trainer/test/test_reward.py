"""The unit of an estimation error in the reward."""

import numpy as np
from rl_cbf_clf_controller.uncertainty import RL_CLF_QP
from rl_trainer.parameters import TrainingParameters
from rl_trainer.reward import error_unit


def test_the_unit_of_the_clf_grows_with_LgV() -> None:
    parameters = TrainingParameters(problem=RL_CLF_QP, error_scale=(10.0,))
    np.testing.assert_allclose(error_unit(np.array([[0.0, 0, 0, 0], [3, 0, 4, 0]]), parameters), [[10], [60]])

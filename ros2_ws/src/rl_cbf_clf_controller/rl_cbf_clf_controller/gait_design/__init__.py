"""Gaits by trajectory optimisation, offline; nothing on the control path imports this. Needs CasADi.

`design_gait(GaitSpecification(name="mine", step_length=0.35, speed=0.7))` returns a `rabbit_description.gait.Gait`;
`run` also writes files and pictures.
"""

from rl_cbf_clf_controller.gait_design.design import GaitDesignError, design_gait
from rl_cbf_clf_controller.gait_design.runner import run
from rl_cbf_clf_controller.gait_design.specification import GaitSpecification

__all__ = ["GaitDesignError", "GaitSpecification", "design_gait", "run"]

"""Gaits by trajectory optimisation, offline; nothing on the control path imports this. Needs CasADi.

`design_gait(GaitSpecification(name="mine", step_length=0.35, speed=0.7))` returns a `rabbit_description.gait.Gait`.
"""

from rabbit_gait_design.design import GaitDesignError, design_gait
from rabbit_gait_design.specification import GaitSpecification

__all__ = ["GaitDesignError", "GaitSpecification", "design_gait"]

"""A learning problem is checked where it is written down."""

from typing import Any

import pytest
from rl_cbf_clf_controller.problem import Problem

GOOD: dict[str, Any] = {
    "name": "pendulum",
    "inputs": 1,
    "quantities": ("V", "B"),
    "observation": ("angle", "rate"),
    "units": (("angle", 0, 1), ("rate", 0, 2), ("weight", 1, 1)),
    "alpha_scale": (1, 2),
}


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"observation": ("angle", "speed")}, "speed"),
        ({"error_scale": (1.0, 0.0)}, "error_scale"),
        ({"quantities": ()}, "alpha_scale"),
        ({"units": (("angle", 0, 1), ("rate", 0, -2))}, "rate"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(changes: dict[str, Any], named: str) -> None:
    with pytest.raises(ValueError, match=f"problem pendulum: .*{named}"):
        Problem(**GOOD | changes)


def test_a_policy_may_read_less_or_more() -> None:
    problem = Problem(**GOOD | {"omissible": ("rate",), "optional": ("weight",)})
    assert problem.observations == (("angle",), ("angle", "rate"), ("angle", "rate", "weight"))
    assert problem.unit("rate") == (0, 2)

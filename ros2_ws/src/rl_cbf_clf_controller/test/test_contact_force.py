"""The rows on the ground's force against the friction cone."""

import casadi as ca
import pytest
from cbf_clf_qp.affine import Affine
from rl_cbf_clf_controller.contact_force import force_rows


def upper(force, is_literal=False):
    """By how much each row is kept, if the force is (F_N, F_T) whatever mu."""
    given = Affine(ca.SX.zeros(2, 4), ca.SX(ca.DM(force)))
    (block,) = force_rows(given, ca.SX(20.0), ca.SX(0.8), ca.SX(1e5), is_literal)
    return ca.evalf(block.upper).full().ravel()


@pytest.mark.parametrize(("force", "ok"), [((100, 79), True), ((100, -79), True), ((100, 81), False), ((10, 0), False)])
def test_force_rows_are_the_cone(force, ok):
    assert (upper(force) >= 0).all() == ok


@pytest.mark.parametrize("tangential", [50.0, -90.0])
def test_literal_cone_takes_the_present_sign(tangential):
    assert upper((100.0, tangential), is_literal=True)[1] == pytest.approx(80 - abs(tangential))

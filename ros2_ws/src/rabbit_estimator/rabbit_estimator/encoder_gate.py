"""Which encoders are used in a tick: a gate refuses a reading that cannot be.

A joint's innovation nu (2,), of its angle and its rate, has the covariance S. The gate refuses it where

    nu' S^-1 nu > GATE^2    or    |nu_1| > max(JUMP, 2 sqrt(S_11))

The first is the usual one (Bar-Shalom, Li, Kirubarajan 2001, section 5.7). For a Gaussian, GATE = 5 would do; an
impact's innovation is not Gaussian, and reached 15 in 10,572 ticks on twenty plants. The second one holds in the tick
of an impact, when S is large: on those plants no impact changed a rate by more than 22 rad/s, or moved an angle by more
than 0.17 rad from where it was expected (3,929 ticks).
An encoder that was refused for `PATIENCE` seconds in a row may have slipped: its zero is then no longer known, so that
it is used again.
"""

import casadi as ca

GATE = 20.0
JUMP = 0.2  # rad
PATIENCE = 0.05  # s


def is_accepted(angle: ca.SX, rate: ca.SX, covariance: ca.SX) -> ca.SX:
    """Whether a joint's innovation, with its covariance (2, 2), is to be used."""
    (a, c), (_, b) = (ca.horzsplit(row) for row in ca.vertsplit(covariance))
    is_near = ca.logic_not((b * angle**2 - 2 * c * angle * rate + a * rate**2) / (a * b - c**2) > GATE**2)
    return ca.logic_and(is_near, ca.fabs(angle) <= ca.fmax(JUMP, 2 * ca.sqrt(a)))


def is_lost(ticks: ca.SX, tick_seconds: ca.SX) -> ca.SX:
    """Whether an encoder has been refused for too long: for so many ticks in a row."""
    return ticks >= ca.fmax(ca.floor(PATIENCE / tick_seconds + 0.5), 1)

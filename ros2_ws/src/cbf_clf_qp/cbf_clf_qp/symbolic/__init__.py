"""A CBF-CLF-QP of any control-affine system, written as CasADi expressions. Start with `tick.py`."""

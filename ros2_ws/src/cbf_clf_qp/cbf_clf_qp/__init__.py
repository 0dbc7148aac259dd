"""CBF-CLF quadratic programmes for any control-affine system: quantities, recipes, and the tick that solves them.

Read `tick.py` first.
"""

"""How probable it is that the step which begins at a touchdown misses its stone.

`touchdowns` says what is seen there, `model` what follows from it, `study` walks, fits and judges.
"""

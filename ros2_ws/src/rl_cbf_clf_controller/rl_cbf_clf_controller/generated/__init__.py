"""Model terms as C: CasADi derives them and writes the C (`expressions.py`, `build.py`), the controller loads it
(`library.py`) without CasADi. `layout.py` says which numbers go in and come out."""

"""The controller: nominal model, constraints, QP, policy. `controller.py` is the file to read first."""

"""What puts plant, controller and trainer together: launching, recording, viewing, experiments, the command line.

One thread for BLAS, here and in all child processes: matrices are small, and results must not depend on the cores.
"""

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

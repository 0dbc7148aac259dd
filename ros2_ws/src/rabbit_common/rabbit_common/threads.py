"""One thread for BLAS, here and in all child processes: matrices are small, and results must not depend on the cores.

BLAS reads this when numpy is imported. So a package calls it in its `__init__.py`.
"""

import os

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def use_one_thread() -> None:
    """Has the libraries use one thread, unless the environment says otherwise."""
    for name in THREADS:
        os.environ.setdefault(name, "1")

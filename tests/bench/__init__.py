"""Benchmarks: commands that print figures, never timed assertions (``make bench``, or one by ``python -m tests.bench.<name>``).

One BLAS thread per process, set before numpy loads: two processes of one thread are faster than one of two, and all that is
compared gets the same.
"""

import os

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

"""Placing a scan on a map: NDT, refinement to surfaces, evidence (paper, section 2.3)."""

from numba import config

# OpenMP first: it is there wherever numba's wheel is, and a TBB of the system is too old more often than not.
vars(config)["THREADING_LAYER_PRIORITY"] = ["omp", "workqueue", "tbb"]

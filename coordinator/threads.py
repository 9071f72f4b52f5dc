"""The number of threads that numerical libraries start in the project's processes."""

ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Environment variables that limit each library to one thread: there are many processes, and threads take memory."""

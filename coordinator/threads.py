"""How many threads libraries start in processes of the project."""

ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""The environment in which each keeps to one: there are many processes, and each further thread takes memory."""

"""Compiled kernels are kept where they are found again."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_kernels_are_kept_in_the_users_cache_though_numba_was_imported_first(tmp_path):
    environment = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    environment |= {"XDG_CACHE_HOME": str(tmp_path), "PYTHONPATH": str(ROOT)}
    program = "import numba, genetics.sequence_kernels, genetics.selection"
    subprocess.run([sys.executable, "-c", program], env=environment, check=True)
    kept = [path.name for path in tmp_path.rglob("*.nbi")]
    assert {name.partition(".")[0] for name in kept} >= {"sequence_kernels", "selection"}

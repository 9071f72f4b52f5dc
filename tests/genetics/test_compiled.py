"""Compiled kernels are kept where they are found again."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = """\
import numba
from genetics.compiled import kernel

@kernel("int64(int64)")
def first(number):
    return 2 * number

@kernel("int64(int64)")
def second(number):
    return 3 * number
"""


def test_kernels_are_kept_in_the_users_cache_though_numba_was_imported_first(tmp_path):
    environment = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    environment |= {"XDG_CACHE_HOME": str(tmp_path), "PYTHONPATH": str(ROOT)}
    module = tmp_path / "own.py"
    module.write_text(PROGRAM)
    subprocess.run([sys.executable, str(module)], env=environment, check=True)
    assert len(list((tmp_path / "supernode").rglob("*.nbi"))) == len(list(tmp_path.rglob("*.nbi"))) == 2

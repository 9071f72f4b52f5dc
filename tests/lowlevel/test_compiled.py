"""Compiled kernels are kept where they are found again."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = """\
import numba
from lowlevel.compiled import kernel

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


def test_an_edit_changes_the_digest_of_what_imports_the_file_and_of_nothing_else(tmp_path):
    (tmp_path / "shapes.py").write_text("SIDES = 4\n")
    user, stranger = tmp_path / "user.py", tmp_path / "stranger.py"
    user.write_text("from shapes import (  # a comment, with a comma\n    SIDES,\n)\n")
    stranger.write_text("def later():\n    import shapes\n")
    script = "import sys; from pathlib import Path; from lowlevel.kernel_cache import digest_of as d\n"
    script += "print(*(d(Path(name)) for name in sys.argv[1:]))"

    def digests():
        command = [sys.executable, "-c", script, str(user), str(stranger)]
        found = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
        return found.stdout.split()

    before = digests()
    (tmp_path / "shapes.py").write_text("SIDES = 5\n")
    after = digests()
    assert before[0] != after[0]
    assert before[1] == after[1]


def test_a_kernels_digest_covers_the_subroutines_that_it_calls():
    from lowlevel import kernel_cache

    found, waiting = set(), [ROOT / "problems" / "mobile_robot" / "kernels.py"]
    while waiting:
        path = waiting.pop()
        found.add(path)
        waiting += [each for each in kernel_cache._imports_of(path) if each not in found]
    names = {str(path.relative_to(ROOT)) for path in found}
    assert {"problems/mobile_robot/contact.py", "problems/plane.py", "genetics/bit_kernels.py"} <= names
    assert not {name for name in names if name.startswith(("node/", "coordinator/", "problems/terrain/"))}

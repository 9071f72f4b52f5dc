"""What a process does about its memory before it forks, in processes of their own."""

import json
import subprocess
import sys

PUT_SMALL_THINGS = """
import ctypes
from coordinator import fork_memory

libc = ctypes.CDLL(None)
libc.malloc.restype = ctypes.c_void_p
blocks = [libc.malloc(size) for size in (40, 200, 700, 3000) for _ in range(5000)]
for block in blocks[::2]:
    libc.free(ctypes.c_void_p(block))
{prepare}
mine = [libc.malloc(size) for size in (40, 200, 700, 3000) for _ in range(100)]
print(len({{address // 4096 for address in mine}}))
"""


def pages_of_what_comes(prepare):
    script = PUT_SMALL_THINGS.format(prepare=prepare)
    return int(subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True).stdout)


def test_what_comes_after_the_holes_are_filled_lies_side_by_side():
    needed = 100 * (40 + 200 + 700 + 3000) / 4096
    assert pages_of_what_comes("") > 1.5 * needed, "or else this shows nothing"
    assert pages_of_what_comes("fork_memory.fill_holes()") < 1.1 * needed + 4


def test_nothing_that_is_in_memory_changes():
    script = """
import ctypes, hashlib
from coordinator import fork_memory
kept = [bytes([each % 256]) * (each % 5000) for each in range(20_000)]
before = hashlib.sha256(b"".join(kept)).digest()
fork_memory.fill_holes()
fork_memory.fill_holes()
more = [bytes([255]) * each for each in range(3000)]
print(hashlib.sha256(b"".join(kept)).digest() == before)
"""
    done = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True)
    assert done.stdout == "True\n"


def test_compiled_code_and_its_constants_are_one_mapping_and_run_as_before():
    script = """
import json, pathlib
import numba
from coordinator import fork_memory
from node import Plan, simulate
from problems.file import parse
from problems.registry import warm_up

warm_up()
file = parse('kind = "function"\\nname = "rastrigin"\\ndimension = 4\\n', "it", pathlib.Path())

def mappings():
    return [line.split() for line in pathlib.Path("/proc/self/maps").read_text().splitlines()]

def apart():
    anonymous = [(*line[0].split("-"), line[1]) for line in mappings() if line[4] == "0" and len(line) == 5]
    return sum(
        one[1] == other[0] and {one[2], other[2]} == {"r--p", "r-xp"}
        for one, other in zip(anonymous, anonymous[1:])
    )

def run():
    plan = Plan.of(file.with_run(generations=3, target=-1.0, topology="torus 2x2"))
    return [report.digest for report in simulate(plan)]

before, they_were_apart, found = len(mappings()), apart(), run()
fork_memory.join_mappings()
fork_memory.join_mappings()

@numba.njit("float64(float64)")
def third(number):
    return number / 3

print(json.dumps([before - len(mappings()), they_were_apart, run() == found, third(6.0)]))
"""
    done = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True)
    fewer, they_were_apart, same, two = json.loads(done.stdout)
    assert they_were_apart > 50, "or else this shows nothing"
    assert fewer > 50
    assert same
    assert two == 2.0

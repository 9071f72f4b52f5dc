"""What a process does about its memory before it forks, in processes of their own."""

import subprocess
import sys

import pytest

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


@pytest.mark.parametrize("function", ["fill_holes", "join_mappings"])
def test_nothing_that_is_in_memory_changes(function):
    script = f"""
import ctypes, hashlib
from coordinator import fork_memory
kept = [bytes([each % 256]) * (each % 5000) for each in range(20_000)]
before = hashlib.sha256(b"".join(kept)).digest()
fork_memory.{function}()
fork_memory.{function}()
more = [bytes([255]) * each for each in range(3000)]
print(hashlib.sha256(b"".join(kept)).digest() == before)
"""
    done = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True)
    assert done.stdout == "True\n"


def test_compiled_code_and_its_constants_are_one_mapping_and_run_as_before():
    script = """
import pathlib
import numba
import problems.function.kernels
from coordinator import fork_memory

def mappings():
    return len(pathlib.Path("/proc/self/maps").read_text().splitlines())

before = mappings()
fork_memory.join_mappings()
after = mappings()

@numba.njit("float64(float64)")
def third(number):
    return number / 3

print(before - after, third(6.0))
"""
    done = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True)
    fewer, two = done.stdout.split()
    assert int(fewer) > 10
    assert two == "2.0"

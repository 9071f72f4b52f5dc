"""What a process does about its memory before it forks, in processes of their own."""

import json
import os
import subprocess
import sys

import pytest

ONE_THREAD = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}

PUT_SMALL_THINGS = """
import ctypes
from lowlevel import fork_memory

libc = ctypes.CDLL(None)
libc.malloc.restype = ctypes.c_void_p
blocks = [libc.malloc(size) for size in (40, 200, 700, 3000) for _ in range(5000)]
for block in blocks[::2]:
    libc.free(ctypes.c_void_p(block))
{prepare}
mine = [libc.malloc(size) for size in (40, 200, 700, 3000) for _ in range(100)]
print(len({{address // 4096 for address in mine}}))
"""


def run(script):
    """What it prints."""
    done = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True, env=ONE_THREAD)
    return done.stdout


def pages_of_what_comes(script, prepare):
    return int(run(script.format(prepare=prepare)))


def test_what_comes_after_the_holes_are_filled_lies_side_by_side():
    needed = 100 * (40 + 200 + 700 + 3000) / 4096
    assert pages_of_what_comes(PUT_SMALL_THINGS, "") > 1.5 * needed, "or else this shows nothing"
    assert pages_of_what_comes(PUT_SMALL_THINGS, "fork_memory.fill_holes()") < 1.1 * needed + 4


PUT_SMALL_OBJECTS = """
from lowlevel import fork_memory

sizes = range(40, 500, 20)
objects = [bytes(size) for size in sizes for _ in range(2000)]
del objects[::2]
{prepare}
mine = [bytes(size) for size in sizes for _ in range(200)]
print(len({{id(each) // 4096 for each in mine}}))
"""


def test_pools_of_small_objects_have_no_holes_either():
    sizes = range(40, 500, 20)
    needed = sum(200 * (size + 33) / 4096 for size in sizes)
    assert pages_of_what_comes(PUT_SMALL_OBJECTS, "") > 1.5 * needed, "or else this shows nothing"
    assert pages_of_what_comes(PUT_SMALL_OBJECTS, "fork_memory.fill_holes()") < 1.1 * needed + 2 * len(sizes)


def test_a_child_that_looks_attributes_up_does_not_write_to_the_names_of_others():
    script = """
import os, resource, sys
from lowlevel import fork_memory

class Wide:
    pass

# On a page each: thirty others of that length between them, an even number, so that few share an entry of the cache.
# Longer ones than 100 are not kept.
strings = [f"{each:06}" + "." * 80 for each in range(10_000 * 31)]
names = strings[::31]
if sys.getrefcount(sys.intern(strings[1])) > 1 << 30:  # not counted, as in Python 3.12
    print("immortal")
    sys.exit()
for name in names:
    setattr(Wide, name, None)
few = names[:300]
for name in few:  # the first time may write elsewhere too
    getattr(Wide, name)
for name in names:
    getattr(Wide, name)
%s

def pages_copied():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for name in few:
        getattr(Wide, name)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

told, tell = os.pipe()
if os.fork() == 0:
    os.write(tell, str(pages_copied()).encode())
    os._exit(0)
print(os.read(told, 99).decode())
os.wait()
"""
    if run(script % "") == "immortal\n":
        pytest.skip("names are not counted")
    full = int(run(script % ""))
    assert full > 200, "or else this shows nothing"
    assert int(run(script % "fork_memory.forget_lookups()")) < 0.7 * full


def test_nothing_that_is_in_memory_changes():
    script = """
import ctypes, hashlib
import numpy as np
from lowlevel import fork_memory
kept = [bytes([each % 256]) * (each % 5000) for each in range(20_000)]
numbers = np.arange(1_000_000)
before = hashlib.sha256(b"".join(kept)).digest()
for _ in range(2):
    fork_memory.forget_lookups()
    fork_memory.fill_holes()
    fork_memory.join_mappings()
    fork_memory.move_to_files()
more = [bytes([255]) * each for each in range(3000)]
same = hashlib.sha256(b"".join(kept)).digest() == before
import decimal  # another library, and memory from the system
assert "memfd:before" in open("/proc/self/maps").read(), "or else this shows nothing"
print(same, numbers.sum(), decimal.Decimal(1) / 8)
"""
    assert run(script) == "True 499999500000 0.125\n"


def test_a_piece_of_memory_may_grow_afterwards():
    script = """
import ctypes
from lowlevel import fork_memory

libc = ctypes.CDLL(None)
libc.malloc.restype = libc.realloc.restype = ctypes.c_void_p
before = libc.malloc(ctypes.c_size_t(40 << 20))  # a mapping of its own
ctypes.memset(before, 7, 40 << 20)
fork_memory.move_to_files()
after = libc.realloc(ctypes.c_void_p(before), ctypes.c_size_t(120 << 20))
ctypes.memset(after + (100 << 20), 8, 1 << 20)
print(ctypes.string_at(after + (39 << 20), 1)[0], ctypes.string_at(after + (100 << 20), 1)[0])
"""
    assert run(script) == "7 8\n"


IN_FILES = """
import json, os, re, threading
from pathlib import Path
import problems.registry
from lowlevel import fork_memory

problems.registry.warm_up()

def anonymous():  # kB
    return int(re.search(r"RssAnon:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])

kept = [bytearray(b"kept") for _ in range(10_000)]
before = anonymous()
{prepare}
fork_memory.move_to_files()
after = anonymous()

told, tell = os.pipe()
child = os.fork()
if child == 0:
    of_child = anonymous()
    kept[7][:] = b"mine"
    os.write(tell, json.dumps([of_child, kept[6].decode(), kept[7].decode()]).encode())
    os._exit(0)
of_child, others, mine = json.loads(os.read(told, 999))
os.waitpid(child, 0)
print(json.dumps([before, after, of_child, others, mine, kept[7].decode()]))
"""


def test_a_fork_leaves_alone_what_was_there_before():
    before, after, of_child, *contents = json.loads(run(IN_FILES.format(prepare="")))
    assert before > 40_000, "or else this shows nothing"
    assert after < 0.2 * before
    assert of_child < 0.2 * before
    assert contents == ["kept", "mine", "kept"]


def test_memory_stays_as_it_is_where_there_can_be_no_files_or_there_is_another_thread():
    for prepare in (
        "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))",
        "del os.memfd_create",
        "threading.Thread(target=threading.Event().wait, daemon=True).start()",
    ):
        before, after, _, *contents = json.loads(run(IN_FILES.format(prepare=prepare)))
        assert after > 0.9 * before
        assert contents == ["kept", "mine", "kept"]


def test_compiled_code_and_its_constants_are_one_mapping_and_run_as_before():
    script = """
import json, pathlib
import numba
from lowlevel import fork_memory
from node.plan import Plan
from node.simulation import simulate
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
    fewer, they_were_apart, same, two = json.loads(run(script))
    assert they_were_apart > 50, "or else this shows nothing"
    assert fewer > 50
    assert same
    assert two == 2.0

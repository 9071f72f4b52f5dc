"""What is not loaded with the kernels is there when something needs it, in processes of their own."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from lowlevel import capabilities

loads_kernels = pytest.mark.skipif(not capabilities().numba_loader, reason="numba loads kernels its own way here")
ROOT = Path(__file__).resolve().parents[2]
LEAVES = """\
from lowlevel.compiled import kernel

@kernel("float64(float64)")
def half(number):
    return number / 2
"""
CALLS_IT = """\
from lowlevel.compiled import kernel
from leaves import half

@kernel("float64(float64)")
def quarter(number):
    return half(half(number))
"""
LOOKS = """
import json, sys

def read(kernel):
    (compiled,) = kernel.overloads.values()
    return compiled.library._shared_module is not None
"""


@pytest.fixture
def tell(tmp_path):
    """Runs a program that prints JSON, with a cache that is its own, beside the two modules."""
    (tmp_path / "leaves.py").write_text(LEAVES)
    (tmp_path / "calls.py").write_text(CALLS_IT)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": f"{ROOT}:{tmp_path}"}

    def run(program: str) -> Any:
        command = [sys.executable, "-c", LOOKS + program]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return run


@loads_kernels
def test_intermediate_code_is_read_only_when_a_kernel_is_compiled_into_another(tell):
    tell("import leaves; print(1)")
    load = "import leaves; hits = sum(leaves.half.stats.cache_hits.values());"
    assert tell(load + "print(json.dumps([hits, read(leaves.half), leaves.half(3.0)]))") == [1, False, 1.5]
    compile_another = "import calls; print(json.dumps([read(leaves.half), calls.quarter(3.0)]))"
    assert tell(load + compile_another) == [True, 0.75]
    assert tell(load + compile_another) == [False, 0.75], "now that one is in the cache too"


def test_a_kernel_becomes_part_of_another_whether_it_was_compiled_or_loaded(tell, tmp_path):
    show = """
import calls
(signature,) = calls.quarter.signatures
print(json.dumps([sum(calls.quarter.stats.cache_misses.values()), calls.quarter.inspect_asm(signature)]))
"""
    compiled, code = tell(show)
    for each in (tmp_path / "cache").rglob("calls.*"):
        each.unlink()
    compiled_again, code_beside_a_loaded_one = tell(show)
    assert compiled == compiled_again == 1
    assert "quarter" in code
    assert re.sub(r"[0-9]+", "", code) == re.sub(r"[0-9]+", "", code_beside_a_loaded_one)


@loads_kernels
def test_linear_algebra_is_there_for_who_compiles_it(tell):
    program = """
import leaves
import numba, numpy
before = "scipy.linalg" in sys.modules

@numba.njit("float64[::1](float64[::1])")
def convolved(vector):
    return numpy.convolve(vector, vector)

@numba.njit
def solved(matrix, vector):
    return numpy.linalg.solve(matrix, vector) + matrix @ vector

matrix, vector = numpy.array([[4.0, 1, 0], [1, 3, 1], [0, 1, 2]]), numpy.array([1.0, 2, 3])
(code,) = convolved.inspect_llvm().values()
same = numpy.allclose(solved(matrix, vector), solved.py_func(matrix, vector))
print(json.dumps([before, "numba_xxdot" in code, bool(same), "scipy.linalg.cython_blas" in sys.modules]))
"""
    assert tell(program) == [False, True, True, True]


@loads_kernels
def test_what_a_library_defines_is_told_by_its_machine_code_too(tell):
    tell("import calls; print(1)")
    program = """
import leaves, calls
from llvmlite import binding

def compare(kernel):
    (compiled,) = kernel.overloads.values()
    module = binding.parse_bitcode(compiled.library._intermediate_code)
    defined = {each.name for each in [*module.functions, *module.global_variables] if not each.is_declaration}
    known = compiled.library._codegen._engine._defined_symbols
    return [len(defined), len(defined - known)]

print(json.dumps([compare(leaves.half), compare(calls.quarter)]))
"""
    for defined, unknown in tell(program):
        assert defined > 3
        assert unknown == 0

"""Which low-level parts may be used, and that the ordinary paths beside them give the same results."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from lowlevel import capabilities
from lowlevel.capabilities import PLAIN, Capabilities, turned_off

ROOT = Path(__file__).resolve().parent.parent.parent
PARTS = set(Capabilities._fields) - {"reasons"}
EXAMPLES = [
    "arm-ik",
    "arm-path",
    "coordination",
    "mobile-robot",
    "min-time",
    "panda-ik",
    "rastrigin",
    "sphere-path",
    "terrain",
]


def in_a_process(script, plain=""):
    environment = os.environ | {PLAIN: plain}
    command = [sys.executable, "-c", script]
    return subprocess.run(command, cwd=ROOT, env=environment, check=True, capture_output=True, text=True).stdout


def test_each_part_is_allowed_or_has_a_reason():
    found = capabilities()
    assert {part for part in PARTS if not getattr(found, part)} == set(found.reasons)
    assert all(found.reasons.values())


def test_one_variable_turns_all_of_them_off():
    script = "import json; from lowlevel import capabilities; print(json.dumps(dict(capabilities().reasons)))"
    assert json.loads(in_a_process(script, plain="1")) == dict.fromkeys(PARTS, f"{PLAIN}=1")


def test_it_can_name_those_that_are_to_be_off():
    script = "import json; from lowlevel import capabilities; print(json.dumps(dict(capabilities().reasons)))"
    assert json.loads(in_a_process(script, plain="fork_memory,linux")).keys() == {"fork_memory", "linux"}
    assert json.loads(in_a_process(script, plain="numba_calls")).keys() == {"numba_calls", "c_api"}


@pytest.mark.parametrize("plain", ["c-api", "linux,thread_state", "0"])
def test_a_name_of_no_part_is_refused(plain, monkeypatch):
    monkeypatch.setenv(PLAIN, plain)
    found = plain.split(",")[-1]
    with pytest.raises(ValueError, match=f"^{PLAIN}: expected 1 for all parts, or names from .*, found '{found}'$"):
        turned_off()


def test_the_command_line_refuses_it_in_one_line_before_it_does_anything():
    command = [sys.executable, "-m", "supernode", "status"]
    environment = os.environ | {PLAIN: "c-api"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"error: {PLAIN}: expected 1 for all parts")
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("patch", "refused", "reason"),
    [
        (
            "metadata.version = lambda _: '0.99.1'",
            {"numba_loader", "numba_calls", "c_api"},
            "numba 0.99.1 is none of",
        ),
        ("platform.libc_ver = lambda: ('musl', '1.2')", {"fork_memory"}, "the C library is musl, not glibc"),
        ("platform.machine = lambda: 'riscv64'", {"fork_memory", "linux"}, "riscv64 is none of"),
        ("sysconfig.get_config_var = lambda _: 1", {"c_api", "fork_memory"}, "no global interpreter lock"),
    ],
)
def test_a_part_is_refused_where_it_was_not_tried(patch, refused, reason):
    script = (
        "import json, platform, sys, sysconfig; from importlib import metadata; import lowlevel; "
        "capabilities = sys.modules['lowlevel.capabilities']; "
        f"{patch}; capabilities.capabilities.cache_clear(); "
        "print(json.dumps(dict(capabilities.capabilities().reasons)))"
    )
    found = json.loads(in_a_process(script))
    assert set(found) == refused
    assert all(reason in each for each in found.values())


@pytest.mark.timeout(300)
def test_the_ordinary_paths_give_the_same_bits():
    script = (
        "import json, supernode\n"
        f"for name in {EXAMPLES}:\n"
        "    result = supernode.simulate(f'examples/{name}.toml', seed=1, generations=4, oracle=False)\n"
        "    print(name, result.history_sha256, result.fitness)\n"
    )
    assert in_a_process(script, plain="1") == in_a_process(script)

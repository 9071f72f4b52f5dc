"""What tests share: small problems that need no planner, and problem files of one's own."""

import contextlib
import os
import random
import signal

import pytest
from hypothesis import settings

settings.register_profile("busy", deadline=None)  # whoever runs the tests beside other work may wait for a core
settings.load_profile("busy")


def pytest_configure():
    """Take what tests rely on, whoever runs them: a session of their own, and Ctrl-C.

    Some containers and services run tests without a session. Linux lets each process without one count as much as the
    whole session of the browser, which always has its own. A shell starts background jobs with SIGINT ignored, and the
    processes that tests start would inherit that.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if os.getsid(0) == 0:
        with contextlib.suppress(PermissionError):  # it leads a group of processes
            os.setsid()


OWN_MODULE = """
import numpy as np
import supernode


class OneMax(supernode.Problem):
    size: int = 40
    trouble: str = ""

    @property
    def coding(self):
        return supernode.BitString(self.size, 1)

    @property
    def solved_at(self):
        return 0.0

    def evaluate(self, genomes):
        missing = self.size - np.unpackbits(genomes, axis=1)[:, : self.size].sum(axis=1).astype(float)
        if missing.min() < self.size / 3:
            if self.trouble == "raises":
                raise RuntimeError("out of paper")
            if self.trouble == "nan":
                return np.full(len(genomes), np.nan)
            if self.trouble == "count":
                return missing[:-1]
        return missing
"""


@pytest.fixture
def random_source():
    return random.Random(1992)


@pytest.fixture
def own_problem(tmp_path):
    """Writes a problem file of kind ``own_module:OneMax``; call it with more lines of TOML."""

    def write(*lines, name="own.toml"):
        (tmp_path / "own_module.py").write_text(OWN_MODULE)
        path = tmp_path / name
        path.write_text("\n".join(['kind = "own_module:OneMax"', *lines]) + "\n")
        return path

    return write

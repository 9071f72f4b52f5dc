"""What the tests of simulated clusters share."""

from pathlib import Path

import pytest

from problems import load


@pytest.fixture(scope="session")
def file():
    """The problem of the jobs."""
    return load(str(Path(__file__).resolve().parents[3] / "examples" / "rastrigin.toml"))

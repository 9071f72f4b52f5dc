"""What a result says of asynchronous runs."""

import pytest

from spy.result import _staleness
from wire.report import Report, Staleness


def report(*counts):
    return Report(
        cell=0,
        generation=9,
        digest=bytes(32),
        evaluations=73,
        sent=9,
        received=36,
        lost=0,
        rejected=0,
        staleness=Staleness(*counts),
        champion=None,
        proposals=(),
        deme=b"",
        state=b"",
        error=None,
    )


def test_staleness_is_over_all_immigrants_of_all_cells():
    reports = [report(30, 15, 7, 3), report(10, 5, 4, 7), report(0, 0, 0, 0)]
    assert _staleness(reports) == {"mean": 0.5, "max": 7, "again": 0.25}


@pytest.mark.parametrize("reports", [[], [report(0, 0, 0, 0)]])
def test_without_immigrants_there_is_none(reports):
    assert _staleness(reports) is None

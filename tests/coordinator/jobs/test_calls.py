"""Which answer is the best of those that the coordinator and the spy know."""

from dataclasses import replace

import pytest

from coordinator.jobs.calls import better_of
from wire.news import Improvement

BEST = Improvement(1, 3, 2.0, 40, 5, 7.5, True, {})
BETTER = replace(BEST, fitness=7.0)


@pytest.mark.parametrize(
    ("best", "told", "expected"),
    [
        (BEST, None, BEST),
        (None, None, None),
        (None, BEST, BEST),
        (BEST, BETTER, BETTER),
        (BETTER, BEST, BETTER),
        (BEST, replace(BETTER, epoch=2), BEST),
        (BEST, replace(BETTER, epoch=4), BEST),
        (None, replace(BETTER, epoch=4), None),
        (BEST, replace(BETTER, epoch=4, seconds=0.0), replace(BETTER, seconds=0.0)),
        (replace(BETTER, epoch=2), BEST, BEST),
    ],
    ids=[
        "none is told",
        "none at all",
        "only the spy knows one",
        "the spy's is better",
        "the spy's is worse",
        "told in an earlier epoch",
        "told in a later epoch",
        "only in a later epoch",
        "carried to an epoch that has not begun",
        "the known one is of an earlier epoch",
    ],
)
def test_the_better_one_of_the_epoch_is_the_best(best, told, expected):
    assert better_of(best, told, 3) == expected

"""On plateaus islands must go on searching, as single cells do."""

import pytest

from benchmarks.plateau import share_of_new, until_feasible


@pytest.mark.parametrize(("deme", "renewal"), [(1, None), (2, None), (20, None), (16, 1.0), (16, 0.5)])
def test_nobody_of_the_first_generation_is_left_where_all_are_equally_fit(deme, renewal):
    assert share_of_new(deme, renewal, seed=1) == pytest.approx(1.0, abs=0.02)


def test_islands_find_what_is_feasible_by_chance_only():
    found = [until_feasible(16, None, seed) for seed in range(1, 21)]
    assert sum(each is not None for each in found) >= 18
    assert all(each is None or 256 <= each <= 256 + 201 * 512 for each in found)

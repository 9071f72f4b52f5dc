"""What recovery costs a node in memory, and how a state names where an improvement was born."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from one_max import plan_of

from node.engine.inbox import Inbox
from node.engine.outbox import Outbox
from node.engine.state_size import BIRTHPLACE_BITS, births_of
from topologies.parse import MOST_CELLS

MOST_BYTES = 20_000


def test_recovery_takes_at_most_20_kilobytes_of_a_node_with_one_individual():
    plan = plan_of(size=64, topology="torus 8x8", deme=1)
    outbox = Outbox(plan.limits.most_bytes_without_state, plan.limits.most_bytes)
    rings = [outbox, *Inbox(plan, 5, job=1).rings]
    assert len(rings) == 5
    taken = sum(ring.room.nbytes + ring.entries.nbytes + ring.marks.nbytes for ring in rings)
    assert taken + outbox.with_state.nbytes <= MOST_BYTES


@given(st.lists(st.tuples(st.integers(0, 2**40), st.integers(0, MOST_CELLS - 1))))
def test_an_improvement_is_where_it_was_born(births):
    numbers = np.array([generation << BIRTHPLACE_BITS | cell for generation, cell in births], np.int64)
    assert births_of(numbers).tolist() == [list(birth) for birth in births]

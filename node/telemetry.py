"""Counters that a node publishes, and its records for the cluster's log."""

import time
from collections.abc import Callable

from node.assignment import Assignment
from node.cell import Cell
from wire.news import Counters, LogRecord, period_of_reports

_GENERATIONS_BETWEEN_COUNTERS = 8  # at least, of a node that waits for its turn on a core: that takes two turns


class Telemetry:
    """A node's counters and log records.

    Args:
        node: the node's number.
        publish_counters: publishes encoded counters; called on the thread that breeds, so it must not block for long.
        publish_record: publishes an encoded log record.

    Attributes:
        due: when to send counters, on the monotonic clock.
        cluster_nodes: how many nodes the cluster has: the more, the less often each of them sends.
    """

    def __init__(
        self, node: int, publish_counters: Callable[[bytes], None], publish_record: Callable[[bytes], None]
    ) -> None:
        self.due = 0.0
        self.cluster_nodes = 1
        self._node = node
        self._publish_counters = publish_counters
        self._publish_record = publish_record

    def log(self, level: str, text: str, cell: Cell) -> None:
        """Publish a log record about this node's cell."""
        node, generation = self._node, cell.plan.since + cell.rows.generation
        record = LogRecord(level, f"node {node}", text, time.time(), node, cell.number, cell.job, generation)
        self._publish_record(record.encode())

    def send_counters(self, assignment: Assignment) -> None:
        """Publish this node's counters, on the thread that breeds or, beside it, on the main thread."""
        cell, (each_exchange, each_generation) = assignment.cell, assignment.seconds_since_report()
        least = _GENERATIONS_BETWEEN_COUNTERS * each_generation if assignment.needs_token else 0.0
        self.due = time.monotonic() + max(period_of_reports(self.cluster_nodes), least)
        counters = Counters(
            self._node,
            cell.number,
            cell.job,
            cell.plan.epoch,
            cell.plan.since + cell.rows.generation,
            cell.rows.evaluations,
            cell.sent,
            cell.inbox.kept,
            cell.lost,
            cell.inbox.refused,
            *cell.rows.vitals(),
            each_exchange,
        )
        self._publish_counters(counters.encode())

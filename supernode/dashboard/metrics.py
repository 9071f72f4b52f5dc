"""Export the cluster's figures to Prometheus; they are read from the view when Prometheus asks."""

from collections.abc import Iterable

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric

from supernode.live.view import View

_COUNTERS = {
    "generation": ("supernode_generations", "Generations of a running job's epoch, at the root."),
    "evaluations": ("supernode_evaluations", "Evaluations of a running job."),
    "messages": ("supernode_messages_sent", "Messages that the nodes of a running job have sent."),
    "received": ("supernode_messages_received", "Messages that the nodes of a running job have received and used."),
    "lost": ("supernode_messages_lost", "Messages that the nodes of a running job have missed."),
    "rejected": ("supernode_messages_rejected", "Messages that the nodes of a running job have refused."),
}
_GAUGES = {
    "epoch": ("supernode_job_epoch", "The epoch that a running job is in."),
    "exchange_seconds": ("supernode_exchange_seconds", "Time from a node's exchange to its next; median of the nodes."),
    "age": ("supernode_champion_age_generations", "Generations since the birth of the champion known at the root."),
    "best": ("supernode_best_fitness", "Fitness of the best individual of a running job; lower is better."),
}


class Metrics:
    """A Prometheus collector with a registry of its own, so that nothing but the cluster's figures is exported."""

    def __init__(self, view: View) -> None:
        self._view = view
        self._registry = CollectorRegistry(auto_describe=False)
        self._registry.register(self)

    def text(self) -> bytes:
        """Return all metrics in Prometheus' text format."""
        return generate_latest(self._registry)

    def collect(self) -> Iterable[Metric]:
        """Yield all metrics; called by Prometheus' library."""
        view, running = self._view, self._view.running()
        yield GaugeMetricFamily("supernode_up", "Whether the cluster answers.", float(view.answers))
        yield GaugeMetricFamily("supernode_nodes_alive", "Nodes that are alive.", view.alive())
        jobs = GaugeMetricFamily("supernode_jobs", "Jobs by state.", labels=["state"])
        for state, count in view.counts.items():
            jobs.add_metric([state], count)
        yield jobs
        for names, family in ((_COUNTERS, CounterMetricFamily), (_GAUGES, GaugeMetricFamily)):
            for name, (metric, words) in names.items():
                of_jobs = family(metric, words, labels=["job"])
                for job, statistics in running.items():
                    of_jobs.add_metric([job], getattr(statistics, name))
                yield of_jobs

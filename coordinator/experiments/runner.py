"""Make the runs of an experiment that are still missing, and record each as soon as it has ended.

One cluster of each size is launched and kept open for all runs of its size. It first makes two runs without a
generation: the first warms the processes up, the second measures the cost of preparing a job, which is subtracted from
the runs that follow. The sequential algorithm and the twins run in this process while there is no cluster, so that the
two do not compete for cores.
"""

from collections import deque
from collections.abc import Callable

from coordinator.errors import ClusterFailed
from coordinator.experiments.experiment import Case, Parameters, all_cases, cases_on, sequential_cases
from coordinator.experiments.journal import Journal, Record
from coordinator.experiments.measure import memory_of_nodes, run_in_process, run_on_nodes
from coordinator.launch.cluster import LocalCluster
from coordinator.launch.imports import import_all
from problems import ProblemFile
from topologies import torus_of

_FAILURES_IN_A_ROW = 2


class Runner:
    """Runs an experiment by its only method `run`.

    Args:
        file: the problem.
        parameters: the parameters of the experiment.
        journal: takes the records.
        say: called with one line for each step.
        force: whether to launch clusters even if this machine cannot hold so many nodes.
    """

    def __init__(
        self,
        file: ProblemFile,
        parameters: Parameters,
        journal: Journal,
        say: Callable[[str], None],
        *,
        force: bool = False,
    ) -> None:
        self.file = file
        self.parameters = parameters
        self.journal = journal
        self.say = say
        cases = list(all_cases(parameters))
        self._all = len(cases)
        self._done = sum(not journal.lacks(case) for case in cases)
        self._failures = 0
        self._force = force

    def run(self) -> None:
        """Make every run that is missing.

        Raises:
            ClusterFailed: if a size fails twice in a row.
            EvaluationFailed: if the problem's evaluation fails in this process.
        """
        if 0 < self._done < self._all:
            self.say(f"going on: {self._done} of {self._all} runs are made already")
        import_all()  # compiles what is not compiled yet, so that no measured launch includes that
        self._in_process(sequential_cases(self.parameters))
        for nodes in self.parameters.nodes:
            self._on_nodes(nodes)
            self._in_process(cases_on(self.parameters, nodes, "twin"))

    # In this process --------------------------------------------------------------------------------------------------
    def _in_process(self, cases: list[Case]) -> None:
        lacking = [case for case in cases if self.journal.lacks(case)]
        if lacking:  # one run of a single generation first, whose times are not kept: it warms this process up
            case = lacking[0]
            run_in_process(case.file(self.file, self.parameters).with_run(evaluations=case.nodes * case.deme), case)
        for case in lacking:
            self._keep(run_in_process(case.file(self.file, self.parameters), case))

    # On a cluster -----------------------------------------------------------------------------------------------------
    def _on_nodes(self, nodes: int) -> None:
        """Make every missing run of one size, on as many clusters as it takes.

        Raises:
            ClusterFailed: if clusters fail too often in a row.
        """
        waiting = deque(case for case in cases_on(self.parameters, nodes) if self.journal.lacks(case))
        self._failures = 0
        while waiting:
            trouble = self._trouble(nodes, waiting)
            if trouble is not None:
                self._failed(nodes, trouble)

    def _trouble(self, nodes: int, waiting: "deque[Case]") -> str | None:
        """Make runs on a new cluster; return the failure that ended it before all were made, or None."""
        try:
            self._launch_for_the_time(nodes)
            return self._serve(nodes, waiting)
        except ClusterFailed as error:
            self.journal.append({"type": "failure", "nodes": nodes, "message": str(error)})
            return str(error)

    def _launch_for_the_time(self, nodes: int) -> None:
        """Make the launches beyond the one that is needed, if a sample of launch times is wanted."""
        done = sum(record["nodes"] == nodes for record in self.journal.of_type("launch"))
        for _ in range(done, self.parameters.launches - 1):
            with self._cluster(nodes) as cluster:
                self._keep_launch(cluster, nodes)

    def _serve(self, nodes: int, waiting: "deque[Case]") -> str | None:
        """Launch a cluster and make runs on it until all are made or one fails; return why that one failed."""
        with self._cluster(nodes) as cluster:
            self._keep_launch(cluster, nodes)
            preparation = self._preparation(cluster, waiting[0])
            while waiting:
                case = waiting[0]
                record, _ = run_on_nodes(cluster, case.file(self.file, self.parameters), case, preparation)
                waiting.popleft()
                self._keep(record)
                if record["status"] == "failed":
                    return record["message"] or "a run failed without saying why"
                self._failures = 0
                self._keep_memory(cluster, nodes)
        return None

    def _cluster(self, nodes: int) -> LocalCluster:
        """Return a new cluster. A run in which a node died would be no measurement, so it is made anew on another."""
        return LocalCluster(topology=torus_of(nodes), force=self._force, on_node_death="fail")

    def _preparation(self, cluster: LocalCluster, case: Case) -> dict[str, float]:
        """Return the CPU seconds that each warm process uses for a job without a generation."""
        file = case.file(self.file, self.parameters).with_run(deme=1, emigrants=1, evaluations=case.nodes)
        used: dict[str, float] = {}
        for _ in range(2):
            record, used = run_on_nodes(cluster, file, case, {})
            if record["status"] == "failed":
                raise ClusterFailed(record["message"])
        return used

    def _failed(self, nodes: int, message: str) -> None:
        self._failures += 1
        if self._failures == _FAILURES_IN_A_ROW:
            raise ClusterFailed(f"{nodes} nodes failed {_FAILURES_IN_A_ROW} times in a row, at last: {message}")
        self.say(f"{nodes} nodes: failed, going on with a new cluster: {message}")

    # Records ----------------------------------------------------------------------------------------------------------
    def _keep_launch(self, cluster: LocalCluster, nodes: int) -> None:
        seconds = round(cluster.seconds_to_ready, 6)
        self.journal.append({"type": "launch", "nodes": nodes, "seconds": seconds})
        self.say(f"{nodes} nodes ({torus_of(nodes)}): ready after {seconds:.2f} s")

    def _keep_memory(self, cluster: LocalCluster, nodes: int) -> None:
        """Record the nodes' memory, once for each size, after its first run."""
        if not any(record["nodes"] == nodes for record in self.journal.of_type("memory")):
            self.journal.append({"type": "memory", "nodes": nodes, "bytes": round(memory_of_nodes(cluster))})

    def _keep(self, record: Record) -> None:
        self.journal.append(record)
        self._done += record["status"] != "failed"
        self.say(f"[{self._done}/{self._all}] {record['key']}: {_outcome(record)}")


def _outcome(record: Record) -> str:
    if record["status"] == "failed":
        return f"failed: {record['message'] or 'it does not say why'}"
    fitness = "nothing feasible" if record["fitness"] is None else f"fitness {record['fitness']:.4g}"
    return f"{record['status']}, {fitness}, {record['evaluations']:,} evaluations, {record['seconds']:.2f} s"

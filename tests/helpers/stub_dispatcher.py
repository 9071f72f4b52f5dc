"""A dispatcher whose jobs only pass the time: each runs for the seconds that its target says, and ends as solved."""

import dataclasses
import threading
import time
from dataclasses import replace

import topologies
from coordinator.jobs.client_limits import NO_LIMITS
from coordinator.jobs.job import Placement
from coordinator.jobs.scheduler import Scheduler
from problems import BadInput
from spy.result import Result
from wire.news import Improvement


class StubDispatcher:
    """Records what it is asked; runs jobs on timers, unless ``manual``."""

    def __init__(self, session, keys, nodes, hooks, *, limits=NO_LIMITS, manual=False, lost=False):
        self.hooks = hooks
        self.scheduler = Scheduler(nodes, limits, clock=time.monotonic)
        self.orders = {}
        self.asked = []
        self.placings = {}
        self.told = {}  # by job, what the spy knows
        self._manual = manual
        self._lost = lost  # whether nodes have forgotten their jobs
        self._lock = threading.RLock()
        self._timers = {}

    topology = "torus 4x4"

    def submit(self, spec, *, accepted_before=False):
        with self._lock:
            self.asked.append(("submit", spec.number))
            run = spec.file.run
            topology = topologies.parse(run.topology)
            self.scheduler.add(spec.number, topology.cells, topology.spec, spec.priority)
            self.orders[spec.number] = spec
            self._start()

    def adopt(self, spec, placement):
        with self._lock:
            self.asked.append(("adopt", spec.number, placement.nodes, placement.epoch))
            self.orders[spec.number] = spec
            self.placings[spec.number] = placement
            if self._lost:
                raise BadInput("they know nothing of it")
            self.scheduler.occupy(spec.number, placement.nodes, placement.file.run.topology)
            self._time(spec)

    def best_told(self, number):
        return self.told.get(number)

    def restored(self):
        pass

    def cancel(self, number):
        with self._lock:
            if number in self.orders:
                self.end(number, "cancelled")

    def update(self, number, fields):
        self.asked.append(("update", number, fields))
        return self._change(number, fields, {}, {"do": "update", "fields": fields})

    def rewire(self, number, topology):
        self.asked.append(("rewire", number, topology))
        return self._change(number, {}, {"topology": topology}, {"do": "rewire", "topology": topology})

    def _change(self, number, fields, run, why):
        now = self.placings[number]
        self._place(number, replace(now, epoch=now.epoch + 1, file=now.file.changed(fields, run), why=why))
        return now.epoch + 1

    def _place(self, number, placement):
        self.placings[number] = placement
        self.hooks.placed(number, placement)

    def placements(self):
        return []

    def nodes(self):
        return [{"node": node} for node in range(self.scheduler.nodes)]

    def spy(self):
        return 4711

    def close(self):
        for timer in self._timers.values():
            timer.cancel()

    def end(self, number, status="solved"):
        with self._lock:
            spec = self.orders.pop(number, None)
            if spec is None:
                return
            self.scheduler.remove(number)
            self.scheduler.free(number)
            self.hooks.ended(number, result(spec, status), lambda: None)
            self._start()

    def _start(self):
        for number, nodes in self.scheduler.start():
            self.hooks.changed(number, "preparing", nodes)
            self.placings[number] = Placement(0, self.orders[number].file, nodes, 1)
            self.hooks.changed(number, "running", nodes)
            self.hooks.improved(number, Improvement(number, 0, 0.1, 3, 1, 0.5, True, {"x": [float("inf")]}))
            self._time(self.orders[number])

    def _time(self, spec):
        if not self._manual:
            timer = threading.Timer(spec.file.run.target or 0.0, self.end, [spec.number])
            timer.daemon = True
            self._timers[spec.number] = timer
            timer.start()


def result(spec, status):
    """What came of a job of the stub's."""
    values = dict.fromkeys([field.name for field in dataclasses.fields(Result)])
    seconds = time.monotonic() - spec.submitted
    given = {"job": str(spec.number), "status": status, "fitness": 0.25, "seconds": seconds, "demes": []}
    return Result(**values | given)

"""A router and a coordinator with jobs that do what a test tells them, for tests of clients."""

import contextlib
import shutil
import tempfile
import threading
import time
from pathlib import Path

from wire import jobs, sessions
from wire.callbacks import direct
from wire.keys import Keys
from wire.news import Improvement
from wire.strict import Rejected

SOLUTION = {"x": 1.5}


class FakeService:
    """Answers requests as the coordinator does; `tell` and `improve` are what happens to jobs."""

    def __init__(self, cluster="fake"):
        self.keys = Keys(cluster)
        self.folder = Path(tempfile.mkdtemp(prefix="supernode-fake-"))
        self.endpoint = sessions.unix_socket(self.folder, "router")
        self.jobs = {}
        self.asked = []
        self.placements = []  # of jobs on several hosts, as `status` has them
        self.ends = "cluster"  # by `down`
        self.quiet = False  # publish nothing: only `show` tells
        self.router = self.session = None
        self.start_router()
        self.start()

    def start_router(self):
        self.router = sessions.router([self.endpoint])

    def stop_router(self):
        self.router.close()
        for leftover in self.folder.iterdir():
            leftover.unlink()

    def start(self):
        """The coordinator comes up (again), with the jobs that there are."""
        self.session = sessions.client(self.endpoint)
        self.queryable = self.session.declare_queryable(self.keys.any_request, direct(self.answer))

    def stop(self):
        self.session.close()
        self.session = None

    def close(self):
        for session in (self.session, self.router):
            with contextlib.suppress(Exception):
                session.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def tell(self, job, status, message=None, **more):
        """A job's state changes."""
        entry = self.jobs[job]
        entry.update(status=status, message=message, **more)
        state = jobs.JobState(job, entry["number"], status, entry["fitness"], message, time.time())
        self.publish(self.keys.state, state.encode())

    def improve(self, job, fitness, epoch=0, feasible=True):
        """The spy finds something better."""
        entry = self.jobs[job]
        better = Improvement(entry["number"], epoch, 0.1, 3, 2, float(fitness), feasible, SOLUTION)
        entry["best"] = vars(better)
        entry["fitness"] = float(fitness)
        self.publish(self.keys.best, better.encode())

    def end(self, job, status="solved"):
        entry = self.jobs[job]
        self.tell(job, status, result=result_of(job, status, entry["fitness"]), ended=time.time())

    def publish(self, key, payload):
        if not self.quiet and self.session is not None:
            self.session.put(key, payload)

    def wait_until_asked(self, name):
        for _ in range(3000):
            if name in self.asked:
                return
            time.sleep(0.01)
        raise AssertionError(f"nobody asked {name!r}")

    def answer(self, query):
        try:
            request = jobs.decode(query.payload.to_bytes())
            self.asked.append(request.name)
            answer = jobs.Done(self.value(request))
        except (Rejected, LookupError, ValueError) as error:
            answer = jobs.Refused(str(error.args[0]))
        query.reply(self.keys.requests(*Keys.asker_of(str(query.key_expr))), jobs.encode_answer(answer))

    def value(self, request):
        if isinstance(request, jobs.Status):
            return {
                "cluster": self.keys.cluster,
                "version": "0",
                "nodes": [],
                "placements": self.placements,
                "jobs": {},
            }
        if isinstance(request, jobs.ListJobs):
            return [self.brief(job) for job in self.jobs]
        if isinstance(request, jobs.Submit):
            return self.submitted(request)
        if isinstance(request, jobs.Down):
            threading.Timer(0.05, self.stop).start()
            return {"ends": self.ends}
        if request.job not in self.jobs:
            raise LookupError(f"there is no job {request.job!r}")
        return self.of_a_job(request, self.jobs[request.job])

    def submitted(self, request):
        known = self.jobs.get(request.id)
        if known is not None and known["file"] != request.file:
            raise ValueError(f"job {request.id} is another problem")
        if known is None:
            self.jobs[request.id] = {
                "job": request.id,
                "number": len(self.jobs) + 1,
                "kind": "function",
                "status": "queued",
                "fitness": None,
                "submitted": time.time(),
                "started": None,
                "ended": None,
                "cells": 16,
                "topology": "torus 4x4",
                "priority": request.priority,
                "message": None,
                "file": request.file,
                "file_now": request.file,
                "best": None,
                "result": None,
                "epoch": 0,
                "epochs": [],
                "nodes": [],
            }
        return {"job": request.id, "status": self.jobs[request.id]["status"]}

    def of_a_job(self, request, entry):
        if isinstance(request, jobs.Show):
            large = ("file", "file_now", "epochs") if request.brief else ()
            return {name: value for name, value in entry.items() if name not in large}
        if isinstance(request, jobs.Records):
            columns = ["id", "epoch", "generation", "cell", "evaluations", "fitness"]
            return {"columns": columns, "rows": [[1, 0, 3, 2, 400, entry["fitness"]]], "more": False}
        if isinstance(request, jobs.Cancel):
            threading.Timer(0.05, self.end, (request.job, "cancelled")).start()
            return {"job": request.job, "status": entry["status"]}
        entry["epochs"].append(request.patch if isinstance(request, jobs.Update) else request.topology)
        return {"job": request.job, "epoch": len(entry["epochs"])}

    def brief(self, job):
        long = ("file", "file_now", "best", "result", "epoch", "epochs", "nodes")
        return {name: value for name, value in self.jobs[job].items() if name not in long}


def result_of(job, status, fitness):
    """The `--json` object."""
    return {
        "job": job,
        "kind": "function",
        "status": status,
        "solved": status == "solved",
        "feasible": fitness is not None,
        "fitness": fitness,
        "solution": None if fitness is None else SOLUTION,
        "found_at": None if fitness is None else {"cell": [0, 2], "generation": 3},
        "generations": 7,
        "evaluations": 1000,
        "seconds": 0.1,
        "seconds_to_ready": 0.0,
        "cpu_seconds": 0.2,
        "nodes": 16,
        "topology": "torus 4x4",
        "deme": 1,
        "mode": "lockstep",
        "seed": 1,
        "run": {},
        "problem_sha256": "0",
        "versions": {},
        "directives": [],
        "messages": {"sent": 1, "received": 4, "lost": 0, "rejected": 0},
        "staleness": None,
        "history_sha256": "0",
        "message": None,
        "target": 0.0,
    }

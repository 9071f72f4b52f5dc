"""Make the report of a job: one HTML page with its outcome, figures, and everything that repeats the run."""

import base64
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any, NamedTuple

from coordinator.experiments.pages import rendered
from node.plan import Plan
from problems import BadInput, Problem, ProblemFile, Run, Solution
from problems.guard import described
from problems.run import DEFAULT_RESTARTS
from spy.result import Result
from supernode.client.client import Client
from supernode.files.toml_text import as_toml
from supernode.pictures.picture import as_png, drawn
from supernode.reports.figures import History, Record, pictures
from supernode.reports.records import pages
from supernode.runs.results import result_in, topology_of
from topologies import Topology

_DOTS_PER_INCH = 120
_VERDICTS = {True: "accepts", False: "rejects"}


class _Attachment(NamedTuple):
    """A file that the page holds as a link to save."""

    name: str
    url: str
    text: str


class _Setting(NamedTuple):
    """One setting of the ``[run]`` table."""

    name: str
    value: str
    meaning: str


@dataclass(frozen=True)
class _Best:
    """The best solution, or the best attempt if none is feasible, and where and when it was born."""

    fitness: float
    feasible: bool
    epoch: int
    generation: int
    cell: str
    solution: Solution


@dataclass(frozen=True)
class _Scene:
    """The problem with the best answer, as a picture and in words; or why there is no picture.

    Attributes:
        url: the picture as a data URL.
        words: the answer in words.
        problem: the problem; None if it cannot be loaded here.
        absence: why there is no picture; None if there is one.
        answer: what the page calls the answer.
    """

    url: str | None = None
    words: str | None = None
    problem: Problem | None = None
    absence: str | None = None
    answer: str = "solution"


def report(client: Client, job: str) -> str:
    """Return the HTML page about a job.

    Raises:
        BadInput: if there is no such job.
    """
    view = client.job(job).show()
    submitted, now = (ProblemFile.from_json(view[name]) for name in ("file", "file_now"))
    result = None if view["ended"] is None else result_in(view)
    best = _best(view, result)
    # Do not draw an answer to an earlier problem in the world as it is now.
    current = best is not None and not _has_moved_since(view, best.epoch)
    scene = _scene(now, best if current else None)
    history = _history(client, view)
    topology = topology_of(view, view["epoch"])
    return rendered(
        "supernode.reports",
        view=view,
        file=submitted,
        outcome=_outcome(view, best, result),
        scene=scene,
        pictures=pictures(history, topology),
        commands=_commands(job, result),
        warning=_warning(submitted, result),
        files=_files(view, submitted, result),
        settings=_settings(submitted.run, scene.problem),
        recipe=None if scene.problem is None else asdict(submitted.run.breeding(scene.problem)),
        problem=_toml(submitted),
        problem_now=None if view["file_now"] == view["file"] else _toml(now),
        digests=_digests(submitted, now, result),
        epochs=[(each["epoch"], _clock(each["at"]), _change(each)) for each in view["epochs"]],
        directives=[json.dumps(each) for each in result.directives] if result is not None else None,
        versions=result.versions if result is not None else {},
        cluster=client.status()["version"],
        made=(version("supernode"), _clock(datetime.now(UTC).timestamp())),
        states=[(state, _clock(at), f"{at - view['submitted']:.3f}") for state, at in view["states"]],
        improvements=_rows(history, view),
    )


def _history(client: Client, view: Mapping[str, Any]) -> History:
    improvements = _records(client, "improvements", view["job"])
    statistics = _records(client, "statistics", view["job"])
    began = next((at for state, at in view["states"] if state == "running"), view["submitted"])
    first = min((each["at"] for each in (*improvements, *statistics)), default=began)
    births = _births(_records(client, "history", view["job"]), improvements)
    # The first answer may be stored before the state "running" is: the axis of seconds must not begin below 0.
    began = min(began, first)
    return History(improvements, births, statistics, began)


def _births(noted: list[Record], heard: list[Record]) -> list[Record]:
    """Return the improvements of each epoch: as its cells recorded them, or else as the spy received them.

    What the cells recorded is the same in each repetition of a lockstep run. It is stored when an epoch has ended.
    """
    ended = {each["epoch"] for each in noted}
    births = [dict(each) for each in noted]
    births += [{**each, "evaluations": None} for each in heard if each["epoch"] not in ended]
    return sorted(births, key=lambda each: int(each["epoch"]))


def _records(client: Client, kind: str, job: str) -> list[Record]:
    return [dict(zip(page.columns, row, strict=True)) for page in pages(client, kind, job) for row in page.rows]


# The outcome ----------------------------------------------------------------------------------------------------------
def _best(view: Mapping[str, Any], result: Result | None) -> _Best | None:
    if result is not None and result.found is not None and result.found_at is not None:
        found = result.found_at
        cell, born = _place(found["cell"]), found["generation"]
        return _Best(result.fitness, result.feasible, found.get("epoch", 0), born, cell, result.found)
    best = view["best"]
    if result is not None or best is None:
        return None
    cell = _place(topology_of(view, best["epoch"]).place(best["cell"]))
    fitness = math.inf if best["fitness"] is None else best["fitness"]
    return _Best(fitness, best["feasible"], best["epoch"], best["generation"], cell, best["solution"])


def _has_moved_since(view: Mapping[str, Any], epoch: int) -> bool:
    """Return whether the problem was updated after ``epoch``."""
    return any("fields" in each and each["epoch"] > epoch for each in view["epochs"])


def _outcome(view: Mapping[str, Any], best: _Best | None, result: Result | None) -> dict[str, str]:
    facts = {"status": view["status"]}
    if view["message"]:
        facts["message"] = view["message"]
    if best is None:
        facts["fitness"] = "nothing was found"
    else:
        epoch = f" of epoch {best.epoch}" if best.epoch else ""
        facts |= {
            "fitness": f"{best.fitness:.9g} (lower is better)",
            "feasible": f"{'yes' if best.feasible else 'no'}, the independent check {_VERDICTS[best.feasible]} it",
            "born": f"in cell {best.cell}, generation {best.generation:,}{epoch}",
        }
    return facts | _totals(view, result)


def _totals(view: Mapping[str, Any], result: Result | None) -> dict[str, str]:
    if result is None:
        return {"began": _clock(view["started"]) if view["started"] else "not yet"}
    target = "none" if result.target is None else f"{result.target:.9g}"
    return {
        "target": f"{target}, {'reached' if result.solved else 'not reached'}",
        "seconds": f"{result.seconds:.3f} (CPU {result.cpu_seconds:.3f})",
        "generations": f"{result.generations:,}",
        "evaluations": f"{result.evaluations:,}",
        "messages": ", ".join(f"{count:,} {name}" for name, count in result.messages.items()),
    }


def _scene(file: ProblemFile, best: _Best | None) -> _Scene:
    """Draw and describe the best answer; a user's problem may be missing here or break, then say so instead."""
    try:
        problem = file.problem()
    except BadInput as error:
        return _Scene(absence=f"There is no picture of the solution, as the problem cannot be loaded here: {error}")
    url = words = absence = None
    is_attempt = best is not None and not best.feasible
    try:
        words = None if best is None else described(problem, best.solution)
        figure = drawn(problem, None if best is None else best.solution, is_attempt=is_attempt)
        url = _data_url("image/png", as_png(figure, _DOTS_PER_INCH))
        # Everything: drawing runs a user's code, which must not cost the rest of the report.
    except (Exception, SystemExit) as error:
        absence = f"There is no picture of the solution: {error}"
    return _Scene(url, words, problem, absence, "attempt, which is infeasible" if is_attempt else "solution")


def _rows(history: History, view: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the rows of the table of improvements."""
    lived = {epoch: topology_of(view, epoch) for epoch in {each["epoch"] for each in history.births}}
    return [_row(number, each, lived[each["epoch"]]) for number, each in enumerate(history.births, 1)]


def _row(number: int, record: Record, topology: Topology) -> tuple[str, ...]:
    return (
        str(number),
        str(record["epoch"]),
        f"{record['generation']:,}",
        _place(topology.place(record["cell"])),
        "–" if record["evaluations"] is None else f"{record['evaluations']:,}",
        "–" if record["fitness"] is None else f"{record['fitness']:.9g}",
    )


# How to repeat it -----------------------------------------------------------------------------------------------------
def _commands(job: str, result: Result | None) -> list[tuple[str, str]]:
    found = [(f"supernode solve {job}.toml", "runs it anew, on processes of its own, with the same settings")]
    if result is not None and result.solution is not None:
        found.insert(0, (f"supernode check {job}.toml {job}.json", "verifies the solution by independent code"))
    if _repeatable(result):
        what = "repeats the run in one process, bit for bit, and fails if history_sha256 differs"
        found.insert(0, (f"supernode simulate {job}.toml --replay {job}.json", what))
    return found


def _repeatable(result: Result | None) -> bool:
    return result is not None and result.mode == "lockstep" and _lived(result) is not None


def _lived(result: Result | None) -> str | None:
    """Return the digest of the run's history; None if it is not known, or nothing was run."""
    return result.history_sha256 if result is not None and result.evaluations > 0 else None


def _warning(file: ProblemFile, result: Result | None) -> str | None:
    """Return why the run cannot be repeated bit for bit; None if it can."""
    if _repeatable(result):
        return None
    if file.run.mode != "lockstep":
        return "It cannot be repeated bit for bit: an async run depends on when messages came."
    if result is None:
        return "It can be repeated bit for bit when it has ended: make this report again then."
    return "It cannot be repeated bit for bit: its history is not known, as it failed or never ran to its end."


def _files(view: Mapping[str, Any], file: ProblemFile, result: Result | None) -> list[_Attachment]:
    found = [_attachment(f"{view['job']}.toml", "application/toml", _toml(file))]
    if result is not None:
        text = json.dumps(view["result"] or result.to_json(), indent=2)
        found.append(_attachment(f"{view['job']}.json", "application/json", text))
    return found


def _attachment(name: str, kind: str, text: str) -> _Attachment:
    return _Attachment(name, _data_url(kind, text.encode()), text)


def _toml(file: ProblemFile) -> str:
    """Return the whole problem file as TOML, with each setting of the run that has a value."""
    return as_toml(file.fields, file.run.model_dump())


def _settings(run: Run, problem: Problem | None) -> list[_Setting]:
    return [
        _Setting(
            name,
            _in_force(name, run, problem) + ("" if name in run.model_fields_set else " (default)"),
            field.description or "",
        )
        for name, field in Run.model_fields.items()
    ]


def _in_force(name: str, run: Run, problem: Problem | None) -> str:
    """Return the value of a setting; if it has none, what holds instead."""
    value = getattr(run, name)
    if value is not None:
        return json.dumps(value)
    stall = run.stall_limit() if problem is None else Plan(problem, run).stall
    if name == "stall" and stall is not None:
        return f"none, therefore {stall}"
    if name == "restarts":
        most = "" if run.is_limited else f", at most {DEFAULT_RESTARTS}"
        return f"none, therefore as the kind of problem has it{most}"
    if name in ("replacement", "mutation") and problem is not None:
        return f"the recipe's {json.dumps(getattr(run.breeding(problem), name))}"
    return "none"


def _digests(file: ProblemFile, now: ProblemFile, result: Result | None) -> dict[str, str]:
    found = {"seed": str(file.run.seed), "problem_sha256 as submitted": file.sha256}
    if now.sha256 != file.sha256:
        found["problem_sha256 as it is now"] = now.sha256
    found["history_sha256"] = _lived(result) or "not known"
    if ":" in file.kind:  # a registered kind is part of an installed package
        found["module"] = f"{file.kind}, looked for in {file.folder}; it must lie beside the problem file"
    return found


def _change(epoch: Mapping[str, Any]) -> str:
    return json.dumps({name: value for name, value in epoch.items() if name not in ("epoch", "at")})


def _place(place: Any) -> str:
    return f"({', '.join(map(str, place))})"


def _clock(at: float) -> str:
    return datetime.fromtimestamp(at, UTC).isoformat(" ", "milliseconds").replace("+00:00", " UTC")


def _data_url(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"

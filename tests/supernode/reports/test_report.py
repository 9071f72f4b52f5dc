"""Reports and records of the jobs of a real cluster: whole, self-contained, and enough to repeat a run."""

import csv
import io
import json
import sys
import tempfile
import tomllib
from pathlib import Path

import pytest
from command_line import in_process
from hypothesis import given
from hypothesis import strategies as st
from live_service import ROOT, end_all_jobs, live, until
from pages import Page
from pyarrow import parquet

import supernode
import supernode.reports.report
from problems import Run
from problems.file import parse
from supernode.files.toml_text import as_toml
from supernode.reports.records import pages, write_csv, write_parquet

EVIL = "<script>alert(1)</script>&<b>.toml"
OWN = """
from pathlib import Path
from supernode import BitString, Problem

class Evil(Problem):
    @property
    def coding(self):
        return BitString(8, 1)

    def evaluate(self, genomes):
        if Path({away!r}).exists():
            raise RuntimeError("<i>broken</i>")
        return genomes.sum(axis=1).astype(float)
"""

pytestmark = pytest.mark.timeout(180)


def job(name="job", cost=0, dimension=64, **run):
    """Never solved."""
    fields = f'kind = "function"\nname = "onemax"\ndimension = {dimension}\ncost_us = {cost}\n'
    return parse(fields, name, Path()).with_run(**({"topology": "torus 2x2", "target": -1.0} | run))


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    folder = tmp_path_factory.mktemp("service")
    (folder / "evil.py").write_text(OWN.format(away=str(folder / "away")))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)  # where a cluster looks for modules
        with live(folder / "state", "torus 2x2", "--allow-module", "evil") as service:
            yield service


@pytest.fixture(scope="module")
def connection(service):
    with service.connect() as client:
        yield client


@pytest.fixture
def client(connection):
    yield connection
    end_all_jobs(connection)


@pytest.fixture
def command(service, capfd):
    """Runs a command on the service: exit code, stdout and stderr."""

    def run(*arguments, place=None):
        return in_process(capfd, *arguments, *(["--state", service.state] if place is None else place))

    return run


@pytest.fixture
def report(command, tmp_path):
    """The page about a job."""

    def make(name):
        path = tmp_path / f"{name}.html"
        assert command("report", name, "-o", path) == (0, "", "")
        page = Page(path.read_text())
        assert page.outside == []
        assert not {"script", "link", "iframe", "base"} & set(page.tags)
        return page

    return make


def told(client, kind, job):
    """Records by the names of their columns."""
    page = client.records(kind, job)
    return [dict(zip(page["columns"], row, strict=True)) for row in page["rows"]]


def has_every_parameter(page, view):
    """The problem and each setting, in words and in a file that can be read again."""
    _, fields, given, _ = json.loads(view["file"])
    found = tomllib.loads(page.files[f"{view['job']}.toml"])
    run = Run.model_validate(given)
    assert found.pop("run") == {name: value for name, value in run.model_dump().items() if value is not None}
    assert found == fields
    for name, field in Run.model_fields.items():
        assert name in page.text
        assert field.description in page.text
    assert page.files[f"{view['job']}.toml"] in page.text
    for state, _ in view["states"]:
        assert state in page.text
    return True


def test_an_ended_run_is_repeated_from_its_report_alone(client, report, command, tmp_path):
    file = supernode.load(ROOT / "examples" / "arm-ik.toml")
    result = client.submit(file, id="ended", topology="torus 2x2", seed=7, deme=3, stall=30).result(60)
    page = report("ended")
    assert has_every_parameter(page, client.job("ended").show())
    assert page.tags.count("svg") >= 3
    assert page.tags.count("img") == 1
    for part in (result.status, f"{result.fitness:.9g}", f"{result.generations:,}", result.history_sha256):
        assert part in page.text
    noted = told(client, "history", "ended")
    for each in noted:
        assert f"{each['evaluations']:,}" in page.text, "what the cells noted, not what the spy heard"
    for name, value in result.versions.items():
        assert f"{name} {value}" in page.text
    for name, text in page.files.items():
        (tmp_path / name).write_text(text)
    assert json.loads(page.files["ended.json"])["history_sha256"] == result.history_sha256
    problem, found = tmp_path / "ended.toml", tmp_path / "ended.json"
    for line in ("supernode simulate ended.toml --replay ended.json", "supernode check ended.toml ended.json"):
        assert line in page.text
    code, out, _ = command("simulate", problem, "--replay", found, "--json", "--quiet", place=[])
    assert json.loads(out)["history_sha256"] == result.history_sha256
    assert code == (0 if result.solved else 3)
    assert command("check", problem, found, place=[])[0] == 0


def test_a_run_through_several_epochs(client, report, command, tmp_path):
    file = supernode.load(ROOT / "examples" / "mobile-robot.toml")
    file = file.with_run(topology="torus 2x2", target=-1.0, restarts=0)
    running = client.submit(file, id="moved", seconds=60)
    next(running.improvements())
    assert running.update(obstacles=[]) == 1
    assert running.rewire("ring 4") == 2
    until(lambda: (running.show()["best"] or {}).get("epoch") == 2)
    running.cancel()
    result = running.result(30)
    page, view = report("moved"), running.show()
    assert has_every_parameter(page, view)
    assert "The problem as it is now" in page.text
    assert '"topology": "ring 4"' in page.text
    assert [each["do"] for each in result.directives] == ["update", "rewire", "stop"]
    for each in result.directives:
        assert json.dumps(each) in page.text
    for name, text in page.files.items():
        (tmp_path / name).write_text(text)
    code, out, err = command(
        "simulate", tmp_path / "moved.toml", "--replay", tmp_path / "moved.json", "--json", place=[]
    )
    assert json.loads(out)["history_sha256"] == result.history_sha256, (code, err)


@pytest.mark.parametrize(("change", "moved"), [({"fields": {"goal": 1}}, True), ({"topology": "ring 4"}, False)])
def test_an_answer_is_shown_only_in_an_epoch_that_it_is_an_answer_for(change, moved):
    view = {"epochs": [{"epoch": 1, **change}]}
    assert supernode.reports.report._has_moved_since(view, 0) is moved
    assert supernode.reports.report._has_moved_since(view, 1) is False


def test_a_running_job(client, report):
    running = client.submit(job(cost=1000, dimension=500), id="running")
    next(running.improvements())
    until(lambda: any(row["diversity"] > 0 for row in told(client, "statistics", "running")))
    page = report("running")
    assert running.state() == "running"
    assert has_every_parameter(page, running.show())
    assert "when it has ended" in page.text
    assert "supernode solve running.toml" in page.text
    assert list(page.files) == ["running.toml"]
    assert page.tags.count("svg") == 5
    assert "--replay" not in page.text


def test_a_cancelled_job_and_one_that_never_ran(client, report):
    running = client.submit(job(cost=1000), id="cancelled")
    waiting = client.submit(job(cost=1000), id="never")
    next(running.improvements())
    waiting.cancel()
    assert waiting.result(30).solution is None
    running.cancel()
    running.result(30)
    page = report("cancelled")
    assert has_every_parameter(page, running.show())
    assert '"reason": "cancel"' in page.text
    page = report("never")
    assert has_every_parameter(page, waiting.show())
    assert "nothing was found" in page.text
    assert "There are no records of it" in page.text
    assert "svg" not in page.tags
    assert "--replay" not in page.text


def test_html_in_names_is_text_and_a_broken_module_is_a_sentence(client, report, service):
    folder = service.state.parent
    file = parse('kind = "evil:Evil"\n', EVIL, folder).with_run(topology="torus 2x2", generations=5)
    client.submit(file, id="own").result(30)
    page = report("own")
    assert EVIL in page.text
    assert "have no picture" in page.text
    assert "evil:Evil, looked for in" in page.text
    (folder / "away").touch()
    broken = client.submit(file, id="broken")
    assert broken.result(30).status == "failed"
    page = report("broken")
    assert has_every_parameter(page, broken.show())
    assert "<i>broken</i>" in page.text
    assert "i" not in page.tags
    (folder / "evil.py").unlink()
    del sys.modules["evil"]
    page = report("own")
    assert "the problem cannot be loaded here" in page.text
    assert "img" not in page.tags


def test_an_async_run_says_that_it_cannot_be_repeated(client, report):
    client.submit(job(mode="async", generations=50), id="async").result(30)
    page = report("async")
    assert "an async run depends on when messages came" in page.text
    assert "--replay" not in page.text


# Records --------------------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def recorded(connection):
    """The id of a job with records of both kinds."""
    connection.submit(job(cost=100, dimension=500, seconds=2.5), id="recorded").result(60)
    return "recorded"


def paged(client, kind, job):
    """All records as the cluster tells them."""
    page = client.records(kind, job)
    columns, rows = page["columns"], page["rows"]
    while page["more"]:
        page = client.records(kind, job, rows[-1][0])
        rows += page["rows"]
    return columns, rows


@pytest.mark.parametrize("kind", ["improvements", "statistics"])
def test_exported_records_are_those_told(client, recorded, command, tmp_path, kind):
    columns, rows = paged(client, kind, recorded)
    assert rows
    code, out, err = command("export", recorded, "--records", kind)
    assert (code, err) == (0, "")
    titles, *lines = csv.reader(io.StringIO(out))
    assert [title.partition(" [")[0] for title in titles] == columns
    assert "at [Unix s]" in titles
    assert lines == [["" if value is None else str(value) for value in row] for row in rows]
    path = tmp_path / "records.parquet"
    assert command("export", recorded, "--records", kind, "-o", path) == (0, "", "")
    table = parquet.read_table(path)
    assert table.column_names == titles
    assert [list(row.values()) for row in table.to_pylist()] == rows
    assert command("export", recorded, "--records", kind, "--format", "csv", "-o", path) == (0, "", "")
    assert path.read_text() == out


@pytest.mark.parametrize("options", [("--format", "csv"), ("--format", "parquet")])
def test_a_job_alone_is_exported_as_its_statistics(client, recorded, command, tmp_path, options):
    path = tmp_path / "records"
    assert command("export", recorded, *options, "-o", path) == (0, "", "")
    _, rows = paged(client, "statistics", recorded)
    if options[1] == "csv":
        titles, *lines = csv.reader(path.read_text().splitlines())
        assert len(lines) == len(rows)
    else:
        table = parquet.read_table(path)
        titles = table.column_names
        assert [list(row.values()) for row in table.to_pylist()] == rows
    assert "messages_per_second [1/s]" in titles


def test_events_are_the_states_and_the_epochs_in_their_order(client, command, tmp_path):
    moving = client.submit(job(cost=100, dimension=500, keep_alive=True), id="restless")
    until(lambda: moving.state() == "running")
    moving.update(cost_us=50)
    until(lambda: moving.show()["epoch"] == 1)
    moving.cancel()
    moving.result(60)
    view = moving.show()
    code, out, err = command("export", "restless", "--records", "events")
    assert (code, err) == (0, "")
    titles, *lines = csv.reader(io.StringIO(out))
    assert titles == ["at [Unix s]", "event", "epoch", "generation", "about"]
    states = [line[:2] for line in lines if not line[2]]
    assert states == [[str(at), state] for state, at in view["states"]]
    (update,) = [line for line in lines if line[2]]
    assert update[1:3] == ["update", "1"]
    assert json.loads(update[4]) == {"fields": {"cost_us": 50}}
    assert [float(line[0]) for line in lines] == sorted(float(line[0]) for line in lines)
    path = tmp_path / "events.parquet"
    assert command("export", "restless", "--records", "events", "-o", path) == (0, "", "")
    rows = parquet.read_table(path).to_pylist()
    assert [["" if value is None else str(value) for value in row.values()] for row in rows] == lines


def test_the_log_of_a_job_is_exported(service, client, command, tmp_path):
    running = client.submit(job(cost=1000, dimension=500), id="hurt")
    until(lambda: running.state() == "running")
    service.kill("node 2")
    until(lambda: client.logs("hurt")["rows"])
    running.cancel()
    running.result(60)
    told = client.logs("hurt")
    path = tmp_path / "log.parquet"
    assert command("export", "hurt", "--records", "log", "-o", path) == (0, "", "")
    rows = parquet.read_table(path).to_pylist()
    assert [list(row.values()) for row in rows] == told["rows"]
    code, out, _ = command("export", "hurt", "--records", "log")
    titles, *lines = csv.reader(io.StringIO(out))
    assert (code, titles) == (0, ["id", "at [Unix s]", *told["columns"][2:]])
    assert [line[4] for line in lines] == [row["text"] for row in rows]
    (death,) = [row for row in rows if row["text"] == "a process has died: another one lives on node 2"]
    assert (death["job"], death["node"], death["cell"]) == ("hurt", 2, 2)


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["export", "recorded", "--records", "gossip"], 2, "--records: invalid choice: 'gossip'"),
        (["export", "recorded", "r.json", "--records", "statistics"], 2, "RESULT.json: expected none with --records"),
        (["export", "recorded", "--records", "statistics", "--rate", "3"], 2, "--rate: expected none with --records"),
        (["export", "recorded", "--records", "statistics", "--format", "mcap"], 2, "--format: expected one of csv, pa"),
        (["export", "recorded", "--records", "statistics", "--format", "parquet"], 2, "-o: expected a file to write P"),
        (["export", "recorded", "--records", "statistics", "-o", "/nowhere/r.csv"], 2, "-o: expected a file that can "),
        (["export", "recorded", "--records", "statistics", "-o", "/nowhere/r.parquet"], 2, "-o: expected a file that"),
        (["export", "nobody", "--records", "statistics"], 2, "there is no job 'nobody'"),
        (["export", "p.toml", "r.json"], 2, "--state: expected only with --records, found "),
        (["export", "p.toml"], 2, "RESULT.json: expected a result, or a job in place of PROBLEM.toml, found "),
        (["export", "nobody"], 2, "there is no job 'nobody'"),
        (["export", "recorded", "--speed", "3"], 2, "--speed: expected none with --records, found 3"),
        (["report", "nobody", "-o", "/tmp/x.html"], 2, "there is no job 'nobody'"),
        (
            ["report", "recorded", "-o", "/nowhere/x.html"],
            2,
            "-o: expected a file that can be written, found /nowhere/",
        ),
        (["report", "recorded"], 2, "the following arguments are required: -o"),
    ],
)
def test_wrong_commands_are_one_line(command, recorded, arguments, code, said):
    found, out, err = command(*arguments)
    assert (found, out, len(err.splitlines())) == (code, "", 1)
    assert err.startswith(f"error: {said}")


@pytest.mark.parametrize("arguments", [["export", "a", "--records", "statistics"], ["report", "a", "-o", "a.html"]])
def test_no_cluster_is_one_line_and_no_file(command, tmp_path, monkeypatch, arguments):
    monkeypatch.chdir(tmp_path)
    code, out, err = command(*arguments, place=["--state", str(tmp_path)])
    assert (code, out, len(err.splitlines())) == (1, "", 1)
    assert list(tmp_path.iterdir()) == []


def test_what_is_missing_is_said(command, monkeypatch, recorded, tmp_path):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    code, _, err = command("export", recorded, "--records", "statistics", "-o", tmp_path / "r.parquet")
    assert (code, err) == (2, "error: --format: parquet needs pyarrow: pip install 'supernode[scale]'\n")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    code, _, err = command("report", recorded, "-o", tmp_path / "r.html")
    assert (code, err) == (2, "error: report: expected jinja2 to be installed: pip install 'supernode[report]'\n")


class Pages:
    """A cluster that has so many records, and tells so many at a time."""

    def __init__(self, count, at_once):
        self.count, self.at_once = count, at_once

    def records(self, kind, job, after=0):
        rows = [[number, number / 2] for number in range(after + 1, self.count + 1)]
        return {"columns": ["id", "at"], "rows": rows[: self.at_once], "more": len(rows) > self.at_once}


@given(st.integers(0, 30), st.integers(1, 10))
def test_no_page_is_missing_or_told_twice(count, at_once):
    found = list(pages(Pages(count, at_once), "statistics", "a"))
    assert [row[0] for page in found for row in page.rows] == list(range(1, count + 1))
    assert len(found) == max(1, -(-count // at_once))
    with tempfile.TemporaryDirectory() as folder:
        name = str(Path(folder) / "records")
        write_csv(iter(found), name)
        assert len(Path(name).read_text().splitlines()) == count + 1
        write_parquet(iter(found), name)
        assert parquet.read_table(name).num_rows == count


# Problem files as text ------------------------------------------------------------------------------------------------
SCALARS = st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text()
VALUES = st.recursive(SCALARS, lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner), max_leaves=20)


@given(st.dictionaries(st.text().filter(lambda name: name != "run"), VALUES), st.dictionaries(st.text(), SCALARS))
def test_what_is_written_as_toml_is_read_again(fields, run):
    assert tomllib.loads(as_toml(fields, run)) == fields | {"run": run}


def test_what_is_none_is_left_out_of_toml():
    text = as_toml({"kind": "x", "walls": [{"a": 1, "b": None}]}, {"seed": 1, "seconds": None})
    assert tomllib.loads(text) == {"kind": "x", "walls": [{"a": 1}], "run": {"seed": 1}}


def test_all_examples_survive_being_written():
    for path in (ROOT / "examples").glob("*.toml"):
        file = supernode.load(path)
        again = parse(as_toml(file.fields, file.run.model_dump()), path.name, file.folder)
        assert again.sha256 == file.sha256, path
        assert again.run == file.run

"""`supernode scale` as a person types it: output, exit codes, going on after an interruption."""

import json
import signal
import subprocess
import sys
import time

import pytest
from command_line import in_process

QUICK = (
    *("--nodes", "4", "--repeats", "2", "--seeds", "2", "--series", "growing-population"),
    *("--sequential", "4", "--evaluations", "20000"),
)


@pytest.fixture
def problem(own_problem):
    return own_problem("size = 24")


def begin(*arguments):
    return subprocess.Popen(
        [sys.executable, "-m", "supernode", "scale", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def runs_on_nodes(folder):
    path = folder / "runs.jsonl"
    return path.read_text().count('"role": "nodes"') if path.exists() else 0


def wait_for_runs(folder, count):
    """Until so many runs on nodes have been written down."""
    deadline = time.monotonic() + 60
    while runs_on_nodes(folder) < count:
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_help_has_an_example(capsys):
    code, out, _ = in_process(capsys, "scale", "--help")
    assert code == 0
    assert "supernode scale examples/mobile-robot.toml" in out.split("example:")[1]


def test_an_interrupted_experiment_goes_on(own_problem, tmp_path, capsys):
    problem = own_problem("size = 1000")  # never solved: each run takes a quarter of a second
    folder = tmp_path / "out"
    for end, code in ((signal.SIGKILL, -signal.SIGKILL), (signal.SIGINT, 130)):
        count = runs_on_nodes(folder)
        process = begin(problem, *QUICK, "-o", folder)
        wait_for_runs(folder, count + 1)
        process.send_signal(end)
        _, err = process.communicate(timeout=30)
        assert process.returncode == code, err
    assert "the same command goes on from here" in err
    assert "Traceback" not in err
    assert not (folder / "report.html").exists()
    before = (folder / "runs.jsonl").read_text()
    code, out, err = in_process(capsys, "scale", problem, *QUICK, "-o", folder, "--json")
    assert code == 0
    assert "going on:" in err
    result = json.loads(out)
    assert (result["runs"], result["failed"]) == (2 + 4 + 2, 0)
    assert (folder / "report.html").exists()
    after = (folder / "runs.jsonl").read_text()
    assert after.startswith(before)
    keys = [json.loads(line)["key"] for line in after.splitlines() if json.loads(line)["type"] == "run"]
    assert len(keys) == len(set(keys)) == 8
    assert result["verdict"][0].startswith("Strong speed-up, in evaluations: cannot be told")
    _check_nothing_is_done_again(problem, folder, result, capsys)


def _check_nothing_is_done_again(problem, folder, result, capsys):
    code, out, err = in_process(capsys, "scale", problem, *QUICK, "-o", folder, "--quiet", "--json")
    assert (code, err) == (0, "")
    assert json.loads(out) == result
    code, out, err = in_process(capsys, "scale", problem, *QUICK, "-o", folder, "--stall", "9")
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert "(there / here): run.stall not given / 9" in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--nodes", "4,zero"), "error: --nodes: expected whole numbers separated by commas, found '4,zero'"),
        (("--nodes", "0"), "error: --nodes: expected whole numbers from 1 to 4096, found 0"),
        (("--modes", "sync"), "error: --modes: expected some of lockstep, async, found 'sync'"),
        (("--series", ""), "error: --series: expected some of fixed-population, growing-population, budget, found ''"),
        (("--mutation", "2"), "error: options: mutation"),
    ],
)
def test_wrong_options(problem, tmp_path, capsys, arguments, message):
    code, out, err = in_process(capsys, "scale", problem, *arguments, "-o", tmp_path / "out")
    assert (code, out) == (2, "")
    assert err.startswith(message)
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_folder_that_is_none(problem, tmp_path, capsys):
    (tmp_path / "taken").write_text("")
    for name in ("taken", "taken/inside"):
        code, _, err = in_process(capsys, "scale", problem, *QUICK, "-o", tmp_path / name)
        assert code == 2
        assert err.startswith(f"error: {tmp_path / name}: expected a folder that can be written, found ")


def test_a_problem_without_a_target_has_only_a_budget(own_problem, tmp_path, capsys):
    problem = own_problem("size = 24")
    module = tmp_path / "own_module.py"
    module.write_text(module.read_text().replace("return 0.0", "return None"))
    code, _, err = in_process(capsys, "scale", problem, *QUICK, "-o", tmp_path / "out")
    assert code == 2
    assert "expected a problem with a target, found none; give --target, or --series budget" in err


@pytest.mark.parametrize("library", ["pyarrow", "jinja2"])
def test_without_its_libraries_it_says_what_to_install(problem, tmp_path, capsys, monkeypatch, library):
    monkeypatch.setitem(sys.modules, library, None)
    code, out, err = in_process(capsys, "scale", problem, "-o", tmp_path / "out")
    assert (code, out) == (2, "")
    assert err == f"error: scale: expected {library} to be installed: pip install 'supernode[scale]'\n"


def test_a_problem_that_breaks_ends_it(own_problem, tmp_path, capsys):
    problem = own_problem("size = 24", 'trouble = "raises"')
    code, out, err = in_process(capsys, "scale", problem, *QUICK, "-o", tmp_path / "out", "--quiet")
    assert (code, out) == (1, "")
    assert err == "error: own_module:OneMax: evaluate raised RuntimeError: out of paper\n"

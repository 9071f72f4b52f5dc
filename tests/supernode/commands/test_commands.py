"""The command line as a person types it: output, exit codes, errors of one line."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command_line import in_process

import supernode

ARM = Path(__file__).resolve().parents[3] / "examples" / "arm-ik.toml"
KINDS = [
    "arm-ik",
    "arm-path",
    "coordination",
    "function",
    "min-time",
    "mobile-robot",
    "robot-ik",
    "robot-path",
    "sphere-path",
    "terrain",
]
COMMANDS = ("solve", "simulate", "check", "export", "view", "oracle", "topology", "problems", "init")


def run(*arguments, **options):
    return subprocess.run(
        [sys.executable, "-m", "supernode", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        **options,
    )


def test_help_names_every_command_and_each_has_an_example(capsys):
    code, out, _ = in_process(capsys, "--help")
    assert code == 0
    assert all(command in out for command in COMMANDS)
    for command in COMMANDS:
        code, out, _ = in_process(capsys, command, "--help")
        assert code == 0
        assert f"supernode {command} " in out.split("example:")[1]


def test_help_imports_nothing_heavy():
    script = (
        "import sys; from supernode.__main__ import main\n"
        "try: main(['solve', '--help'])\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'numba', 'zenoh', 'pydantic', 'matplotlib', 'shapely', 'rich'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    assert subprocess.run([sys.executable, "-c", script], capture_output=True, check=False).returncode == 0


@pytest.mark.parametrize(
    "module",
    [
        "coordinator.service.process",
        "supernode.launch.own_cluster",
        "supernode.launch.supervisor",
        "coordinator.launch.host",
    ],
)
def test_who_never_breeds_loads_no_compiled_code(module):
    """It takes more than half a second, in which a cluster could start."""
    script = f"import sys, {module}; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0


def test_version(capsys):
    code, out, _ = in_process(capsys, "--version")
    assert (code, out.split()[0]) == (0, "supernode")


def test_solve_prints_words_and_simulate_agrees(own_problem, capsys):
    path = own_problem()
    solved = run("solve", path, "--seed", 4)
    assert solved.returncode == 0
    assert solved.stdout.startswith("solved: fitness 0, found by cell (")
    assert "on 16 nodes (torus 4x4, deme 1, lockstep, seed 4)" in solved.stdout
    assert "generation" in solved.stderr
    code, out, _ = in_process(capsys, "simulate", path, "--seed", 4)
    assert code == 0
    assert out.splitlines()[0] == solved.stdout.splitlines()[0]


def test_json_is_one_object_and_nothing_else(own_problem, capsys):
    path = own_problem()
    results = []
    for command in ("solve", "simulate"):
        done = run(command, path, "--json", "--quiet", "--torus", "2x2", "--deme", 3)
        assert done.returncode == 0
        assert done.stderr == ""
        results.append(json.loads(done.stdout))
    solve, simulate = results
    same = ("history_sha256", "fitness", "found_at", "generations", "evaluations", "messages", "run", "problem_sha256")
    assert {name: solve[name] for name in same} == {name: simulate[name] for name in same}
    assert solve["cpu_seconds"] > solve["seconds"] / 10


def test_exit_codes_of_runs(own_problem, capsys):
    path = own_problem()
    assert in_process(capsys, "simulate", path, "--generations", 1)[0] == 3
    assert in_process(capsys, "simulate", path, "--target", 39)[0] == 0
    code, out, _ = in_process(capsys, "simulate", path, "--target", -1, "--stall", 3)
    assert (code, out.split(":")[0]) == (3, "stalled")


def test_a_broken_problem_is_a_failed_result_and_an_error_line(own_problem, capsys):
    broken = own_problem('trouble = "raises"', name="broken.toml")
    for command in ("solve", "simulate"):
        code, out, err = in_process(capsys, command, broken, "--torus", "2x2", "--json", "--quiet")
        assert code == 1
        result = json.loads(out)
        assert (result["status"], result["history_sha256"]) == ("failed", None)
        assert result["message"] == "own_module:OneMax: evaluate raised RuntimeError: out of paper"
        assert err == f"error: {result['message']}\n"


def test_a_deadline_ends_a_simulation_and_can_be_replayed(own_problem, capsys):
    path = own_problem("size = 4000")
    code, out, _ = in_process(capsys, "simulate", path, "--seconds", 0.2, "--json", "--quiet")
    result = json.loads(out)
    assert (code, result["status"]) == (3, "deadline")
    _, out, _ = in_process(capsys, "simulate", path, "--generations", result["generations"], "--json", "--quiet")
    assert json.loads(out)["history_sha256"] == result["history_sha256"]


def test_a_run_that_is_shown_is_the_same_run(own_problem):
    path = own_problem("size = 30")
    shown, alone = (run("solve", path, "--torus", "2x2", "--json", *more) for more in (["--dashboard", "[::1]:0"], []))
    assert shown.returncode == 0
    assert "dashboard of this run: http://[::1]:" in shown.stderr
    same = ("status", "fitness", "history_sha256", "evaluations", "run")
    shown, alone = json.loads(shown.stdout), json.loads(alone.stdout)
    assert {name: shown[name] for name in same} == {name: alone[name] for name in same}


def test_a_cluster_that_is_up_is_not_shown_by_solve(own_problem, capsys):
    place = ["--connect", "tcp/127.0.0.1:1", "--dashboard", "127.0.0.1:0"]
    code, out, err = in_process(capsys, "solve", own_problem(), *place)
    assert (code, out, len(err.splitlines())) == (2, "", 1)
    assert err.startswith("error: --dashboard: expected none with --connect")


@pytest.mark.parametrize("command", ["solve", "simulate"])
def test_ctrl_c_prints_the_best_so_far(own_problem, command):
    path = own_problem("size = 4000")
    process = subprocess.Popen(
        [sys.executable, "-m", "supernode", command, str(path), "--stall", "1000000", "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert any("fitness" in line for line in process.stderr)
    began = time.monotonic()
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=10)
    assert time.monotonic() - began < 5
    assert process.returncode == 130
    result = json.loads(out)
    assert result["status"] == "cancelled"
    assert 0 < result["fitness"] < 4000


def test_check_accepts_rejects_and_cannot_read(own_problem, tmp_path, capsys):
    path, result = own_problem(), tmp_path / "result.json"
    _, out, _ = in_process(capsys, "simulate", path, "--json", "--quiet")
    whole = json.loads(out)
    cases = [
        (whole, 0, "accepted: fitness 0"),
        (whole["solution"], 0, "accepted: fitness 0"),
        (whole | {"fitness": 3.0}, 3, "rejected: the result claims a fitness of 3.0, the check finds 0"),
        (whole | {"problem_sha256": "0" * 64}, 3, "rejected: the result is of another problem"),
        (whole | {"solution": None, "fitness": None, "solved": False}, 3, "rejected: there is no solution"),
        (whole | {"solution": {"integers": [0] * 40}}, 3, "rejected: the result claims a fitness of 0.0"),
    ]
    for claim, code, said in cases:
        result.write_text(json.dumps(claim))
        found, out, _ = in_process(capsys, "check", path, result)
        assert (found, out[: len(said)]) == (code, said)
    for text in ("", "[1]", "{", '{"solution": {"nonsense": 1}}', '{"solution": {"integers": "zz"}}'):
        result.write_text(text)
        code, out, err = in_process(capsys, "check", path, result)
        assert (code, out) == (2, "")
        assert err.startswith(f"error: {result}: ")
        assert len(err.splitlines()) == 1
    assert in_process(capsys, "check", path, tmp_path / "none.json")[0] == 2


def test_the_result_of_a_world_that_has_moved_is_checked_in_the_world_as_it_became(tmp_path, capsys):
    moved = {"target": [0.7, 0.9]}
    there = tmp_path / "there.toml"
    there.write_text(re.sub(r"(?m)^target = .*$", f"target = {moved['target']}", ARM.read_text()))
    claim = json.loads(in_process(capsys, "simulate", there, "--json", "--quiet")[1])
    result = tmp_path / "result.json"
    update = {"do": "update", "epoch": 1, "fields": moved, "generation": 5}
    for directives, code in (([update], 0), ([{"do": "stop", "generation": 5}, update], 0), ([], 3)):
        result.write_text(json.dumps(claim | {"directives": directives}))
        assert in_process(capsys, "check", ARM, result)[0] == code
    result.write_text(json.dumps(claim | {"directives": [update | {"fields": {"target": "up"}}]}))
    code, _, err = in_process(capsys, "check", ARM, result)
    assert (code, err.startswith(f"error: {result}: ")) == (2, True)


def test_the_oracle_answers_in_words(capsys):
    code, out, err = in_process(capsys, "oracle", ARM, "--quiet")
    figure, method = out.splitlines()
    assert (code, err) == (0, "")
    assert figure.startswith("optimum 0.00")
    assert method.startswith("by enumeration of all 65536 coded configurations, in ")
    assert method.endswith(" s")


def test_the_oracle_answers_in_json_and_the_check_accepts_its_solution(tmp_path, capsys):
    code, out, err = in_process(capsys, "oracle", ARM, "--json", "--quiet")
    answer = json.loads(out)
    assert (code, err, len(out.splitlines())) == (0, "", 1)
    assert list(answer) == ["meaning", "fitness", "method", "seconds", "figures", "solution"]
    result = tmp_path / "result.json"
    result.write_text(json.dumps(answer["solution"]))
    code, out, _ = in_process(capsys, "check", ARM, result)
    clearance = "least clearance 0.284 m, at link 1, obstacle 1, configuration [1.816, 4.565]"
    assert (code, out) == (0, f"accepted: fitness {answer['fitness']:g}, {clearance}\n")


ORACLE = """
import time


class Knowing(OneMax):
    def oracle(self):
        print("thinking")
        if self.trouble == "long":
            time.sleep(1.0)
        if self.trouble == "raises":
            raise RuntimeError("the oracle is silent")
        if self.trouble == "nan":
            return supernode.Answer("optimum", float("nan"), "a guess")
        if self.trouble == "count":
            return 3
        if self.trouble == "objects":
            return supernode.Answer("optimum", 0.0, "a guess", {"x": object()})
        if self.trouble == "none":
            return supernode.Answer("optimum", float("inf"), "proof")
        return supernode.Answer("upper bound", 1.5, "a guess", None, {"fewest": 7, "longest": float("inf")})
"""


def knowing(own_problem, trouble=""):
    """A problem file of one's own with an oracle."""
    path = own_problem(f'trouble = "{trouble}"')
    module = path.with_name("own_module.py")
    module.write_text(module.read_text() + ORACLE)
    path.write_text(path.read_text().replace("OneMax", "Knowing"))
    return path


def test_the_oracle_of_a_users_problem(own_problem, capsys):
    code, out, err = in_process(capsys, "oracle", knowing(own_problem))
    figure, method, *figures = out.splitlines()
    assert (code, figure, figures) == (0, "upper bound 1.5", ["fewest: 7", "longest: inf"])
    assert method.startswith("by a guess, in ")
    assert err == "thinking\n", "what the module prints is no part of the answer"
    _, out, _ = in_process(capsys, "oracle", knowing(own_problem), "--json")
    assert json.loads(out)["figures"] == {"fewest": 7, "longest": None}


@pytest.mark.parametrize("options", [[], ["--json"]])
def test_a_long_oracle_says_that_it_works_unless_it_shall_be_quiet(own_problem, capsys, monkeypatch, options):
    monkeypatch.setattr("supernode.commands.oracle._PATIENCE", 0.4)  # time to get as far as thinking
    path = knowing(own_problem, "long")
    code, out, err = in_process(capsys, "oracle", path, *options)
    assert (code, err) == (0, "thinking\nworking out the exact answer …\n")
    quiet, same, err = in_process(capsys, "oracle", path, *options, "--quiet")
    assert (quiet, err) == (0, "thinking\n")
    assert len(same.splitlines()) == len(out.splitlines())


def test_what_cannot_be_solved_has_no_figure(own_problem, capsys):
    path = knowing(own_problem, "none")
    assert in_process(capsys, "oracle", path)[1].splitlines()[0] == "no feasible solution"
    assert json.loads(in_process(capsys, "oracle", path, "--json")[1])["fitness"] is None


@pytest.mark.parametrize(
    ("trouble", "said"),
    [
        ("raises", "oracle raised RuntimeError: the oracle is silent"),
        ("nan", "oracle must return a supernode.Answer"),
        ("count", "oracle must return a supernode.Answer, got 3"),
        ("objects", "oracle must answer in plain JSON values"),
    ],
)
def test_an_oracle_that_breaks_is_one_error_line(own_problem, capsys, trouble, said):
    code, out, err = in_process(capsys, "oracle", knowing(own_problem, trouble))
    assert (code, out) == (1, "")
    assert err.splitlines()[-1].startswith(f"error: own_module:Knowing: {said}")


def test_a_problem_without_an_oracle_says_so_in_one_line(own_problem, capsys):
    path = own_problem()
    code, out, err = in_process(capsys, "oracle", path)
    assert (code, out) == (2, "")
    assert err == f"error: {path}: problems of kind 'own_module:OneMax' have no oracle\n"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--deme", "x"], "error: --deme: expected a whole number, found 'x'"),
        (["--deme", "0"], "options: deme: expected greater than or equal to 1, found 0"),
        (["--torus", "0x4"], "--torus: expected at least 1 row and 1 column, found 0 x 4"),
        (["--torus", "four"], "--torus: expected rows and columns such as \"4x4\", found 'four'"),
        (["--seconds", "nan"], "found NaN"),
        (["--seconds", "-1"], "found -1"),
        (["--target", "inf"], "target"),
        (["--mutation", "2"], "mutation"),
        (["--mutation", "some"], 'expected a probability or "one-bit"'),
        (["--mode", "sometimes"], "--mode"),
        (["--emigrants", "2"], "expected at most the deme, 1, found 2"),
        (["--log", "/no/such/folder/x.jsonl"], "--log: expected a file in a folder that exists"),
        (["--plot", "picture.xyz"], "--plot: expected a name that ends in .png, .svg or .pdf, found picture.xyz"),
        (["--nonsense"], "--nonsense"),
    ],
)
def test_bad_options_get_one_line_and_exit_code_2(own_problem, capsys, arguments, said):
    for command in ("solve", "simulate"):
        code, out, err = in_process(capsys, command, own_problem(), *arguments)
        assert (code, out, len(err.splitlines())) == (2, "", 1), err
        assert err.startswith("error: ")
        assert said in err


def test_bad_files_get_one_line_and_exit_code_2(tmp_path, capsys):
    cases = {
        "missing.toml": (None, "found no such file"),
        "not.toml": ("kind = ", "expected TOML"),
        "unknown.toml": ('kind = "arm-ki"', "did you mean 'arm-ik'?"),
        "module.toml": ('kind = "no_such_module:Thing"', "cannot import 'no_such_module:Thing'"),
        "kindless.toml": ("size = 3", "kind: expected a kind of problem"),
    }
    for name, (text, said) in cases.items():
        path = tmp_path / name
        if text is not None:
            path.write_text(text)
        for command in ("solve", "simulate", "oracle"):
            code, out, err = in_process(capsys, command, path)
            assert (code, out) == (2, "")
            (error,) = [line for line in err.splitlines() if "error" in line]
            assert error.startswith(f"error: {path}: ")
            assert said in error


@pytest.mark.parametrize("command", ["solve", "submit", "simulate"])
def test_an_arm_that_cannot_reach_is_refused_before_anything_is_launched(tmp_path, capsys, monkeypatch, command):
    path = tmp_path / "far.toml"
    path.write_text(ARM.read_text().replace("target = ", "target = [9.0, 0.0] # "))
    monkeypatch.setattr("coordinator.launch.launcher.Launcher.__init__", lambda *_, **__: pytest.fail("launched"))
    options = ["--state", tmp_path] if command == "submit" else []
    code, out, err = in_process(capsys, command, path, *options)
    assert (code, out, len(err.splitlines())) == (2, "", 1)
    assert err.startswith(f"error: {path}: target: expected a point at most 1.8 m from arm.base")
    assert in_process(capsys, "simulate", path, "--target", 7.5, "--quiet")[0] == 0


def test_problems_lists_kinds_and_fields(capsys):
    code, out, _ = in_process(capsys, "problems")
    assert code == 0
    kinds = [line.split()[0] for line in out.splitlines()]
    assert kinds == KINDS
    for kind in kinds:
        code, out, _ = in_process(capsys, "problems", kind)
        assert (code, "required" in out) == (0, True)
        code, out, _ = in_process(capsys, "problems", kind, "--json")
        assert "properties" in json.loads(out)
    code, _, err = in_process(capsys, "problems", "arm-iq")
    assert code == 2
    assert "did you mean 'arm-ik'" in err


@pytest.mark.parametrize("kind", KINDS)
def test_init_writes_a_file_that_can_be_solved_and_overwrites_nothing(kind, tmp_path, capsys):
    path = tmp_path / "new.toml"
    code, out, _ = in_process(capsys, "init", kind, path)
    assert code == 0
    assert str(path) in out
    assert supernode.load(path).kind == kind
    assert in_process(capsys, "simulate", path, "--quiet")[0] == 0
    before = path.read_text()
    code, _, err = in_process(capsys, "init", kind, path)
    assert code == 2
    assert "expected a new file" in err
    assert path.read_text() == before


def test_output_that_nobody_reads_is_no_traceback(own_problem):
    process = subprocess.run(
        f"{sys.executable} -m supernode problems function --json | true",
        shell=True,
        capture_output=True,
        text=True,
        check=False,
    )
    assert "Traceback" not in process.stderr


def test_names_of_the_python_face():
    assert set(supernode.__all__) <= set(dir(supernode))
    for name in supernode.__all__:
        assert getattr(supernode, name).__doc__
    with pytest.raises(AttributeError, match="no attribute 'Nonsense'"):
        _ = supernode.Nonsense


def test_where_there_is_no_picture_the_result_still_counts(own_problem, tmp_path, capsys):
    picture = tmp_path / "x.png"
    code, out, err = in_process(capsys, "simulate", own_problem(), "--quiet", "--plot", picture)
    assert (code, out.split(":")[0]) == (0, "solved")
    assert "warning: no picture: " in err
    assert not Path(picture).exists()


def test_what_a_users_module_prints_is_no_part_of_the_result(own_problem, tmp_path):
    path = own_problem()
    module = tmp_path / "own_module.py"
    module.write_text("print('hello')\n" + module.read_text())
    for command in ("solve", "simulate"):
        done = run(command, path, "--json", "--quiet", "--torus", "1x2")
        assert json.loads(done.stdout)["status"] == "solved"
    (tmp_path / "result.json").write_text(done.stdout)
    assert run("check", path, tmp_path / "result.json").stdout == "accepted: fitness 0\n"


def test_files_named_as_our_packages_do_not_get_in_the_way(own_problem, tmp_path):
    path = own_problem()
    for name in ("topologies", "genetics", "problems", "wire", "node", "spy", "coordinator"):
        (tmp_path / f"{name}.py").write_text("raise RuntimeError('shadowed')\n")
    supernode_command = Path(sys.executable).with_name("supernode")
    done = subprocess.run(
        [supernode_command, "solve", str(path), "--torus", "1x2", "--quiet"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_a_temporary_folder_with_a_long_path_does_not_get_in_the_way(own_problem, tmp_path):
    long = tmp_path / ("long" * 25)
    long.mkdir()
    done = run("solve", own_problem(), "--torus", "1x2", "--quiet", env=os.environ | {"TMPDIR": str(long)})
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("command", ["solve", "simulate"])
def test_a_log_on_a_full_disk_costs_the_log_and_not_the_answer(own_problem, command):
    done = run(command, own_problem(), "--torus", "1x2", "--quiet", "--log", "/dev/full")
    assert done.returncode == 0
    assert done.stdout.startswith("solved")
    assert "warning: /dev/full: the run log ends here: No space left on device" in done.stderr
    assert "Traceback" not in done.stderr


def test_ctrl_c_while_a_problem_is_being_prepared(own_problem, tmp_path):
    path = own_problem()
    module = tmp_path / "own_module.py"
    reached = tmp_path / "reached"
    os.mkfifo(reached)
    # The spy's import tells when it is reached, and then takes far longer than anyone wants to wait.
    module.write_text(f"open({str(reached)!r}, 'w').close()\nimport time; time.sleep(60)\n" + module.read_text())
    process = subprocess.Popen(
        [sys.executable, "-m", "supernode", "solve", str(path), "--torus", "1x2", "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    reached.read_text()
    began = time.monotonic()
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=20)
    assert time.monotonic() - began < 5
    assert (process.returncode, json.loads(out)["status"]) == (130, "cancelled")


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("torus 4x4", "torus 4x4: 16 cells, degree 4, diameter 4"),
        ("grid 2x3", "grid 2x3: 6 cells, degree 2 to 3, diameter 3"),
        ("small-world 20 4 0.2", "small-world 20 4 0.2 seed 1: 20 cells, degree 2 to 5, diameter 5"),
    ],
)
def test_a_topology_is_told_and_drawn(capsys, tmp_path, spec, words):
    picture = tmp_path / "topology.svg"
    assert in_process(capsys, "topology", spec, "--plot", picture) == (0, words + "\n", "")
    assert picture.stat().st_size > 2000
    code, out, _ = in_process(capsys, "topology", spec, "--json")
    told = json.loads(out)
    assert (code, f"{told['topology']}: {told['cells']} cells") == (0, words.partition(",")[0])
    assert len(told["neighbours"]) == told["cells"]


def test_what_is_no_topology_is_one_error_line(capsys):
    code, out, err = in_process(capsys, "topology", "donut 4")
    assert (code, out) == (2, "")
    assert err.startswith("error: SPEC: expected a topology such as")
    assert len(err.splitlines()) == 1


def line_of(generation, fitness):
    return json.dumps(
        {"event": "improvement", "epoch": 0, "generation": generation, "cell": [0, 1], "fitness": fitness}
    )


def test_logs_that_differ_are_told_apart(capsys, tmp_path):
    start = '{"time": 1.5, "event": "start"}'
    one, two, three = (tmp_path / f"{name}.jsonl" for name in ("one", "two", "three"))
    one.write_text("\n".join([start, line_of(0, 3.0), line_of(4, 2.0)]) + "\n")
    two.write_text("\n".join([start.replace("1.5", "2.5"), line_of(0, 3.0), line_of(4, 2.0)]) + "\n")
    three.write_text("\n".join([start, line_of(0, 3.0)]) + "\n")
    code, out, err = in_process(capsys, "logs", "--improvements", one, two)
    assert (code, out, err) == (0, f"{line_of(0, 3.0)}\n{line_of(4, 2.0)}\n", "")
    code, out, err = in_process(capsys, "logs", "--improvements", one, two, three)
    assert (code, out) == (3, "")
    assert f"{three} differs from {one} in improvement 2" in err
    assert f"{three}: no more" in err
    for text in ("no JSON\n", "[1]\n", "[" * 100_000):
        three.write_text(text)
        code, _, err = in_process(capsys, "logs", "--improvements", three)
        assert code == 2
        assert err.startswith(f"error: {three}: expected")
        assert err.count("\n") == 1
    assert in_process(capsys, "logs", "--improvements", tmp_path / "none.jsonl")[0] == 2

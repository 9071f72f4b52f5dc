"""Problem files: what is refused, in one line that says where, what was expected and what was found."""

import dataclasses
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from problems import BadInput, ProblemFile, Run, load
from problems.errors import did_you_mean, shorten
from problems.file import parse
from topologies.parse import EXAMPLES

FUNCTION = 'kind = "function"\nname = "rastrigin"\ndimension = 2\n'
ARM = """\
kind = "arm-ik"
target = [1.2, 0.9]
[arm]
links = [1.0, 0.8]
"""
MODULE = """
from typing import Literal

import numpy as np
from pydantic import field_validator

import supernode
from problems.plane import Obstacle
from problems.tables import Table


class Inner(Table):
    size: float
    colour: str = "red"


class Puzzle(supernode.Problem):
    number: float = 1.0
    count: int = 2
    name: str = "short"
    switch: bool = False
    choice: Literal["left", "right"] = "left"
    either: float | Literal["auto"] = "auto"
    values: list[float] = []
    pair: tuple[float, float] = (0.0, 0.0)
    inner: Inner | None = None
    obstacles: list[Obstacle] = []

    @field_validator("name")
    @classmethod
    def _short(cls, name):
        if len(name) > 5:
            raise ValueError("expected a name of at most\\n5 letters")
        return name

    @property
    def coding(self):
        return supernode.BitString(self.count, 8)

    def evaluate(self, genomes):
        return genomes.sum(axis=1).astype(float)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("puzzles")
    (path / "puzzle_module.py").write_text(MODULE)
    return path


@pytest.fixture
def refused(folder, monkeypatch):
    """The one line with which a problem of kind ``Puzzle`` with more fields is refused."""
    monkeypatch.syspath_prepend(folder)

    def complaint(*lines):
        path = folder / "puzzle.toml"
        path.write_text("\n".join(['kind = "puzzle_module:Puzzle"', *lines]), encoding="utf-8")
        with pytest.raises(BadInput) as caught:
            load(path).problem()
        return line_of(caught, path)

    return complaint


def line_of(caught, path):
    """What is said of a file, once it is one line that begins with its name."""
    message = str(caught.value)
    assert message.splitlines() == [message]
    assert message.startswith(f"{path}: ")
    return message.removeprefix(f"{path}: ")


def refused_file(path):
    with pytest.raises(BadInput) as caught:
        load(path)
    return line_of(caught, path)


# The file itself ------------------------------------------------------------------------------------------------------
def test_a_missing_file(tmp_path):
    assert refused_file(tmp_path / "none.toml") == "expected a problem file, found no such file"


def test_a_folder(tmp_path):
    assert refused_file(tmp_path) == "expected a readable problem file, found Is a directory"


def test_a_file_beneath_a_file(tmp_path):
    (tmp_path / "file").touch()
    assert refused_file(tmp_path / "file" / "x.toml") == "expected a readable problem file, found Not a directory"


def test_a_file_that_is_not_utf_8(tmp_path):
    path = tmp_path / "latin.toml"
    path.write_bytes('kind = "é"'.encode("latin-1"))
    assert refused_file(path).startswith("expected TOML in UTF-8, found ")


@pytest.mark.parametrize(
    "text",
    [
        "kind =",
        "kind = 'arm-ik'\nkind = 'arm-ik'",
        "{}",
        '{"kind": "arm-ik"}',
        "kind = 'x' 'y'",
        "\x00",
        "n = " + "9" * 5000,  # more digits than Python takes
        "n = " + "[" * 5000,
        ".".join("a" * 5000) + " = 1",
        "[" * 5000,
    ],
    ids=lambda text: repr(text[:20]),
)
def test_a_file_that_is_not_toml(tmp_path, text):
    path = tmp_path / "bad.toml"
    path.write_text(text)
    assert refused_file(path).startswith("expected TOML, found ")


def test_a_line_number_where_the_toml_breaks(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text('kind = "arm-ik"\ntarget = [1, 2\n\n')
    assert "line 4" in refused_file(path) or "end of document" in refused_file(path)


def test_a_file_whose_name_has_a_line_break_is_still_refused_in_one_line(tmp_path):
    with pytest.raises(BadInput) as caught:
        load(tmp_path / "two\nlines.toml")
    assert str(caught.value) == f"{tmp_path}/two lines.toml: expected a problem file, found no such file"


# The kind -------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("", "nothing"),
        ("kind = 3", "3"),
        ("kind = ['arm-ik']", '["arm-ik"]'),
        ("kind = true", "true"),
        ("[kind]", "{}"),
    ],
)
def test_no_kind(tmp_path, text, found):
    path = tmp_path / "kind.toml"
    path.write_text(text)
    assert refused_file(path) == f'kind: expected a kind of problem such as "arm-ik", found {found}'


@pytest.mark.parametrize(
    ("kind", "suggestion"),
    [
        ("arm_ik", "; did you mean 'arm-ik'?"),
        ("arm-paths", "; did you mean 'arm-path'?"),
        ("mobile robot", "; did you mean 'mobile-robot'?"),
        ("Mobile-Robot", "; did you mean 'mobile-robot'?"),
        ("functoin", "; did you mean 'function'?"),
        ("zzz", ""),
        ("", ""),
    ],
)
def test_an_unknown_kind_with_a_suggestion(tmp_path, kind, suggestion):
    path = tmp_path / "kind.toml"
    path.write_text(f'kind = "{kind}"')
    line = refused_file(path)
    assert re.fullmatch(
        r"""kind: expected one of arm-ik, [a-z, -]* or "module:Class", found '[^']*'(; did you mean '[a-z-]+'\?)?""",
        line,
    )
    assert line.endswith(f"found {kind!r}{suggestion}")


def test_a_wrong_field_of_a_built_in_kind_is_refused_when_it_is_loaded(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text("targett = 1\n" + ARM)
    line = refused_file(path)
    assert line.startswith("targett: unknown field, expected one of kind, unit, code, bits, ")
    assert line.endswith("; did you mean 'target'?")


def test_an_unknown_field_of_a_table_names_those_of_that_table(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(ARM + "radios = 0.1\n")
    line = refused_file(path)
    assert line == "arm.radios: unknown field, expected one of links, base, radius, limits; did you mean 'radius'?"


# Fields ---------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("lines", "complaint"),
    [
        (["nmber = 1"], "nmber: unknown field, expected one of kind, number, count, {others}; did you mean 'number'?"),
        (["zzzzzz = 1"], "zzzzzz: unknown field, expected one of kind, number, count, {others}"),
        (["'two words' = 1"], "two words: unknown field, expected one of kind, number, count, {others}"),
        (['number = "1"'], 'number: expected a valid number, found "1"'),
        (["number = true"], "number: expected a valid number, found true"),
        (["number = nan"], "number: expected a finite number, found NaN"),
        (["number = inf"], "number: expected a finite number, found Infinity"),
        (["number = -inf"], "number: expected a finite number, found -Infinity"),
        (["number = 1e999"], "number: expected a finite number, found Infinity"),
        (["number = 1" + "0" * 400], "number: expected a finite number, found 1" + "0" * 78 + "…"),
        (["number = [1.0]"], "number: expected a valid number, found [1.0]"),
        (["number = 1979-05-27"], 'number: expected a valid number, found "1979-05-27"'),
        (["count = true"], "count: expected a valid integer, found true"),
        (["count = 2.0"], "count: expected a valid integer, found 2.0"),
        (["count = 2.5"], "count: expected a valid integer, found 2.5"),
        (['count = "2"'], 'count: expected a valid integer, found "2"'),
        (["name = 3"], "name: expected a valid string, found 3"),
        (['name = "too long"'], 'name: expected a name of at most 5 letters, found "too long"'),
        (["switch = 1"], "switch: expected a valid boolean, found 1"),
        (['switch = "true"'], 'switch: expected a valid boolean, found "true"'),
        (['choice = "up"'], "choice: expected 'left' or 'right', found \"up\""),
        (["choice = 1"], "choice: expected 'left' or 'right', found 1"),
        (['either = "manual"'], "either: expected a valid number or 'auto', found \"manual\""),
        (["values = 1.0"], "values: expected a valid array, found 1.0"),
        (["values = [1.0, '2']"], 'values[1]: expected a valid number, found "2"'),
        (["values = [1.0, nan]"], "values[1]: expected a finite number, found NaN"),
        (["values = ['a', 'b', 'c']"], 'values[0]: expected a valid number, found "a" (and 2 more)'),
        (["pair = [1.0]"], "pair: expected 2 values, found 1: [1.0]"),
        (["pair = [1.0, 2.0, 3.0]"], "pair: expected at most 2 items, found [1.0, 2.0, 3.0]"),
        (["inner = 1"], "inner: expected an object, found 1"),
        (["inner = {}"], "inner.size: expected this field, found nothing"),
        (["inner = {size = 'x'}"], 'inner.size: expected a valid number, found "x"'),
        (
            ["inner = {size = 1, color = 'x'}"],
            "inner.color: unknown field, expected one of size, colour; did you mean 'colour'?",
        ),
        (["number = 'a'", "count = 'b'"], 'number: expected a valid number, found "a" (and 1 more)'),
        (["obstacles = 1"], "obstacles: expected a valid array, found 1"),
        (["obstacles = [1]"], "obstacles[0]: expected an object, found 1"),
        (["obstacles = [{}]"], "obstacles[0].shape: expected this field, found nothing"),
        (
            ["obstacles = [{shape = 'blob'}]"],
            "obstacles[0].shape: expected one of 'circle', 'polygon', 'box', found \"blob\"",
        ),
        (
            ["obstacles = [{shape = 'circle', center = [0, 0], radios = 1}]"],
            "obstacles[0].circle.radios: unknown field, expected one of shape, center, radius; "
            "did you mean 'radius'? (and 1 more)",
        ),
        (
            ["obstacles = [{shape = 'circle', center = [0, 0], radius = 1, radios = 1}]"],
            "obstacles[0].circle.radios: unknown field, expected one of shape, center, radius; did you mean 'radius'?",
        ),
    ],
    ids=lambda value: value[0][:40] if isinstance(value, list) else "",
)
def test_a_wrong_field(refused, lines, complaint):
    others = "name, switch, choice, either, values, pair, inner, obstacles"
    assert refused(*lines) == complaint.replace("{others}", others)


def test_too_few_values_are_counted(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(ARM.replace("[1.2, 0.9]", "[1.2]"))
    with pytest.raises(BadInput, match=re.escape(f"{path}: target: expected 2 values, found 1: [1.2]")):
        load(path)


def test_a_missing_field_is_named(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text('kind = "arm-ik"\n[arm]\nlinks = [1.0]\n')
    assert refused_file(path) == "target: expected this field, found nothing"


# [run] ----------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("run = 3\n" + ARM, "3"),
        ("run = []\n" + ARM, "[]"),
        ("run = 'seed'\n" + ARM, '"seed"'),
        (ARM + "[[run]]\nseed = 1", '[{"seed": 1}]'),
    ],
)
def test_a_run_that_is_no_table(tmp_path, text, found):
    path = tmp_path / "run.toml"
    path.write_text(text)
    assert refused_file(path) == f"run: expected a table [run], found {found}"


@pytest.mark.parametrize(
    ("lines", "complaint"),
    [
        (['topology = "torus 0x4"'], "topology: expected at least 1 row and 1 column, found 0 x 4"),
        (['topology = "torus 4x-1"'], "topology: expected a topology such as {topologies}, found 'torus 4x-1'"),
        (['topology = "torus 9999x9999"'], "topology: expected at most 1048576 cells, found 99980001"),
        (["topology = 4"], "topology: expected a valid string, found 4"),
        (["deme = 0"], "deme: expected greater than or equal to 1, found 0"),
        (["deme = -1"], "deme: expected greater than or equal to 1, found -1"),
        (["deme = 65537"], "deme: expected less than or equal to 65536, found 65537"),
        (["deme = true"], "deme: expected a valid integer, found true"),
        (["deme = 1" + "0" * 100], "deme: expected less than or equal to 65536, found 1" + "0" * 78 + "…"),
        (["interval = 0"], "interval: expected greater than or equal to 1, found 0"),
        (["emigrants = 0"], "emigrants: expected greater than or equal to 1, found 0"),
        (["emigrants = 2"], "emigrants: expected at most the deme, 1, found 2"),
        (["deme = 4", "emigrants = 5"], "emigrants: expected at most the deme, 4, found 5"),
        (['mode = "sync"'], "mode: expected 'lockstep' or 'async', found \"sync\""),
        (['recipe = "best"'], "recipe: expected 'tuned' or 'paper', found \"best\""),
        (['replacement = "best"'], "replacement: expected 'offspring' or 'elitist', found \"best\""),
        (["mutation = 1.5"], "mutation: expected less than or equal to 1 or 'one-bit', found 1.5"),
        (["mutation = -0.1"], "mutation: expected greater than or equal to 0 or 'one-bit', found -0.1"),
        (['mutation = "two-bit"'], "mutation: expected a valid number or 'one-bit', found \"two-bit\""),
        (["mutation = nan"], "mutation: expected a finite number or 'one-bit', found NaN"),
        (["mutation = true"], "mutation: expected a valid number or 'one-bit', found true"),
        (['spy = "all"'], "spy: expected 'champion' or 'root', found \"all\""),
        (["seed = -1"], "seed: expected greater than or equal to 0, found -1"),
        (["seed = 18446744073709551616"], "seed: expected less than 18446744073709551616, found 18446744073709551616"),
        (["seed = 1.0"], "seed: expected a valid integer, found 1.0"),
        (["seed = nan"], "seed: expected a valid integer, found NaN"),
        (["generations = -1"], "generations: expected greater than or equal to 0, found -1"),
        (["generations = 2147483648"], "generations: expected less than 2147483648, found 2147483648"),
        (["evaluations = -1"], "evaluations: expected greater than or equal to 0, found -1"),
        (["seconds = 0"], "seconds: expected greater than 0, found 0"),
        (["seconds = inf"], "seconds: expected a finite number, found Infinity"),
        (["target = nan"], "target: expected a finite number, found NaN"),
        (['target = "0"'], 'target: expected a valid number, found "0"'),
        (["stall = 0"], "stall: expected greater than or equal to 1, found 0"),
        (["sed = 1"], "sed: unknown field, expected one of {fields}; did you mean 'seed'?"),
        (['tours = "4x4"'], "tours: unknown field, expected one of {fields}; did you mean 'torus'?"),
        (["threads = 1"], "threads: unknown field, expected one of {fields}"),
        (["'a.b' = 1"], "a.b: unknown field, expected one of {fields}"),
        (["seed = -1", "deme = 0"], "deme: expected greater than or equal to 1, found 0 (and 1 more)"),
    ],
    ids=lambda value: value[0][:40] if isinstance(value, list) else "",
)
def test_a_wrong_setting_of_the_run(tmp_path, lines, complaint):
    path = tmp_path / "run.toml"
    path.write_text("\n".join([ARM, "[run]", *lines]))
    topologies = ", ".join(f'"{example}"' for example in EXAMPLES)
    fields = ", ".join([*Run.model_fields, *Run.shorthands])
    expected = complaint.replace("{fields}", fields).replace("{topologies}", topologies)
    assert refused_file(path) == f"run: {expected}"


@given(st.text(max_size=200))
@example("[run]\nseed = 1")
@example("kind = 'arm-ik'")
@example("kind = 'arm-ik'\n[run]\n[run.x]")
@example("kind = ':'")
def test_no_text_is_refused_in_any_other_way(text):
    try:
        file = parse(text, "x.toml", folder=None)
    except BadInput as error:
        (line,) = str(error).splitlines()
        assert line.startswith("x.toml: ")
    else:
        assert isinstance(file.kind, str)


# What is right --------------------------------------------------------------------------------------------------------
def test_a_right_file(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(ARM + "[run]\ntopology = 'torus  2 x 3'\nseed = 7\nmutation = 'one-bit'\n")
    file = load(path)
    assert file.kind == "arm-ik"
    assert file.name == str(path)
    assert file.folder == tmp_path.resolve()
    assert file.run == Run(topology="torus 2x3", seed=7, mutation="one-bit")
    assert file.fields == {"kind": "arm-ik", "target": [1.2, 0.9], "arm": {"links": [1.0, 0.8]}}
    assert file.problem().coding.length == 16


def test_loading_a_file_loads_no_compiled_code(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(ARM)
    code = f"import sys, problems; problems.load({str(path)!r}); print('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True).stdout == "False\n"


def test_integers_are_taken_for_numbers_and_comments_for_nothing(folder, monkeypatch):
    monkeypatch.syspath_prepend(folder)
    file = parse('# A comment\nkind = "puzzle_module:Puzzle"\nnumber = 3 # three\npair = [1, 2]', "x.toml", folder)
    problem = file.problem()
    assert (problem.number, problem.pair) == (3.0, (1.0, 2.0))


def test_the_sum_is_that_of_the_problem_not_of_how_it_is_written_or_run():
    def digest(text):
        return parse(text, "any.toml", folder=None).sha256

    assert re.fullmatch("[0-9a-f]{64}", digest(ARM))
    head, _, arm = ARM.partition("[arm]")
    lines = head.strip().splitlines()
    assert digest("\n".join([*reversed(lines), "[arm]" + arm])) == digest(ARM)
    assert digest("# hello\n" + ARM + "\n[run]\nseed = 5\ntopology = 'torus 2x2'") == digest(ARM)
    assert digest(ARM + "radius = 0.0") != digest(ARM)
    assert digest(ARM.replace("1.2", "1.3")) != digest(ARM)


def test_a_file_is_the_same_after_a_journey_as_json(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(ARM + "[run]\nseed = 18446744073709551615\ntarget = -1.5\nmutation = 'one-bit'\n")
    file = load(path)
    assert ProblemFile.from_json(file.to_json()) == file
    assert ProblemFile.from_json(file.to_json()).run.model_fields_set == {"seed", "target", "mutation"}
    assert ProblemFile.from_json(file.to_json()).sha256 == file.sha256


@pytest.mark.parametrize(
    "text",
    [
        "",
        "null",
        "3",
        "[]",
        "{}",
        '{"a": 1, "b": 2, "c": 3, "d": 4}',
        '["x.toml", {"kind": "arm-ik"}, {}]',
        '["x.toml", {"kind": "arm-ik"}, {}, "/", 1]',
        '["x.toml", {"kind": "arm-ik"}, {}, "/", -1, {}]',
        '["x.toml", {"kind": "arm-ik"}, {}, "/", true, {}]',
        '["x.toml", {"kind": "arm-ik"}, {}, "/", 1, []]',
        '["x.toml", {"kind": "arm-ik"}, {}, "/", 1, {}, 2]',
        '[3, {"kind": "arm-ik"}, {}, "/"]',
        '["x.toml", [], {}, "/"]',
        '["x.toml", {}, {}, "/"]',
        '["x.toml", {"kind": 3}, {}, "/"]',
        '["x.toml", {"kind": "arm-ik"}, [], "/"]',
        '["x.toml", {"kind": "arm-ik"}, {}, 3]',
        "[" * 100_000,
        "1" * 5000,
    ],
    ids=lambda text: text[:40],
)
def test_json_that_is_no_problem_file(text):
    with pytest.raises(BadInput, match=r"^expected a problem file as JSON, found "):
        ProblemFile.from_json(text)


def test_json_with_a_wrong_setting_says_which():
    with pytest.raises(BadInput, match=r"^x.toml: run: seed: expected greater than or equal to 0, found -1$"):
        ProblemFile.from_json('["x.toml", {"kind": "arm-ik"}, {"seed": -1}, "/"]')


# with_run -------------------------------------------------------------------------------------------------------------
def test_settings_given_later_win_and_none_is_not_given():
    file = parse(ARM + "[run]\nseed = 7\ndeme = 4\n", "arm.toml", folder=None)
    changed = file.with_run(seed=9, deme=None, stall=3, mode=None)
    assert (changed.run.seed, changed.run.deme, changed.run.stall) == (9, 4, 3)
    assert changed.run.model_fields_set == {"seed", "deme", "stall"}
    assert dataclasses.replace(changed, run=file.run) == file
    assert file.run.seed == 7


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"seed": -1}, "options: seed: expected greater than or equal to 0, found -1"),
        ({"emigrants": 5}, "arm.toml: run: emigrants: expected at most the deme, 4, found 5"),
        ({"deme": "4"}, 'options: deme: expected a valid integer, found "4"'),
        ({"seconds": float("nan")}, "options: seconds: expected a finite number, found NaN"),
        ({"topology": object}, "options: topology: expected a topology such as"),
    ],
)
def test_wrong_settings_given_later_are_refused(settings, complaint):
    file = parse(ARM + "[run]\ndeme = 4\n", "arm.toml", folder=None)
    with pytest.raises(BadInput, match=re.escape(complaint)):
        file.with_run(**settings)


@pytest.mark.parametrize("lines", ['torus = "3x5"', "torus = [3, 5]"])
def test_a_torus_in_the_file_is_a_topology(lines):
    file = parse(ARM + f"[run]\n{lines}\n", "arm.toml", folder=None)
    assert (file.run.topology, file.run.model_fields_set) == ("torus 3x5", {"topology"})
    assert ProblemFile.from_json(json.dumps(["arm.toml", file.fields, {"torus": "3x5"}, ""])).run == file.run


@pytest.mark.parametrize("torus", ["2x3", (2, 3), [2, 3]])
def test_a_torus_given_later_wins_over_the_files_topology(torus):
    file = parse(ARM + '[run]\ntopology = "ring 16"\n', "arm.toml", folder=None)
    assert file.with_run(torus=torus).run.topology == "torus 2x3"
    assert file.with_run(torus=None).run.topology == "ring 16"


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"torus": "4y4"}, "torus: expected rows and columns such as \"4x4\", found '4y4'"),
        ({"torus": [4]}, 'torus: expected rows and columns such as "4x4", found [4]'),
        ({"torus": [True, 4]}, 'torus: expected rows and columns such as "4x4", found [True, 4]'),
        ({"torus": "0x4"}, "torus: expected at least 1 row and 1 column, found 0 x 4"),
        ({"torus": "4x4", "topology": "ring 4"}, "torus: expected either a torus or a topology, found both ('ring 4')"),
    ],
)
def test_a_wrong_torus_is_refused_wherever_it_stands(settings, complaint):
    file = parse(ARM, "arm.toml", folder=None)
    with pytest.raises(BadInput, match=re.escape(f"options: {complaint}")):
        file.with_run(**settings)
    with pytest.raises(BadInput, match=re.escape(f"arm.toml: run: {complaint}")):
        ProblemFile.from_json(json.dumps(["arm.toml", file.fields, settings, ""]))


@pytest.mark.parametrize(
    "wrong",
    [
        lambda folder: load(folder / "none.toml"),
        lambda folder: parse("kind = ", "x.toml", folder),
        lambda folder: parse(ARM + "[run]\nsed = 1\n", "x.toml", folder),
        lambda folder: parse(ARM, "x.toml", folder).with_run(seed=-1),
        lambda folder: parse(ARM, "x.toml", folder).with_run(torus="4"),
        lambda folder: parse(ARM + "length = 1\n", "x.toml", folder).problem(),
        lambda folder: parse('kind = "arm"\n', "x.toml", folder).problem(),
    ],
)
def test_a_mistake_is_one_error_not_a_chain_of_them(tmp_path, wrong):
    with pytest.raises(BadInput) as caught:
        wrong(tmp_path)
    assert caught.value.__cause__ is None
    assert caught.value.__suppress_context__, "a traceback shows this one alone"


def test_what_a_users_module_raised_is_shown_too(tmp_path):
    (tmp_path / "broken.py").write_text("import nothing_of_that_name\n")
    with pytest.raises(BadInput) as caught:
        parse('kind = "broken:Broken"\n', "x.toml", tmp_path).problem()
    assert isinstance(caught.value.__cause__, ModuleNotFoundError)


def test_a_setting_may_be_zero():
    file = parse(ARM, "arm.toml", folder=None)
    assert file.with_run(generations=0, seed=0).run == Run(generations=0, seed=0)


# next_attempt ---------------------------------------------------------------------------------------------------------
def test_an_attempt_changes_fields_but_not_the_problem():
    file = parse(FUNCTION, "f.toml", folder=Path())
    second = file.next_attempt({"dimension": 3}).next_attempt({"name": "sphere"})
    assert (second.attempt, second.attempt_fields) == (2, {"dimension": 3, "name": "sphere"})
    assert (second.fields, second.sha256) == (file.fields, file.sha256)
    assert (second.problem().dimension, second.problem().name) == (3, "sphere")
    assert file.problem().dimension == 2
    assert ProblemFile.from_json(second.to_json()) == second
    assert len(json.loads(file.to_json())) == 4, "as clients of other languages write it"
    again = second.next_attempt({"dimension": 2})
    assert (again.attempt, again.attempt_fields) == (3, {"name": "sphere"}), "as in the file again"


def test_an_update_keeps_the_coding_of_the_attempt_and_counts_anew():
    tried = parse(FUNCTION, "f.toml", folder=Path()).next_attempt({"dimension": 3})
    updated = tried.changed({"name": "sphere"}, {})
    assert (updated.attempt, updated.attempt_fields, updated.problem().dimension) == (0, {"dimension": 3}, 3)
    assert updated.sha256 != tried.sha256
    rewired = tried.changed({}, {"topology": "ring 16"})
    assert (rewired.attempt, rewired.attempt_fields) == (1, {"dimension": 3})
    assert tried.changed({"dimension": 3}, {}).attempt_fields == {}
    with pytest.raises(BadInput, match="the update would change how individuals are coded"):
        tried.changed({"dimension": 2}, {})


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"kind": "terrain"}, "f.toml: next_attempt: expected fields of the problem, found kind"),
        ({"run": {}}, "f.toml: next_attempt: expected fields of the problem, found run"),
        ({"dimension": "many"}, "f.toml: dimension: "),
        ({"dimensions": 3}, "f.toml: dimensions: unknown field"),
    ],
)
def test_an_attempt_that_cannot_be_is_refused(fields, said):
    with pytest.raises(BadInput, match=said):
        parse(FUNCTION, "f.toml", folder=Path()).next_attempt(fields)


def test_a_result_tells_what_its_attempts_have_changed():
    file = parse(FUNCTION, "f.toml", folder=Path())
    directives = [{"do": "retry", "fields": {"dimension": 3}}, {"do": "stop"}, {"do": "retry", "fields": {}}]
    assert file.tried(directives) == file.next_attempt({"dimension": 3}).next_attempt({})


# Words ----------------------------------------------------------------------------------------------------------------
def test_bad_input_is_one_line_whatever_is_put_into_it():
    assert str(BadInput("one\n  two\r\nthree\x0bfour\u2028five")) == "one two three four five"
    assert str(BadInput("")) == ""


def test_long_values_are_shortened():
    assert shorten([1, 2]) == "[1, 2]"
    assert shorten("x" * 100) == '"' + "x" * 78 + "…"
    assert len(shorten(list(range(1000)))) == 80
    assert json.loads(shorten({"a": None})) == {"a": None}


def test_suggestions_are_made_only_of_what_is_close():
    assert did_you_mean("sed", ["seed", "deme"]) == "; did you mean 'seed'?"
    assert did_you_mean("zebra", ["seed", "deme"]) == ""
    assert did_you_mean("x", []) == ""


@pytest.mark.parametrize("depth", [70, 900, 100_000])
def test_values_nested_too_deeply_are_refused_where_they_are_read(tmp_path, depth):
    with pytest.raises(BadInput, match="expected a problem file as JSON"):
        ProblemFile.from_json(f'["x", {{"kind": "function", "a": {"[" * depth + "]" * depth}}}, {{}}, "/"]')
    with pytest.raises(BadInput, match="expected TOML, found"):
        parse(f'kind = "function"\na = {"[" * depth + "]" * depth}', "x", tmp_path)

"""Angles in problem files: degrees if the file says so, radians ever after, and nothing that can only be degrees."""

import contextlib
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import supernode
from problems import BadInput, ProblemFile, registry
from problems.file import filled_in, parse

ARM = 'kind = "arm-ik"\ntarget = [1.2, 0.9]\n'
LINKS = "[arm]\nlinks = [1.0, 0.8]\n"
ROBOT = 'kind = "mobile-robot"\nbounds = [0, 0, 5, 5]\n'
CART = 'kind = "sphere-path"\nbounds = [[0, 5], [0, 5], [{0}, {1}]]\nstart = [1, 1, 0]\n'
TRIANGLE = "[vehicle]\nvertices = [[0, 0], [0.1, 0], [0, 0.1]]\n"
RODS = "[arm]\nmasses = [1, 1]\nlengths = [1, 1]\ntorque = [64, 64]\n"
ELBOW = "path = [[0, {0}, -50, 20, 0], [80, {0}, -50, 20, 0]]\n"
BOX = '[[obstacles]]\nshape = "box"\ncenter = [9, 9]\nsize = [1, 1]\nangle = {0}\n'

# Each as a file in degrees: where an angle stands in the fields that are read, and how many degrees are written there.
IN_DEGREES = {
    "limits of an arm": (ARM + LINKS + "limits = [[-160, 160], [-90, 100]]", ("arm", "limits", 1, 0), -90),
    "an obstacle": (ARM + LINKS + BOX.format(-400.0), ("obstacles", 0, "angle"), -400),
    "start of an arm": (
        'kind = "arm-path"\nstart = [20, 30]\ngoal = [-20, 100]\n' + LINKS,
        ("start", 1),
        30,
    ),
    "goal of an arm": ('kind = "min-time"\nstart = [0, 0]\ngoal = [28, -60]\n' + RODS, ("goal", 1), -60),
    "a heading": (ROBOT + "start = [1, 1, 0]\ngoal = [3, 3, 90]\n[robot]\nradius = 0.1", ("goal", 2), 90),
    "heading of a vehicle": (CART.format(-180, 180) + "goal = [3, 3, 90]\n" + TRIANGLE, ("goal", 2), 90),
    "bounds of a heading": (CART.format(-180, 180) + "goal = [3, 3, 90]\n" + TRIANGLE, ("bounds", 2, 1), 180),
    "path of a robot": (
        'kind = "coordination"\n[[robots]]\n'
        + ELBOW.format(28)
        + "[[robots]]\nbase = [5, 0, 0, 180]\nalpha = [90, 0, 0, 90, 0]\n"
        + ELBOW.format(30),
        ("robots", 1, "path", 0, 1),
        30,
    ),
    "base of a robot": (
        'kind = "coordination"\n[[robots]]\n' + ELBOW.format(28) + "[[robots]]\nbase = [5, 0, 0, 180]\n"
        "alpha = [90, 0, 0, 90, 0]\n" + ELBOW.format(30),
        ("robots", 1, "base", 3),
        180,
    ),
}


@pytest.fixture(params=IN_DEGREES)
def example(request):
    return IN_DEGREES[request.param]


def at(fields, place):
    for part in place:
        fields = fields[part]
    return fields


def read(text, name="x.toml"):
    return parse(text, name, Path())


def refused(text):
    with pytest.raises(BadInput) as caught:
        read(text).problem()
    assert len(str(caught.value).splitlines()) == 1
    return str(caught.value)


def test_degrees_become_radians_where_the_file_is_read(example):
    text, place, degrees = example
    file = read('unit = "deg"\n' + text)
    assert at(file.fields, place) == pytest.approx(math.radians(degrees), rel=1e-15)
    problem = file.problem()
    assert (problem.unit, problem.written_in) == ("rad", "deg")


def test_lengths_stay_as_they_are():
    file = read('unit = "deg"\n' + ROBOT + "start = [1, 1.5, 0]\ngoal = [3, 3, 90]\n[robot]\nradius = 0.1")
    assert file.fields["start"][:2] == [1, 1.5]
    assert file.fields["bounds"] == [0, 0, 5, 5]
    assert file.fields["robot"] == {"radius": 0.1}


def test_the_same_problem_in_both_units_is_run_alike():
    degrees = read('unit = "deg"\n' + ARM + LINKS + "limits = [[-160, 160], [-90, 100]]").problem()
    limits = f"limits = [[{-math.radians(160)}, {math.radians(160)}], [{-math.radians(90)}, {math.radians(100)}]]"
    radians = read(ARM + LINKS + limits).problem()
    codes = np.array([[0, 255], [77, 130]])
    np.testing.assert_array_equal(degrees.configurations(codes), radians.configurations(codes))


def test_angles_that_can_only_be_degrees_are_refused_with_a_hint(example):
    text, _, _ = example
    message = refused(text)
    angle = re.search(r"expected an angle from -4π to 4π rad, found (-?[\d.]+); did you mean degrees\? ", message)
    assert f"{angle[1]}° is {math.radians(float(angle[1])):.4g} rad; " in message
    assert 'say unit = "deg" in the file' in message


def test_the_case_of_the_limits_in_degrees():
    message = refused(ARM + LINKS + "limits = [[-160, 160], [-160, 160]]")
    hint = 'did you mean degrees? -160° is -2.793 rad; say unit = "deg" in the file (and 3 more)'
    assert message == f"x.toml: arm.limits[0][0]: expected an angle from -4π to 4π rad, found -160; {hint}"


def test_two_turns_are_an_angle_and_more_are_none():
    two = 4 * math.pi
    read(ARM + LINKS + f"limits = [[{-two}, {two}], [0, 1]]").problem()
    assert "arm.limits[0][1]: " in refused(ARM + LINKS + f"limits = [[0, {two + 1e-6}], [0, 1]]")
    read('unit = "deg"\n' + ARM + LINKS + "limits = [[-720, 720], [0, 1]]").problem()


def test_more_than_two_turns_in_degrees_are_refused_without_that_hint():
    message = refused('unit = "deg"\n' + ARM + LINKS + "limits = [[-160, 160], [0, 721]]")
    assert message == "x.toml: arm.limits[1][1]: expected an angle from -720 to 720, in degrees, found 721"


def test_a_wrong_unit_and_a_unit_where_there_are_no_angles_are_refused():
    assert "x.toml: unit: expected 'rad' or 'deg', found \"degrees\"" in refused('unit = "degrees"\n' + ARM + LINKS)
    assert "x.toml: unit: unknown field" in refused('unit = "deg"\nkind = "function"\nname = "sphere"')
    spheres = (
        'unit = "deg"\nkind = "sphere-path"\nstart = [0, 0]\ngoal = [1, 1]\nbounds = [[0, 9], [0, 9]]\nspheres = []'
    )
    assert refused(spheres).startswith('x.toml: unit: expected "rad": only the axes of a vehicle may be angles')


def test_values_that_are_no_angles_are_left_to_the_schema():
    assert "arm.limits[0][0]: expected a valid number, found" in refused(
        'unit = "deg"\n' + ARM + LINKS + 'limits = [["a", true], [0, 1]]'
    )
    assert "arm: " in refused('unit = "deg"\n' + ARM + "arm = 3")


@given(st.dictionaries(st.sampled_from(["arm", "obstacles", "target", "bits", "x"]), st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3)
    | st.dictionaries(st.sampled_from(["limits", "angle", "shape", "links"]), inner, max_size=3),
    max_leaves=12,
)))  # fmt: skip
def test_nonsense_in_degrees_is_refused_as_any_other_or_left_to_the_schema(fields):
    with contextlib.suppress(BadInput):
        registry.find("arm-ik").read_angles(fields | {"unit": "deg"})


# Updates --------------------------------------------------------------------------------------------------------------
def changed(file, patch, tmp_path):
    return file.changed(filled_in(patch, file, tmp_path / "patch.toml"), {})


def test_a_patch_has_the_unit_of_the_problem_file(tmp_path):
    file = read('unit = "deg"\n' + CART.format(-180, 180) + "goal = [3, 3, 90]\n" + TRIANGLE)
    after = changed(file, {"goal": [3, 3, 45]}, tmp_path)
    assert after.fields["goal"] == [3, 3, pytest.approx(math.pi / 4)]
    again = changed(ProblemFile.from_json(after.to_json()), {"goal": [3, 3, 30]}, tmp_path)
    assert again.fields["goal"] == [3, 3, pytest.approx(math.pi / 6)]


def test_a_patch_may_say_a_unit_of_its_own(tmp_path):
    degrees = read('unit = "deg"\n' + ROBOT + "start = [1, 1, 0]\ngoal = [3, 3, 90]\n[robot]\nradius = 0.1")
    radians = read(ROBOT + "start = [1, 1, 0]\ngoal = [3, 3, 1]\n[robot]\nradius = 0.1")
    assert changed(degrees, {"unit": "rad", "goal": [2, 2, 1.5]}, tmp_path).fields["goal"] == [2, 2, 1.5]
    turned = changed(radians, {"unit": "deg", "goal": [2, 2, 90]}, tmp_path)
    assert turned.fields["goal"] == [2, 2, pytest.approx(math.pi / 2)]
    with pytest.raises(BadInput, match="did you mean degrees"):
        changed(radians, {"goal": [2, 2, 90]}, tmp_path)


def test_what_another_file_holds_is_in_radians_whatever_the_unit(tmp_path):
    path = [[0.0, 0.5, -0.9, 0.4, 0.0], [1.4, 0.5, -0.9, 0.4, 0.0]]
    (tmp_path / "result.json").write_text(json.dumps({"path": path}))
    (tmp_path / "x.toml").write_text(
        'kind = "coordination"\nunit = "deg"\n[[robots]]\ncells = 9\nresult = "result.json"\n'
        '[[robots]]\ncells = 9\nresult = "result.json"\nbase = [5, 0, 0, 180]'
    )
    file = supernode.load(tmp_path / "x.toml")
    assert file.problem().robots[1].path == path
    robot = {"result": "result.json", "cells": 9}
    after = changed(file, {"robots": [robot, robot | {"base": [5, 0, 0, 90]}]}, tmp_path)
    assert after.fields["robots"][1]["base"] == [5, 0, 0, pytest.approx(math.pi / 2)]
    assert after.fields["robots"][0]["path"] == path

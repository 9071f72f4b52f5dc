"""Obstacles in the plane: what they are made of, and which are refused."""

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from problems import BadInput, load
from problems.plane import (
    CONTACT,
    Box,
    Circle,
    Obstacle,
    Polygon,
    Shapes,
    anticlockwise,
    draw_obstacles,
    simple_polygon,
)

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SQUARE = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)]
BOOMERANG = [(0.0, 0.0), (4.0, 0.0), (1.0, 1.0), (0.0, 4.0)]

coordinates = st.floats(-10, 10).map(lambda value: round(value, 3))
lengths = st.floats(0.1, 5)


def polygon(vertices):
    return Polygon(shape="polygon", vertices=vertices)


def circle(center=(0.0, 0.0), radius=1.0):
    return Circle(shape="circle", center=center, radius=radius)


def box(center=(0.0, 0.0), size=(1.0, 1.0), **more):
    return Box(shape="box", center=center, size=size, **more)


def complaints(make):
    with pytest.raises(ValidationError) as caught:
        make()
    return [error["msg"] for error in caught.value.errors()]


# What is refused ------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("vertices", "complaint"),
    [
        ([], "expected at least 3 vertices, found 0"),
        (SQUARE[:1], "expected at least 3 vertices, found 1"),
        (SQUARE[:2], "expected at least 3 vertices, found 2"),
        ([(0, 0), (2, 2), (2, 0), (0, 2)], "expected a simple polygon with an area, found Self-intersection"),
        ([(0, 0), (4, 0), (4, 4), (2, -1), (0, 4)], "expected a simple polygon with an area, found Self-intersection"),
        ([(0, 0), (1, 1), (2, 2)], "expected a simple polygon with an area, found "),
        ([(1, 1), (1, 1), (1, 1)], "expected a simple polygon with an area, found "),
        ([(0, 0), (1e-5, 0), (0, 1e-5)], "expected a simple polygon with an area, found Valid Geometry, area 5e-11"),
    ],
)
def test_polygons_without_an_inside_are_refused(vertices, complaint):
    (said,) = complaints(lambda: polygon(vertices))
    assert said.startswith(f"Value error, {complaint}")
    with pytest.raises(ValueError, match=complaint):
        simple_polygon(vertices)


@pytest.mark.parametrize("radius", [0, -1, 1e-300, math.nan, math.inf])
def test_circles_without_an_inside_are_refused(radius):
    (said,) = complaints(lambda: circle(radius=radius))
    assert "greater than or equal to 0.000001" in said or "finite number" in said


@pytest.mark.parametrize("size", [(0, 1), (1, 0), (-1, 1), (1e-300, 1), (1, math.inf), (1, math.nan)])
def test_boxes_without_an_inside_are_refused(size):
    (said,) = complaints(lambda: box(size=size))
    assert "greater than or equal to 0.000001" in said or "finite number" in said


BEYOND_BOUNDS = [
    ("circle", "center = [1e300, 0], radius = 1", "center[0]: expected less than or equal to 1000000, found 1e+300"),
    ("circle", "center = [0, nan], radius = 1", "center[1]: expected a finite number, found NaN"),
    ("circle", "center = [0, 0], radius = 1e300", "radius: expected less than or equal to 1000000, found 1e+300"),
    ("box", "center = [0, -1e300], size = [1, 1]", "center[1]: expected greater than or equal to -1000000, found"),
    ("box", "center = [5, 5], size = [1, 1e300]", "size[1]: expected less than or equal to 1000000, found 1e+300"),
    ("box", "center = [5, 5], size = [1e-300, 1]", "size[0]: expected greater than or equal to 0.000001, found 1e-300"),
    (
        "box",
        "center = [5, 5], size = [1, 1], angle = 1e300",
        "angle: expected an angle from -4π to 4π rad, found 1e+300; did you mean degrees?",
    ),
    ("polygon", "vertices = [[0, 0], [1, 0], [0, 1e300]]", "vertices[2][1]: expected less than or equal to 1000000"),
    ("polygon", "vertices = [[0, 0], [nan, 0], [0, 1]]", "vertices[1][0]: expected a finite number, found NaN"),
]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("shape", "fields", "complaint"), BEYOND_BOUNDS)
@pytest.mark.parametrize("example", ["arm-ik", "arm-path", "mobile-robot", "sphere-path-vehicle"])
def test_numbers_beyond_all_bounds_give_one_clear_line(shape, fields, complaint, example, tmp_path):
    head, _, _ = (EXAMPLES / f"{example}.toml").read_text().partition("[[obstacles]]")
    path = tmp_path / "problem.toml"
    path.write_text(f"obstacles = [{{shape = '{shape}', {fields}}}]\n{head}")
    with pytest.raises(BadInput) as error:
        load(path)
    assert str(error.value).startswith(f"{path}: obstacles[0].{shape}.{complaint}")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("center", [(math.nan, 0), (0, math.inf), (0,), (0, 0, 0)])
def test_places_that_are_no_points_are_refused(center):
    assert len(complaints(lambda: circle(center=center))) == 1
    assert len(complaints(lambda: box(center=center))) == 1


def test_an_obstacle_is_told_by_its_shape():
    adapter = TypeAdapter(Obstacle)
    assert adapter.validate_python({"shape": "circle", "center": (0, 0), "radius": 1}) == circle()
    assert adapter.validate_python({"shape": "box", "center": (0, 0), "size": (1, 1)}) == box()
    assert adapter.validate_python({"shape": "polygon", "vertices": SQUARE}) == polygon(SQUARE)
    with pytest.raises(ValidationError, match="blob"):
        adapter.validate_python({"shape": "blob"})


# What they are --------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("vertices", [SQUARE, SQUARE[::-1], BOOMERANG, BOOMERANG[::-1]])
def test_corners_go_anticlockwise_whichever_way_they_were_written(vertices):
    corners = polygon(vertices).corners
    assert corners.shape == (4, 2)
    assert shapely.LinearRing(corners).is_ccw
    assert sorted(map(tuple, corners.tolist())) == sorted(vertices)
    assert polygon(vertices).thickness == 0.0


@given(st.lists(st.tuples(coordinates, coordinates), min_size=3, max_size=8, unique=True))
def test_any_simple_polygon_keeps_its_shape(vertices):
    shape = shapely.Polygon(vertices)
    assume(shape.is_valid and shape.area > 1e-6)
    for order in (vertices, vertices[::-1]):
        corners = anticlockwise(order)
        assert shapely.LinearRing(corners).is_ccw
        assert shapely.Polygon(corners).equals(shape)


@given(coordinates, coordinates, lengths, lengths, st.floats(-7, 7))
def test_a_box_is_the_rectangle_that_it_says(x, y, width, height, angle):
    its = box((x, y), (width, height), angle=angle)
    centred = shapely.box(-width / 2, -height / 2, width / 2, height / 2)
    turned = shapely.affinity.rotate(centred, angle, origin=(0, 0), use_radians=True)
    expected = shapely.affinity.translate(turned, x, y)
    assert its.polygon.symmetric_difference(expected).area < 1e-9
    assert shapely.LinearRing(its.corners).is_ccw


def test_a_turned_box():
    np.testing.assert_allclose(
        box((1.0, 2.0), (4.0, 2.0), angle=math.pi / 2).corners, [[2, 0], [2, 4], [0, 4], [0, 0]], atol=1e-12
    )


def test_a_disc_is_a_thickened_point():
    disc = circle((1.0, 2.0), 0.5)
    np.testing.assert_array_equal(disc.corners, [[1.0, 2.0]])
    assert disc.thickness == 0.5


@pytest.mark.parametrize(
    ("obstacle", "point", "inside"),
    [
        (circle(), (0.0, 0.0), True),
        (circle(), (1.0 - 1e-8, 0.0), True),
        (circle(), (1.0 - CONTACT / 2, 0.0), False),  # contact is free
        (circle(), (1.0, 0.0), False),
        (circle(), (0.8, 0.8), False),
        (polygon(SQUARE), (1.0, 1.0), True),
        (polygon(SQUARE), (1e-8, 1.0), True),
        (polygon(SQUARE), (CONTACT / 2, 1.0), False),
        (polygon(SQUARE), (0.0, 0.0), False),
        (polygon(SQUARE), (3.0, 1.0), False),
        (polygon(BOOMERANG), (2.0, 2.0), False),  # between the arms
        (polygon(BOOMERANG), (0.5, 0.5), True),
        (box(angle=math.pi / 4), (0.6, 0.0), True),
        (box(), (0.6, 0.0), False),
    ],
)
def test_what_an_obstacle_covers(obstacle, point, inside):
    assert obstacle.covers(point) is inside


# Arrays for kernels ---------------------------------------------------------------------------------------------------
def test_shapes_are_the_corners_of_all_obstacles_one_after_the_other():
    obstacles = [circle((5.0, 6.0), 0.5), polygon(SQUARE), box(), circle((7.0, 8.0), 0.25)]
    shapes = Shapes.of(obstacles)
    assert shapes.starts.tolist() == [0, 1, 5, 9, 10]
    assert shapes.thickness.tolist() == [0.5, 0.0, 0.0, 0.25]
    for obstacle, start, stop in zip(obstacles, shapes.starts, shapes.starts[1:], strict=False):
        np.testing.assert_array_equal(shapes.corners[start:stop], obstacle.corners)
    assert (shapes.corners.dtype, shapes.starts.dtype, shapes.thickness.dtype) == (np.float64, np.int64, np.float64)
    assert shapes.corners.flags.c_contiguous


def test_a_world_without_obstacles_has_empty_arrays_of_the_same_types():
    shapes = Shapes.of([])
    assert shapes.corners.shape == (0, 2)
    assert shapes.starts.tolist() == [0]
    assert shapes.thickness.shape == (0,)
    assert (shapes.corners.dtype, shapes.starts.dtype, shapes.thickness.dtype) == (np.float64, np.int64, np.float64)


def test_every_obstacle_is_drawn():
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle as Disc

    axes = Figure().subplots()
    draw_obstacles(axes, [circle((1.0, 2.0), 0.5), polygon(SQUARE), box()])
    disc, *solids = axes.patches
    assert isinstance(disc, Disc)
    assert (disc.center, disc.radius) == ((1.0, 2.0), 0.5)
    assert [len(solid.get_xy()) for solid in solids] == [5, 5]  # closed


def test_a_last_vertex_that_repeats_the_first_is_left_out():
    assert polygon([*SQUARE, SQUARE[0]]).vertices == SQUARE

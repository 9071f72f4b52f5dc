"""A motion is seen from across it, and from the side on which nothing hides it."""

import numpy as np
import pytest

from problems.robots.viewpoint import picture_axes, viewpoint

WAY = np.linspace([-1.0, 0.0, 0.5], [1.0, 0.0, 0.5], 20)
SPACING = 0.1
NOTHING = np.empty((0, 3))


def wall(side):
    """Points on a wall along the way, 0.5 m beside it."""
    x, z = np.meshgrid(np.arange(-3.0, 3.0, 0.5 * SPACING), np.arange(0.0, 3.0, 0.5 * SPACING))
    return np.column_stack([x.ravel(), np.full(x.size, 0.5 * side), z.ravel()])


@pytest.mark.parametrize("turn", [0.0, 0.7, 1.6])
def test_the_picture_looks_across_the_way(turn):
    turned = WAY @ [[np.cos(turn), np.sin(turn), 0.0], [-np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]]
    across = (turned[-1] - turned[0]) @ picture_axes(*viewpoint([turned], turned, NOTHING, SPACING))[:2].T
    assert np.linalg.norm(across) > 0.85 * 2.0


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_picture_looks_from_the_side_without_the_wall(side):
    _, _, eye = picture_axes(*viewpoint([WAY], WAY, wall(side), SPACING))
    assert eye[1] * side < 0.0


def test_a_surface_at_the_points_themselves_does_not_hide_them():
    assert viewpoint([WAY], WAY, WAY, SPACING) == viewpoint([WAY], WAY, NOTHING, SPACING)


def test_without_anything_to_look_at_there_is_a_viewpoint():
    assert viewpoint([], NOTHING, NOTHING, SPACING) == viewpoint([WAY[:1]], WAY[:1], NOTHING, SPACING)


def test_the_axes_of_a_picture_are_a_right_handed_frame():
    axes = picture_axes(25.0, -60.0)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)

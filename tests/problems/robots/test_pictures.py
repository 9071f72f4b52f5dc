"""Robots and solids are drawn where they are."""

from types import SimpleNamespace

import numpy as np
from matplotlib.figure import Figure

from problems.robots.arm import BOX, CYLINDER, SPHERE
from problems.robots.pictures import draw_solids

UNTURNED = np.eye(3).ravel()


def test_solids_of_all_kinds_scale_the_axes_to_what_they_are():
    solids = np.array([[kind, *UNTURNED, 0.0, 0.0, 0.0, 0.5, 0.5, 0.5] for kind in (BOX, CYLINDER, SPHERE)])
    for _ in range(5):
        axes = Figure().add_subplot(projection="3d")
        corners = draw_solids(axes, SimpleNamespace(solids=solids))
        np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], [[-0.5] * 3, [0.5] * 3], atol=1e-12)
        for low, high in (axes.get_xlim(), axes.get_ylim(), axes.get_zlim()):
            assert -1.1 < low < -0.4 < 0.4 < high < 1.1, "nothing undefined is in the picture"

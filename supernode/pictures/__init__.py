"""Pictures, drawn by matplotlib: of results in the style of the papers' figures, and of topologies; and a 3-D viewer.

Read `picture` first: it draws a problem with a solution, and writes figures to files. The planners draw themselves
(`problems.problem.Problem.draw`). Matplotlib's import takes a second, so commands import this subpackage only where
they draw. `viewer` shows an animation (`problems.animation`) in a browser; `scene_nodes` is the part of it that does
not depend on the viewer's library.
"""

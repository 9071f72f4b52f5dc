"""Pictures, drawn by matplotlib: of results in the style of the papers' figures, and of topologies.

Read `picture` first: it draws a problem with a solution, and writes figures to files. The planners draw themselves
(`problems.problem.Problem.draw`). Matplotlib's import takes a second, so commands import this room where they draw.
"""

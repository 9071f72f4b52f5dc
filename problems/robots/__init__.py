"""Robots described by URDF: reading them, the compact model that planners use, and what several kinds share.

Read `arm` first: the compact model. `fields` has the tables of the problem file, `loading` reads the files that they
name, and `making` turns the gathered texts into the model.
"""

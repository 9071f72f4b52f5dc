"""The commands, one module each.

A module's docstring is the command's help text. The module holds EXAMPLE, `add_arguments`, and `run`, which returns the
exit code. Only what the arguments need is imported at the top, so that ``--help`` answers at once.
"""

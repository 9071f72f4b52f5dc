"""The commands, one module each.

A module's docstring is the command's help text. The module holds EXAMPLE, `add_arguments`, and `run`, which returns the
exit code. Only what the arguments need is imported at the top, so that ``--help`` answers at once.

Read `submit` first: a short command. Options that several commands share are in the modules named `…_options`.
`supernode.__main__` lists the commands, parses the arguments and runs one command.
"""

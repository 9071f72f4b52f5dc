"""Runs a command as a person types it, without a new process."""

from supernode.__main__ import main


def in_process(capture, *arguments):
    """Exit code, stdout and stderr of a command; ``capture`` is pytest's ``capsys`` or ``capfd``."""
    try:
        code = main([str(argument) for argument in arguments])
    except SystemExit as error:
        code = error.code
    captured = capture.readouterr()
    return code, captured.out, captured.err

"""Text from elsewhere, made fit for a terminal: what others wrote must not move the cursor or change the screen."""


def printable(text: str) -> str:
    r"""Return ``text`` on one line, with an escape such as ``\x1b`` in place of each character that is not printable.

    Not printable are control characters (of C0 and C1), line ends, characters that turn the direction of writing, lone
    surrogates, and spaces other than the usual one: what `repr` escapes too.
    """
    if text.isprintable():
        return text
    return "".join(each if each.isprintable() else each.encode("unicode_escape").decode() for each in text)


def printable_lines(text: str) -> str:
    """Return ``text`` with its line ends, each line as `printable` has it."""
    return "\n".join(map(printable, text.split("\n")))

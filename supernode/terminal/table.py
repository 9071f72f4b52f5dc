"""Format tables for people: columns as wide as their contents, numbers aligned to the right.

What is not printable is escaped.
"""

from collections.abc import Sequence

from wire.printable import printable


def table(titles: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return the rows under their titles as text; None is shown as "-"."""
    cells = [list(titles), *([_shown(value) for value in row] for row in rows)]
    widths = [max(len(row[column]) for row in cells) for column in range(len(titles))]
    right = [
        bool(rows) and all(isinstance(row[column], int | float | None) for row in rows) for column in range(len(titles))
    ]
    return "\n".join(
        "  ".join(
            cell.rjust(width) if number else cell.ljust(width)
            for cell, width, number in zip(row, widths, right, strict=True)
        ).rstrip()
        for row in cells
    )


def _shown(value: object) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.6g}"
    return printable(str(value))

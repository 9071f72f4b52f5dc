"""Read maps of the MovingAI benchmark sets (Sturtevant, "Benchmarks for grid-based pathfinding", 2012)."""

from pathlib import Path

from problems.errors import BadInput, shorten


def read(path: Path) -> list[str]:
    """Return the rows of a map of type octile.

    Raises:
        BadInput: If the file cannot be read or is no such map; the error is one line.
    """
    try:
        lines = path.read_text(encoding="ascii").splitlines()
    except FileNotFoundError:
        raise BadInput(f"file: expected a map, found no such file as {path}") from None
    except UnicodeDecodeError as error:
        raise BadInput(f"file: expected a map in ASCII, found {error} in {path}") from None
    except OSError as error:
        raise BadInput(f"file: expected a readable map, found {error.strerror}: {path}") from None
    except ValueError as error:
        raise BadInput(f"file: expected the name of a map, found {shorten(str(path))}: {error}") from None
    words = [line.split() for line in lines[:4]]
    keys = ["type", "height", "width", "map"]
    if [each[0] for each in words if each] != keys or words[0][1:] != ["octile"]:
        raise BadInput(
            f"file: expected lines 'type octile', 'height ..', 'width ..', 'map', found {shorten(lines[:4])}"
        )
    rows = lines[4:]
    # Blank lines at the end are no rows.
    while rows and not rows[-1].strip():
        rows.pop()
    height, width = words[1][1:], words[2][1:]
    widths = sorted({len(row) for row in rows})
    if height != [str(len(rows))] or [width] != [[str(each)] for each in widths]:
        raise BadInput(
            f"file: expected height {' '.join(height)} and width {' '.join(width)} as {path.name} says, "
            f"found {len(rows)} rows of {' or '.join(map(str, widths)) or 'no'} characters"
        )
    return rows

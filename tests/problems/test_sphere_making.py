"""The spheres of a vehicle are made once for a file, whatever happens to what is kept of them."""

import threading
from pathlib import Path

import pytest

from problems import BadInput, load, progress
from problems.sphere_path import cells, making

CART = """
kind = "sphere-path"
start = {start}
goal = [3.0, 1.0]
bounds = [[0.0, 4.0], [0.0, 2.0]]
nodes = 2
bits = 6
accuracy = 0.4
vehicle = {{radius = 0.2}}
[[obstacles]]
shape = "circle"
center = [2.0, 1.0]
radius = 0.3
"""


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[int]:
    """How often spheres were made, in a cache folder of the test's own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    calls: list[int] = []
    subdivide = cells.subdivide

    def count(*arguments: object) -> str:
        calls.append(1)
        return subdivide(*arguments)

    monkeypatch.setattr(cells, "subdivide", count)
    return calls


@pytest.fixture
def cart(tmp_path: Path) -> Path:
    path = tmp_path / "cart.toml"
    path.write_text(CART.format(start="[1.0, 1.0]"))
    return path


def test_they_are_made_once_for_a_file(made: list[int], cart: Path) -> None:
    codes = {load(cart).fields["hierarchy"] for _ in range(3)}
    assert (len(codes), len(made)) == (1, 1)
    cart.write_text(cart.read_text().replace("accuracy = 0.4", "accuracy = 0.3"))
    load(cart)
    assert len(made) == 2
    assert len(list(making.folder().iterdir())) == 2


@pytest.mark.parametrize("spoil", [b"", b"short", b"\xff\xfe", None])
def test_what_is_not_as_it_was_written_is_made_again(made: list[int], cart: Path, spoil: bytes | None) -> None:
    code = load(cart).fields["hierarchy"]
    (kept,) = making.folder().iterdir()
    kept.write_bytes(kept.read_bytes()[:-1] if spoil is None else spoil)
    assert load(cart).fields["hierarchy"] == code
    assert len(made) == 2
    load(cart)
    assert len(made) == 2, "it is kept again"


def test_without_a_place_to_keep_them_they_are_made_each_time(
    made: list[int], cart: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert load(cart).fields["hierarchy"] == load(cart).fields["hierarchy"]
    assert len(made) == 2


def test_no_more_than_so_much_is_kept(made: list[int], cart: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load(cart)
    (kept,) = making.folder().iterdir()
    monkeypatch.setattr(making, "MOST_BYTES", kept.stat().st_size + 1)
    cart.write_text(cart.read_text().replace("accuracy = 0.4", "accuracy = 0.41"))
    load(cart)
    assert len(made) == 2
    assert kept not in list(making.folder().iterdir())
    assert len(list(making.folder().iterdir())) <= 1


def test_it_says_when_accuracy_is_what_blocks(made: list[int], cart: Path) -> None:
    cart.write_text(CART.format(start="[1.45, 1.0]"))
    with pytest.raises(BadInput, match=r"nearer than `accuracy` to a collision, though 0\.05 m away from one: a finer"):
        load(cart)
    cart.write_text(cart.read_text().replace("accuracy = 0.4", "accuracy = 0.02"))
    load(cart)


def test_it_says_when_the_vehicle_itself_collides(made: list[int], cart: Path) -> None:
    cart.write_text(CART.format(start="[1.6, 1.0]"))
    with pytest.raises(BadInput, match=r"start: .* found \[1\.6, 1\.0\] in collision"):
        load(cart)


def test_people_are_told_of_what_takes_long_and_of_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    told, heard = [], threading.Event()

    def listen(line: str) -> None:
        told.append(line)
        heard.set()

    monkeypatch.setattr(progress, "_listeners", [])
    with progress.reporting_if_slow("nobody listens"):
        pass
    progress.set_listener(listen)
    with progress.reporting_if_slow("soon done"):
        pass
    monkeypatch.setattr(progress, "AFTER", 0.0)
    with progress.reporting_if_slow("making spheres"):
        assert heard.wait(10)
    assert told == ["making spheres ..."]

"""The house stands: floors, packages, docstrings, and purity where it is promised."""

import ast
import re
import tomllib
from collections import Counter
from pathlib import Path

import networkx
import pytest

ROOT = Path(__file__).resolve().parent.parent
FLOORS = {
    "lowlevel": 0,
    "topologies": 0,
    "genetics": 1,
    "problems": 2,
    "wire": 2,
    "node": 3,
    "spy": 4,
    "coordinator": 5,
    "supernode": 6,
}
MODULES = sorted(path for package in FLOORS for path in (ROOT / package).rglob("*.py"))

# What a module without input, output or clock may import beside this project's own: a list of the harmless, so that
# whatever else somebody imports there is a question first.
HARMLESS = {
    "__future__",
    "abc",
    "bisect",
    "collections",
    "dataclasses",
    "enum",
    "functools",
    "hashlib",
    "heapq",
    "itertools",
    "math",
    "networkx",
    "numba",
    "numpy",
    "operator",
    "re",
    "struct",
    "types",
    "typing",
    "zlib",
}
PURE = [
    *(path for path in MODULES if path.relative_to(ROOT).parts[0] in ("topologies", "genetics")),
    *(ROOT / "node" / f"{name}.py" for name in ("cell", "generation", "history", "inbox", "kernels", "plan", "rows")),
    *(ROOT / "coordinator" / f"{name}.py" for name in ("scheduler", "states")),
]
STATED_EXCEPTIONS = {
    "lowlevel/compiled.py": {"inspect", "os"},  # it tells the cache which file a kernel is from
    "lowlevel/kernel_cache.py": {"os", "pathlib", "shutil"},  # it looks after the folders of compiled kernels
    "lowlevel/numba_loader.py": {"importlib", "llvmlite", "sys"},  # it looks after what numba loads
}


def name_of(path):
    return str(path.relative_to(ROOT))


def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


def statements_of(path):
    """Every import of a file, as a module and the names imported from it.

    Imports count at the top, within functions, for type checkers only, and by import_module.
    """
    package = path.relative_to(ROOT).parent.parts
    for node in ast.walk(tree_of(path)):
        match node:
            case ast.Import(names=names):
                yield from ((alias.name, []) for alias in names)
            case ast.ImportFrom(module=module, names=names, level=level):
                above = package[: len(package) + 1 - level] if level else ()
                yield ".".join([*above, *([module] if module else [])]), [alias.name for alias in names]
            case ast.Call(func=ast.Attribute(attr="import_module"), args=[ast.Constant(value=str(name)), *_]):
                yield name, []


def imports_of(path):
    """Every module that a file imports, and every name from a module, which may be a module itself."""
    for module, names in statements_of(path):
        yield module
        yield from (f"{module}.{name}" for name in names)


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_a_package_imports_only_from_floors_below_its_own(path):
    own = path.relative_to(ROOT).parts[0]
    used = {name.split(".")[0] for name in imports_of(path)} & FLOORS.keys() - {own}
    assert {name for name in used if FLOORS[name] >= FLOORS[own]} == set()


def test_the_search_for_imports_finds_every_way_to_import(tmp_path, monkeypatch):
    monkeypatch.setitem(imports_of.__globals__, "ROOT", tmp_path)
    (tmp_path / "wire").mkdir()
    path = tmp_path / "wire" / "module.py"
    path.write_text(
        "import one.part\nfrom two import part\nfrom . import three\nfrom .four import part\n"
        "def f():\n    import five\n    importlib.import_module('six')\n"
        "if TYPE_CHECKING:\n    from seven import part\n"
    )
    expected = {"one.part", "two", "two.part", "wire", "wire.three", "wire.four", "wire.four.part", "five", "six"}
    expected |= {"seven", "seven.part"}
    assert set(imports_of(path)) == expected


def module_of(path):
    """The dotted name under which a file is imported."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def modules_imported_by(path, known):
    """Those of the ``known`` modules that a file imports; a package only where a name of its own is imported."""
    for module, names in statements_of(path):
        members = {name: f"{module}.{name}" in known for name in names}
        yield from (f"{module}.{name}" for name, is_module in members.items() if is_module)
        if module in known and not (members and all(members.values())):
            yield module


def circles_in(arrows):
    """The groups of modules that import each other, each sorted; ``arrows`` has what each module imports."""
    graph = networkx.DiGraph((one, other) for one, others in arrows.items() for other in others)
    return sorted(sorted(circle) for circle in networkx.strongly_connected_components(graph) if len(circle) > 1)


def test_no_modules_import_each_other():
    """Imports within functions and for type checkers count too: a reader has to follow these as well."""
    paths = {module_of(path): path for path in MODULES}
    arrows = {module: set(modules_imported_by(path, paths)) for module, path in paths.items()}
    assert circles_in(arrows) == []


KINDS = sorted(path.parent for path in (ROOT / "problems").glob("*/planner.py"))
ABOVE_THE_MODEL = {"checker", "drawing", "motion", "oracle", "planner"}


@pytest.mark.parametrize("kind", KINDS, ids=name_of)
def test_a_planner_joins_what_imports_its_model(kind):
    modules = {path.stem: set(imports_of(path)) for path in kind.glob("*.py")}
    assert modules.keys() >= {"model", "kernels", "checker", "oracle", "drawing", "planner"}
    package = ".".join(kind.relative_to(ROOT).parts)
    assert modules["model"] & {f"{package}.{name}" for name in ABOVE_THE_MODEL} == set()
    assert {name for name, imported in modules.items() if f"{package}.planner" in imported} == {"__init__"}


@pytest.mark.parametrize("kind", KINDS, ids=name_of)
def test_checkers_and_oracles_do_not_ask_the_fitness(kind):
    for path in [*kind.glob("checker*.py"), *kind.glob("oracle*.py")]:
        asked = {node.attr for node in ast.walk(tree_of(path)) if isinstance(node, ast.Attribute)}
        assert "evaluate" not in asked, name_of(path)


def test_the_search_for_circles_finds_long_ones_and_no_others():
    assert circles_in({"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": {"d", "e"}, "e": set()}) == [["a", "b", "c"]]


def test_pyproject_lists_the_packages_that_are_on_disk():
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    on_disk = {".".join(path.parent.relative_to(ROOT).parts) for path in MODULES}
    assert sorted(listed) == sorted(on_disk)


def test_the_top_level_packages_are_the_floors():
    on_disk = {path.parent.name for path in ROOT.glob("*/__init__.py")}
    assert on_disk == FLOORS.keys()


def test_every_folder_of_modules_is_a_package():
    assert {name_of(path.parent) for path in MODULES if not (path.parent / "__init__.py").exists()} == set()


@pytest.mark.parametrize("package", FLOORS)
def test_every_package_is_typed(package):
    assert (ROOT / package / "py.typed").is_file()


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_every_module_opens_with_a_docstring(path):
    docstring = ast.get_docstring(tree_of(path))
    assert docstring is not None
    assert docstring.strip()


@pytest.mark.parametrize("path", PURE, ids=name_of)
def test_pure_modules_import_neither_input_nor_output_nor_clock(path):
    foreign = {name.split(".")[0] for name in imports_of(path)} - FLOORS.keys()
    assert foreign - HARMLESS - STATED_EXCEPTIONS.get(name_of(path), set()) == set()


@pytest.mark.parametrize("path", PURE, ids=name_of)
def test_pure_modules_open_no_session_and_no_file_and_draw_no_stateful_numbers(path):
    assert "wire.sessions" not in set(imports_of(path))
    named = {node.id for node in ast.walk(tree_of(path)) if isinstance(node, ast.Name)}
    assert named & {"open", "input", "print", "breakpoint", "__import__", "exec", "eval"} == set()
    of_numpy = {
        node.attr
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in ("np", "numpy")
    }
    assert of_numpy & {"random", "load", "save", "fromfile", "memmap", "loadtxt", "savetxt", "datetime64"} == set()


def test_tests_are_no_packages_and_their_names_are_unique():
    files = list((ROOT / "tests").rglob("*.py"))
    assert [name_of(path) for path in files if path.name == "__init__.py"] == []
    counts = Counter(path.name for path in files if path.name != "conftest.py")
    assert [name for name, count in counts.items() if count > 1] == []


def test_the_citation_is_of_this_version():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    citation = (ROOT / "CITATION.cff").read_text()
    said = dict(re.findall(r"^([\w-]+): *(.*)$", citation, re.MULTILINE))
    assert (said["version"], said["license"]) == (project["version"], project["license"])
    assert said.keys() >= {"cff-version", "message", "title", "authors"}


def test_what_the_algorithm_s_page_refers_to_is_among_the_references():
    named = set(re.findall(r"\[([A-ZŞ]\w+(?: \d{4})?)\](?!\()", (ROOT / "docs" / "algorithm.md").read_text()))
    known = set(re.findall(r"^- \*\*\[(.+?)\]\*\*", (ROOT / "docs" / "references.md").read_text(), re.MULTILINE))
    assert len(named) > 10
    assert named <= known, named - known


def test_links_between_pages_lead_somewhere():
    for page in [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]:
        for target in re.findall(r"\]\((?!https?:)([^)#]+)\)", page.read_text()):
            assert (page.parent / target).exists(), f"{page.name}: {target}"

"""The layers hold: packages and what they import, docstrings, and purity where it is promised."""

import ast
import re
import tomllib
from collections import Counter, defaultdict
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
ROOMS = {  # of a package with more modules than a reader can survey; a module beside the rooms counts as one
    "coordinator": {
        "cpu_time": 0,
        "errors": 0,
        "log_lines": 0,
        "threads": 0,
        "jobs": 1,
        "store": 2,
        "service": 3,
        "launch": 4,
        "experiments": 5,
    },
    "supernode": {
        "exits": 0,
        "signals": 0,
        "files": 0,
        "motion": 0,
        "pictures": 1,
        "robots": 0,
        "runs": 0,
        "scenes": 0,
        "client": 1,
        "deploy": 2,
        "live": 2,
        "reports": 2,
        "dashboard": 3,
        "terminal": 3,
        "launch": 4,
        "chaos": 5,
        "commands": 6,
    },
}
MOST_LINES_ABOUT_A_ROOM = 40
MOST_LINES_OF_A_MODULE = 400
MOST_LINES_OF_A_CLASS = 300
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
    *(ROOT / "node" / f"{name}.py" for name in ("cell", "events", "patience", "plan", "stimuli")),
    *(ROOT / "node" / "engine").glob("*.py"),
    *(
        ROOT / "coordinator" / "jobs" / f"{name}.py"
        for name in ("client_limits", "client_queues", "returning_clients", "scheduler", "states")
    ),
]
# What only lowlevel/ may use: modules, and names of private parts of numba, CPython and Linux.
LOW_LEVEL_MODULES = {"ctypes", "llvmlite"}
LOW_LEVEL_NAMES = {"fndesc", "call_conv", "entry_point", "get_pointer_to_function", "pythonapi", "prctl", "syscall"}
PUBLIC_IN_SPITE_OF_THEIR_NAMES = {
    ("os", "_exit"),
    ("argparse", "_ArgumentGroup"),  # the type has no other name
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


def rooms_in(package):
    """Each room's modules; a module beside the rooms is a room of its own."""
    rooms = defaultdict(list)
    for path in MODULES:
        own, *rest = path.relative_to(ROOT).with_suffix("").parts
        if own == package and rest[0] not in ("__init__", "__main__"):
            rooms[rest[0]].append(path)
    return rooms


@pytest.mark.parametrize("package", ROOMS)
def test_a_room_imports_only_from_rooms_below_it(package):
    floors = ROOMS[package]
    for room, paths in rooms_in(package).items():
        for path in paths:
            names = [name.split(".") for name in imports_of(path)]
            used = {each[1] for each in names if each[0] == package and len(each) > 1} & floors.keys() - {room}
            assert {each for each in used if floors[each] >= floors[room]} == set(), name_of(path)


@pytest.mark.parametrize("package", ROOMS)
def test_the_rooms_are_what_is_on_disk(package):
    assert rooms_in(package).keys() == ROOMS[package].keys()


@pytest.mark.parametrize("package", ROOMS)
def test_a_room_says_in_a_page_what_happens_in_it_and_where_to_begin(package):
    for room, paths in rooms_in(package).items():
        if (ROOT / package / room).is_dir():
            docstring = ast.get_docstring(tree_of(ROOT / package / room / "__init__.py"))
            assert len(docstring.splitlines()) <= MOST_LINES_ABOUT_A_ROOM
            first = re.search(r"Read `(\w+)` first", docstring)
            assert first is not None, f"{room} does not say which module to read first"
            assert first[1] in {path.stem for path in paths}


@pytest.mark.parametrize("package", ["node", "node/engine", "problems", "spy", "wire"])
def test_a_package_of_many_modules_says_where_to_begin(package):
    docstring = ast.get_docstring(tree_of(ROOT / package / "__init__.py"))
    assert len(docstring.splitlines()) <= MOST_LINES_ABOUT_A_ROOM
    first = re.search(r"Read `(\w+)` first", docstring)
    assert first is not None, f"{package} does not say which module to read first"
    assert (ROOT / package / f"{first[1]}.py").exists()


@pytest.mark.parametrize("package", ROOMS)
def test_tests_mirror_the_rooms(package):
    folders = {path.name for path in (ROOT / "tests" / package).iterdir() if any(path.glob("test_*.py"))}
    assert folders <= ROOMS[package].keys()


@pytest.mark.parametrize("path", sorted((ROOT / "node" / "engine").glob("*.py")), ids=name_of)
def test_the_engine_uses_nothing_of_what_is_around_it_but_the_plan(path):
    used = {name for name in imports_of(path) if name.startswith("node.")}
    assert {name for name in used if name.split(".")[1] not in ("engine", "plan")} == set()


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
ABOVE_THE_MODEL = {"animation", "checker", "drawing", "motion", "oracle", "planner"}


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


def test_tests_have_all_extras_but_those_of_benchmarks_of_the_fuzzer_and_the_largest():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    own = re.search(r"supernode\[(.+)\]", " ".join(extras["test"]))
    assert own is not None
    assert set(own[1].split(",")) == extras.keys() - {"bench", "fuzz", "ompl", "ray", "test"}


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


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_no_module_and_no_class_is_longer_than_a_reader_can_survey(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= MOST_LINES_OF_A_MODULE
    classes = [node for node in ast.walk(tree_of(path)) if isinstance(node, ast.ClassDef)]
    lengths = {node.name: node.end_lineno - node.lineno + 1 for node in classes}
    assert {name for name, lines in lengths.items() if lines > MOST_LINES_OF_A_CLASS} == set()


@pytest.mark.parametrize("path", PURE, ids=name_of)
def test_pure_modules_import_neither_input_nor_output_nor_clock(path):
    foreign = {name.split(".")[0] for name in imports_of(path)} - FLOORS.keys()
    assert foreign - HARMLESS == set()


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


def private_parts_in(path):
    """What a module uses that only lowlevel/ may: modules, attributes, and private names of other packages' modules."""
    outside = {}  # names in this module to what they stand for in another package
    for node in ast.walk(tree_of(path)):
        match node:
            case ast.Import(names=names):
                outside |= {alias.asname or alias.name.split(".")[0]: alias.name for alias in names}
                yield from (alias.name for alias in names if is_of(LOW_LEVEL_MODULES, alias.name))
            case ast.ImportFrom(module=module, names=names, level=0) if not is_of(FLOORS, module):
                outside |= {alias.asname or alias.name: f"{module}.{alias.name}" for alias in names}
                yield from ([module] if is_of(LOW_LEVEL_MODULES, module) else [])
                yield from (f"{module}.{alias.name}" for alias in names if is_private(alias.name))
            case ast.Attribute(attr=attr) if attr in LOW_LEVEL_NAMES:
                yield attr
    for node in ast.walk(tree_of(path)):
        match node:
            case ast.Attribute(value=ast.Name(id=name), attr=attr) if is_private(attr) and name in outside:
                if not is_of(FLOORS, outside[name]) and (outside[name], attr) not in PUBLIC_IN_SPITE_OF_THEIR_NAMES:
                    yield f"{outside[name]}.{attr}"


def is_of(packages, module):
    return module.split(".")[0] in packages


def is_private(name):
    return name.startswith("_") and not name.startswith("__")


@pytest.mark.parametrize(
    "path", [each for each in MODULES if each.relative_to(ROOT).parts[0] != "lowlevel"], ids=name_of
)
def test_only_the_low_level_package_relies_on_private_parts(path):
    assert set(private_parts_in(path)) == set()


def test_the_search_for_private_parts_finds_every_way_to_use_them(tmp_path):
    path = tmp_path / "module.py"
    path.write_text(
        "import ctypes\nfrom llvmlite import binding\nfrom numba.core._x import _y\nimport zenoh as z\n"
        "f.fndesc\nlibc.prctl(1)\nz._inner\nself._own\nimport os\nos._exit(1)\na.ctypes.data\n"
    )
    assert set(private_parts_in(path)) == {
        "ctypes", "llvmlite", "numba.core._x._y", "fndesc", "prctl", "zenoh._inner"
    }  # fmt: skip


# What would run code that is hidden in data: modules, functions by name or attribute, and keywords of calls.
MODULES_THAT_RUN_DATA = {"cloudpickle", "dill", "joblib", "marshal", "pickle", "shelve"}
FUNCTIONS_THAT_RUN_DATA = {
    "eval",
    "exec",
    "os.system",
    "os.popen",
    "subprocess.getoutput",
    "subprocess.getstatusoutput",
}
YAML = ("load", "load_all", "full_load", "full_load_all", "unsafe_load", "unsafe_load_all")
YAML += ("Loader", "FullLoader", "UnsafeLoader", "CLoader", "CFullLoader", "CUnsafeLoader")
FUNCTIONS_THAT_RUN_DATA |= {f"yaml.{name}" for name in YAML}
KEYWORDS_THAT_RUN_DATA = {"allow_pickle", "shell"}


def what_runs_data_in(path):
    """What a module uses that turns data into code, or gives text to a shell."""
    tree = tree_of(path)
    origins = {}  # names in this module to what they stand for elsewhere
    for node in ast.walk(tree):
        match node:
            case ast.Import(names=names):
                origins |= {alias.asname or alias.name.split(".")[0]: alias.name for alias in names}
            case ast.ImportFrom(module=module, names=names, level=0):
                origins |= {alias.asname or alias.name: f"{module}.{alias.name}" for alias in names}
    yield from (name for name in imports_of(path) if is_of(MODULES_THAT_RUN_DATA, name))
    safe = [node.func for node in ast.walk(tree) if isinstance(node, ast.Call) and names_a_safe_loader(node)]
    for node in (each for each in ast.walk(tree) if each not in safe):
        match node:
            case ast.Name(id=name):
                used = origins.get(name, name)
            case ast.Attribute(value=ast.Name(id=name), attr=attr):
                used = f"{origins.get(name, name)}.{attr}".removeprefix("builtins.")
            case ast.keyword(arg=str(name), value=value) if name in KEYWORDS_THAT_RUN_DATA:
                if not (isinstance(value, ast.Constant) and value.value is False):
                    yield name
                continue
            case _:
                continue
        if used in FUNCTIONS_THAT_RUN_DATA:
            yield used


def names_a_safe_loader(call):
    """Whether the second argument of yaml.load is one that makes plain values only."""
    return len(call.args) == 2 and "SafeLoader" in ast.unparse(call.args[1])


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_no_module_runs_code_that_is_hidden_in_data(path):
    assert set(what_runs_data_in(path)) == set()


def test_the_search_for_what_runs_data_finds_every_way(tmp_path, monkeypatch):
    monkeypatch.setitem(imports_of.__globals__, "ROOT", tmp_path)
    path = tmp_path / "module.py"
    path.write_text(
        "import pickle as p\nfrom marshal import loads\nimportlib.import_module('shelve')\n"
        "import builtins\nbuiltins.exec('1')\nevaluated = map(eval, texts)\n"
        "import yaml as y\ny.load(f)\nfrom yaml import full_load as read\nread(f)\n"
        "y.load_all(f, y.FullLoader)\nimport os\nos.system(text)\n"
        "np.load(f, allow_pickle=True)\nrun(text, shell=wanted)\n"
    )
    assert set(what_runs_data_in(path)) == {
        "pickle", "marshal", "marshal.loads", "shelve", "exec", "eval", "yaml.load", "yaml.load_all",
        "yaml.FullLoader", "yaml.full_load", "os.system", "allow_pickle", "shell",
    }  # fmt: skip
    path.write_text(
        "# eval, pickle\n'exec'\nimport re, yaml, json\nre.compile('eval')\nyaml.safe_load(f)\n"
        "yaml.load_all(f, yaml.SafeLoader)\njson.load(f)\n"
        "np.load(f, allow_pickle=False)\nrun(words, shell=False)\nproblem.evaluate(x)\nself.load(f)\n"
    )
    assert set(what_runs_data_in(path)) == set()


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

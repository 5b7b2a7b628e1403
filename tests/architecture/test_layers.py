"""The one-way rule: who may import whom, read from the source, not from what happens to load.

Verbs ask the kinds of experiment and name none; the thesis's figures lie beneath nothing.
"""

import ast
import graphlib
import shutil
import subprocess
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

from pipelines.experiments import KINDS

ROOT = Path(__file__).parents[2]
PACKAGES = ("labpipe", "instruments", "calibration", "pipelines")

FRONT_DOOR = ROOT / "labpipe/__init__.py"
"""Names the packages above, for the type checker and in a table of what to load on first use."""

ALLOWED = {
    "labpipe": {"labpipe"},
    "instruments": {"labpipe", "instruments"},
    "calibration": {"labpipe", "calibration"},
    "pipelines": set(PACKAGES),
}

# Inside labpipe: a part may import itself, the ground, and what stands below it.
GROUND = {
    *("errors", "units", "schema", "frames", "files", "netcdf", "text", "binary", "arrays", "variables"),
    *("compilation", "notebook", "uncertainty", "plugins", "installation"),
}
BELOW = {
    "signals": set(),
    "materials": set(),
    "imaging": set(),
    "contact": {"materials"},
    "identification": {"materials", "contact"},
    "workflow": set(),
    "judging": set(),
    "report": set(),
}


class Facts(NamedTuple):
    """One module, read once; its syntax tree is not kept."""

    imports: frozenset[str]
    """Names of modules imported as such."""
    taken: tuple[tuple[str, str], ...]
    """Module and name of every ``from … import …``."""
    given: frozenset[str]
    """Names that it gives away: in ``__all__``, or imported as themselves."""
    texts: tuple[tuple[int, str], ...]
    """Lines and values of string constants that are one word."""
    writes: tuple[tuple[int, str], ...]
    """Lines and names of calls that write files."""
    evaluates: tuple[tuple[int, str], ...]
    """Lines and names of calls that run code or pickles from data."""


WRITERS = ("to_netcdf", "savefig", "write_text", "write_bytes", "imwrite")


@cache
def facts(path: Path) -> Facts:
    imports, taken, given, texts, evaluates = set(), [], set(), [], []
    writers: list[tuple[int, str, str, str]] = []
    buffers = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        match node:
            case ast.Import():
                imports |= {alias.name for alias in node.names}
            case ast.ImportFrom(module=str(module)):
                taken += [(module, alias.name) for alias in node.names]
                given |= {alias.name for alias in node.names if alias.asname == alias.name}
            case ast.Assign(targets=[ast.Name("__all__")]):
                given |= set(ast.literal_eval(node.value))
            case ast.Assign(value=ast.Call(func=ast.Name("BytesIO"))):
                buffers |= {target.id for target in node.targets if isinstance(target, ast.Name)}
            case ast.Constant(value=str(value)) if value.isidentifier():
                texts.append((node.lineno, value))
            case ast.keyword(arg="allow_pickle"):
                evaluates.append((node.value.lineno, "allow_pickle"))
            case ast.Call(func=ast.Name("eval" | "exec" as name)):
                evaluates.append((node.lineno, name))
            case ast.Call(func=ast.Attribute(attr=attr, value=owner)) if attr in WRITERS:
                target = node.args[0].id if node.args and isinstance(node.args[0], ast.Name) else ""
                writers.append((node.lineno, attr, owner.id if isinstance(owner, ast.Name) else "", target))
            case ast.Call(func=ast.Name("open"), args=[_, ast.Constant(value=mode), *_]) if set(str(mode)) & set(
                "wax+"
            ):
                writers.append((node.lineno, "open", "", ""))
    writes = [
        (line, name)
        for line, name, owner, target in writers
        if owner != "files" and not (name == "savefig" and target in buffers)
    ]
    return Facts(frozenset(imports), tuple(taken), frozenset(given), tuple(texts), tuple(writes), tuple(evaluates))


@cache
def imported_modules(path: Path) -> frozenset[str]:
    return facts(path).imports | {f"{module}.{name}" for module, name in facts(path).taken}


@cache
def sources(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


def importing(paths: Iterable[Path], is_wrong: Callable[[str], bool]) -> list[str]:
    """Say which of the modules import what they must not."""
    pairs = [(path.relative_to(ROOT), name) for path in paths for name in imported_modules(path)]
    return [f"{path} imports {name}" for path, name in pairs if is_wrong(name)]


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_import_only_downwards(package: str) -> None:
    above = set(PACKAGES) - ALLOWED[package]
    paths = [path for path in sources(package) if path != FRONT_DOOR]
    assert importing(paths, lambda name: name.split(".")[0] in above) == []


def test_the_front_door_names_what_is_above_for_the_type_checker_alone() -> None:
    runs = [
        statement.module
        for statement in ast.parse(FRONT_DOOR.read_text(encoding="utf-8")).body
        if isinstance(statement, ast.ImportFrom)
    ]
    assert {name.split(".")[0] for name in runs if name} & set(PACKAGES) == {"labpipe"}


@pytest.mark.parametrize("part", [*sorted(BELOW), "ground"])
def test_parts_of_labpipe_import_only_the_ground_and_what_is_below(part: str) -> None:
    allowed = GROUND | {"__version__"} | (BELOW[part] | {part} if part in BELOW else set())
    inside = {part} if part in BELOW else GROUND
    paths = [p for p in sources("labpipe") if p.relative_to(ROOT / "labpipe").parts[0].removesuffix(".py") in inside]
    assert importing(paths, lambda name: name.startswith("labpipe.") and name.split(".")[1] not in allowed) == []


@cache
def modules() -> dict[str, Path]:
    """Every module of the four packages by its dotted name; a package by its own."""
    found = {}
    for package in PACKAGES:
        for path in sources(package):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def folder_of(module: str) -> str:
    """Name the package whose folder a module lies in; of a package, that is itself."""
    is_package = modules()[module].name == "__init__.py"
    return module if is_package else module.rpartition(".")[0]


@cache
def taken(module: str) -> frozenset[str]:
    """Modules of ours that a module imports, wherever in it the import stands."""
    of = facts(modules()[module])
    found = set(of.imports)
    for source, name in of.taken:
        inner = f"{source}.{name}"
        found.add(inner if inner in modules() and name not in exported(source) else source)
    return frozenset(found & set(modules()))


def exported(package: str) -> frozenset[str]:
    return facts(modules()[package]).given


ROOMS = (*(f"labpipe.{part}" for part in BELOW if part != "workflow"), "instruments")
"""Packages whose inside is theirs alone."""


@pytest.mark.parametrize("room", ROOMS)
def test_outsiders_go_no_further_than_the_face_of_a_package(room: str) -> None:
    wrong = [
        f"{module} imports {name}"
        for module in modules()
        for name in taken(module)
        if name.startswith(f"{room}.")
        and modules()[name].name != "__init__.py"
        and not f"{folder_of(module)}.".startswith(f"{folder_of(name)}.")
    ]
    assert wrong == []


@pytest.mark.parametrize("room", ROOMS)
def test_what_no_face_gives_away_is_marked_as_private(room: str) -> None:
    wrong = [
        name
        for name, path in modules().items()
        if name.startswith(f"{room}.")
        and path.name != "__init__.py"
        and not path.stem.startswith("_")
        and path.stem not in exported(folder_of(name))
    ]
    assert wrong == []


def test_private_modules_are_imported_by_their_own_package_alone() -> None:
    wrong = [
        f"{module} imports {name}"
        for module in modules()
        for name in taken(module)
        if any(part.startswith("_") and part != "__main__" for part in name.split("."))
        and not f"{folder_of(module)}.".startswith(f"{folder_of(name)}.")
    ]
    assert wrong == []


def test_no_modules_import_each_other_in_a_circle() -> None:
    waiting = {name: set(taken(name)) - {name, folder_of(name)} for name in modules()}
    waiting["labpipe"] = set()  # the front door: see above
    order = graphlib.TopologicalSorter(waiting)
    order.prepare()  # raises CycleError, which names the circle
    assert order.is_active()


def test_root_holds_nothing_beyond_the_agreed_layout() -> None:
    """Of what git keeps; beside it a user may have sessions, and results of the commands."""
    if not (ROOT / ".git").exists() or shutil.which("git") is None:
        pytest.skip("only git knows what belongs to the project, and it is not here")
    listed = subprocess.run(
        ["git", "-c", "safe.directory=*", "ls-files", "-z"],  # also in a clone of another user
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    found = {name.split("/")[0] for name in listed.stdout.split("\0") if name}
    agreed = {*PACKAGES, "tests", "sample_data", "pyproject.toml", "README.md", "LICENSE"}
    assert {name for name in found if not name.startswith(".")} == agreed


def test_only_the_file_module_writes_files() -> None:
    """One function writes files, those of netCDF with its neighbour; anything else could leave half a file behind."""
    wrong = [
        f"{path.relative_to(ROOT)}:{line} {name}"
        for path in modules().values()
        if path.relative_to(ROOT).as_posix() not in ("labpipe/files.py", "labpipe/netcdf.py")
        for line, name in facts(path).writes
    ]
    assert wrong == []


def test_nothing_loads_code_or_pickles_from_data() -> None:
    names = {"pickle", "yaml", "dill", "shelve", "marshal"}
    wrong = importing(modules().values(), lambda name: name.split(".")[0] in names)
    wrong += [f"{path}:{line} {name}" for path in modules().values() for line, name in facts(path).evaluates]
    assert wrong == []


EXPERIMENTS = ROOT / "pipelines/experiments"
MAY_NAME_KINDS = tuple(ROOT / "pipelines" / name for name in ("rig", "figures", "bench"))
HOMES = {name: f"pipelines.experiments.{name}" for name in KINDS}

PHYSICS = tuple(ROOT / "labpipe" / name for name in ("signals", "imaging", "materials", "contact", "identification"))
"""A relaxation and a harmonic are phenomena there, before they are kinds of experiment."""


def verbs(package: str) -> list[Path]:
    """Return the modules that must not know which kinds there are."""
    rooms = (*MAY_NAME_KINDS, *PHYSICS, *(EXPERIMENTS / name for name in KINDS))
    return [p for p in sources(package) if not any(room in p.parents for room in rooms)]


@pytest.mark.parametrize("package", PACKAGES)
def test_no_module_outside_its_room_names_a_kind(package: str) -> None:
    found = [
        f"{path.relative_to(ROOT)}:{line} {value}"
        for path in verbs(package)
        for line, value in facts(path).texts
        if value in KINDS
    ]
    assert found == []


def is_of_kind(name: str, *homes: str) -> bool:
    return any(name == home or name.startswith(f"{home}.") for home in homes)


def test_only_the_registry_and_its_own_room_import_from_a_kind() -> None:
    paths = [path for path in verbs("pipelines") if path != EXPERIMENTS / "_registry.py"]
    assert importing(paths, lambda name: is_of_kind(name, *HOMES.values())) == []


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_a_kind_imports_from_no_other(kind: str) -> None:
    others = [home for name, home in HOMES.items() if name != kind]
    assert importing((EXPERIMENTS / kind).rglob("*.py"), lambda name: is_of_kind(name, *others)) == []


def test_every_room_is_that_of_a_kind() -> None:
    rooms = {path.name for path in EXPERIMENTS.iterdir() if (path / "kind.py").is_file()}
    assert rooms == set(KINDS)
    assert {path.name for path in EXPERIMENTS.iterdir() if path.is_dir()} - rooms <= {"shared", "__pycache__"}


def test_figures_lie_beneath_nothing() -> None:
    above = {ROOT / "pipelines/figures", ROOT / "pipelines/commands"}
    paths = [path for path in modules().values() if not above & set(path.parents) and path != FRONT_DOOR]
    assert importing(paths, lambda name: name.startswith("pipelines.figures")) == []

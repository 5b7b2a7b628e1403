"""The one-way rule: who may import whom, read from the source, not from what happens to load."""

import ast
import graphlib
import shutil
import subprocess
from functools import cache
from pathlib import Path

import pytest

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
    "errors",
    "units",
    "schema",
    "frames",
    "files",
    "netcdf",
    "text",
    "binary",
    "arrays",
    "variables",
    "compilation",
    "notebook",
    "uncertainty",
    "plugins",
    "installation",
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


@cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


@cache
def imported_modules(path: Path) -> set[str]:
    found = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


@cache
def sources(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_import_only_downwards(package: str) -> None:
    wrong = [
        f"{path.relative_to(ROOT)} imports {name}"
        for path in sources(package)
        if path != FRONT_DOOR
        for name in imported_modules(path)
        if name.split(".")[0] in PACKAGES and name.split(".")[0] not in ALLOWED[package]
    ]
    assert wrong == []


def test_the_front_door_names_what_is_above_for_the_type_checker_alone() -> None:
    runs = [
        statement.module
        for statement in ast.parse(FRONT_DOOR.read_text(encoding="utf-8")).body
        if isinstance(statement, ast.ImportFrom)
    ]
    assert {name.split(".")[0] for name in runs if name} & set(PACKAGES) == {"labpipe"}


@pytest.mark.parametrize("part", sorted(BELOW))
def test_parts_of_labpipe_import_only_the_ground_and_what_is_below(part: str) -> None:
    allowed = BELOW[part] | {part} | GROUND
    wrong = [
        f"{path.relative_to(ROOT)} imports {name}"
        for path in sorted((ROOT / "labpipe" / part).rglob("*.py"))
        for name in imported_modules(path)
        if name.startswith("labpipe.") and name.split(".")[1] not in allowed | {"__version__"}
    ]
    assert wrong == []


def test_ground_imports_no_part_above_it() -> None:
    wrong = [
        f"{path.name} imports {name}"
        for path in sources("labpipe")
        if path.relative_to(ROOT / "labpipe").parts[0].removesuffix(".py") in GROUND
        for name in imported_modules(path)
        if name.startswith("labpipe.") and name.split(".")[1] not in GROUND | {"__version__"}
    ]
    assert wrong == []


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
    found = set()
    for node in nodes(modules()[module]):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                is_module = inner in modules() and alias.name not in exported(node.module)
                found.add(inner if is_module else node.module)
    return frozenset(found & set(modules()))


@cache
def exported(package: str) -> frozenset[str]:
    """Names that the face of a package gives away: in ``__all__``, or imported as themselves."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(modules()[package].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            found |= set(ast.literal_eval(node.value))
        elif isinstance(node, ast.ImportFrom):
            found |= {alias.name for alias in node.names if alias.asname == alias.name}
    return frozenset(found)


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


@pytest.mark.parametrize("package", ["labpipe.workflow", "calibration"])
def test_what_only_its_own_package_imports_is_marked_as_private(package: str) -> None:
    """These packages have modules that are public by their own name; all others are private."""
    outsiders = [m for m in modules() if not f"{m}.".startswith(f"{package}.")]
    used = {name for module in outsiders for name in taken(module)}
    wrong = [
        name
        for name, path in modules().items()
        if folder_of(name) == package and path.name != "__init__.py" and not path.stem.startswith("_")
        if name not in used
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
    """One function writes files; anything else could leave half a file behind."""
    forbidden = ("to_netcdf", "savefig", "write_text", "write_bytes", "imwrite")
    wrong = []
    for package in PACKAGES:
        for path in sources(package):
            if path.relative_to(ROOT).as_posix() == "labpipe/files.py":
                continue
            for node in nodes(path):
                if not isinstance(node, ast.Call):
                    continue
                if isinstance(node.func, ast.Attribute) and node.func.attr in forbidden:
                    owner = node.func.value
                    name = owner.id if isinstance(owner, ast.Name) else ""
                    if node.func.attr == "savefig" and writes_to_memory(node, path):
                        continue
                    if name != "files":
                        wrong.append(f"{path.relative_to(ROOT)}:{node.lineno} {node.func.attr}")
                if isinstance(node.func, ast.Name) and node.func.id == "open":
                    modes = [a.value for a in node.args[1:2] if isinstance(a, ast.Constant)]
                    if any(set(str(m)) & set("wax+") for m in modes):
                        wrong.append(f"{path.relative_to(ROOT)}:{node.lineno} open")
    assert wrong == []


def writes_to_memory(call: ast.Call, path: Path) -> bool:
    """Tell whether the target of a call is a buffer made in the same file."""
    buffers = {
        target.id
        for node in nodes(path)
        if isinstance(node, ast.Assign)
        and isinstance(node.value, ast.Call)
        and isinstance(node.value.func, ast.Name)
        and node.value.func.id == "BytesIO"
        for target in node.targets
        if isinstance(target, ast.Name)
    }
    return bool(call.args) and isinstance(call.args[0], ast.Name) and call.args[0].id in buffers


def test_nothing_loads_code_or_pickles_from_data() -> None:
    names = {"pickle", "yaml", "dill", "shelve", "marshal"}
    wrong = [
        f"{path.relative_to(ROOT)} imports {name}"
        for package in PACKAGES
        for path in sources(package)
        for name in imported_modules(path)
        if name.split(".")[0] in names
    ]
    for package in PACKAGES:
        for path in sources(package):
            for node in nodes(path):
                is_call = isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
                if is_call and node.func.id in {"eval", "exec"}:
                    wrong.append(f"{path.relative_to(ROOT)}:{node.lineno} {node.func.id}")
                if isinstance(node, ast.keyword) and node.arg == "allow_pickle":
                    wrong.append(f"{path.relative_to(ROOT)} allow_pickle")
    assert wrong == []

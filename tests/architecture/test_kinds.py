"""Verbs ask the kinds of experiment and name none; the thesis's figures lie beneath nothing."""

import ast
from pathlib import Path

import pytest

from pipelines.experiments import KINDS
from tests.architecture.test_layers import FRONT_DOOR, ROOT, imported_modules, nodes, sources

PACKAGES = ("labpipe", "instruments", "calibration", "pipelines")
ROOM = ROOT / "pipelines/experiments"
MAY_NAME_KINDS = tuple(ROOT / "pipelines" / name for name in ("rig", "figures", "bench"))
ROOMS = {name: f"pipelines.experiments.{name}" for name in KINDS}


PHYSICS = tuple(ROOT / "labpipe" / name for name in ("signals", "imaging", "materials", "contact", "identification"))
"""A relaxation and a harmonic are phenomena there, before they are kinds of experiment."""


def verbs(package: str) -> list[Path]:
    """Return the modules that must not know which kinds there are."""
    rooms = (*MAY_NAME_KINDS, *PHYSICS, *(ROOM / name for name in KINDS))
    return [p for p in sources(package) if not any(room in p.parents for room in rooms)]


@pytest.mark.parametrize("package", PACKAGES)
def test_no_module_outside_its_room_names_a_kind(package: str) -> None:
    found = [
        f"{path.relative_to(ROOT)}:{node.lineno} {node.value}"
        for path in verbs(package)
        for node in nodes(path)
        if isinstance(node, ast.Constant) and node.value in KINDS
    ]
    assert found == []


def test_only_the_registry_and_its_own_room_import_from_a_kind() -> None:
    found = [
        f"{path.relative_to(ROOT)} imports {module}"
        for path in verbs("pipelines")
        if path != ROOM / "_registry.py"
        for module in imported_modules(path)
        for home in ROOMS.values()
        if module == home or module.startswith(f"{home}.")
    ]
    assert found == []


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_a_kind_imports_from_no_other(kind: str) -> None:
    others = [home for name, home in ROOMS.items() if name != kind]
    found = [
        f"{path.relative_to(ROOT)} imports {module}"
        for path in (ROOM / kind).rglob("*.py")
        for module in imported_modules(path)
        if any(module.startswith(f"{home}.") for home in others)
    ]
    assert found == []


def test_every_room_is_that_of_a_kind() -> None:
    rooms = {path.name for path in ROOM.iterdir() if (path / "kind.py").is_file()}
    assert rooms == set(KINDS)
    assert {path.name for path in ROOM.iterdir() if path.is_dir()} - rooms <= {"shared", "__pycache__"}


def test_figures_lie_beneath_nothing() -> None:
    figures = ROOT / "pipelines/figures"
    above = {figures, ROOT / "pipelines/commands"}
    found = [
        f"{path.relative_to(ROOT)} imports {module}"
        for package in PACKAGES
        for path in sources(package)
        if not above & set(path.parents) and path != FRONT_DOOR
        for module in imported_modules(path)
        if module.startswith("pipelines.figures")
    ]
    assert found == []

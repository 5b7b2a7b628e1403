"""The mutator changes what is computed, one place at a time, and nothing else."""

import ast
import os
from pathlib import Path

import pytest

from tests.faults.crashes import child_result
from tests.faults.mutants import mutants
from tests.faults.mutation import CORE, _Spoilt, is_compiled, sample

SOURCE = '''"""A text that says 1 + 1."""
LIMIT: float = 2.0

def first(values: list[int], count: int = 3) -> float:
    """Return 1."""
    if count <= 0 or not values:
        message = f"found {count + 1}"
        raise ValueError(message)
    return sum(values[1:count]) / LIMIT
'''


def test_every_kind_of_change_is_made_where_something_is_computed() -> None:
    found = {mutant.told(SOURCE).split(" ", 1)[1] for mutant in mutants("m.py", SOURCE)}
    assert found == {
        "constant: 2.0 -> 3.0",
        "constant: 3 -> 4",
        "constant: 0 -> 1",
        "constant: 1 -> 2",
        "comparison: count <= 0 -> (count < 0)",
        "comparison: count <= 0 -> (count > 0)",
        "boolean: count <= 0 or not values -> (count <= 0 and (not values))",
        "negation: not values -> (values)",
        "arithmetic: sum(values[1:count]) / LIMIT -> (sum(values[1:count]) * LIMIT)",
        "slice: 1:count -> 1 + 1:count",
        "slice: 1:count -> 1:count - 1",
        "return: return sum(values[1:count]) / LIMIT -> return None",
    }


def test_every_mutant_is_another_program() -> None:
    for path in ("labpipe/signals/_metrics.py", "labpipe/contact/sphere/hertz.py"):
        source = (Path(__file__).parents[2] / path).read_text("utf-8")
        plain = ast.dump(ast.parse(source))
        for mutant in mutants(path, source)[::20]:
            assert ast.dump(ast.parse(mutant.applied(source))) != plain, mutant.told(source)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_spoilt_module_is_imported_in_a_child_and_its_file_is_left_alone(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    path = tmp_path / "computes.py"
    path.write_text(SOURCE)
    monkeypatch.syspath_prepend(tmp_path)
    (mutant,) = [m for m in mutants(str(path), SOURCE) if m.kind == "arithmetic"]

    def spoilt() -> str:
        import sys

        sys.meta_path.insert(0, _Spoilt("computes", path, mutant.applied(SOURCE)))
        return str(__import__("computes").first([1, 2, 3]))

    def plain() -> str:
        return str(__import__("computes").first([1, 2, 3]))

    assert child_result(spoilt) == "10.0"
    assert child_result(plain) == "2.5"
    assert path.read_text() == SOURCE


def test_the_sample_is_the_same_every_time_and_of_the_whole_core(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(Path(__file__).parents[2])
    monkeypatch.setattr("tests.faults.mutation.CORE", ("calibration",))
    assert sample(20) == sample(20)
    assert len({mutant.module for mutant, _ in sample(100)}) > 4
    assert is_compiled(Path("labpipe/imaging/dic/_kernels.py").read_text("utf-8"))
    assert not is_compiled(Path("labpipe/contact/sphere/hertz.py").read_text("utf-8"))
    assert all(Path(folder).is_dir() for folder in CORE)

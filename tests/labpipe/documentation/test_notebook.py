"""The example notebook is whole, executed, and shows what it would show today."""

import re
from pathlib import Path

import pytest

from tests.labpipe.documentation.notebook import execute, load

NUMBER = re.compile(r"\d+\.\d+")


def texts(notebook: dict) -> list[str]:
    return [
        "".join(output.get("text", output.get("data", {}).get("text/plain", "")))
        for cell in notebook["cells"]
        for output in cell.get("outputs", [])
    ]


def test_it_is_a_notebook_of_executed_cells() -> None:
    found = load()
    assert (found["nbformat"], found["nbformat_minor"]) == (4, 5)
    code = [cell for cell in found["cells"] if cell["cell_type"] == "code"]
    assert len({cell["id"] for cell in found["cells"]}) == len(found["cells"])
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    assert all(cell["outputs"] for cell in code)
    kinds = {kind for cell in code for o in cell["outputs"] for kind in o.get("data", {})}
    assert kinds == {"text/html", "text/plain", "image/png"}
    assert not re.search(r"/(tmp|home|root|work)/", str(found))


@pytest.mark.slow
def test_executed_again_it_says_the_same(tmp_path: Path) -> None:
    """Numbers are equal to what is printed, up to the last digit; everything else exactly."""
    kept = texts(load())
    now = texts(execute(load(), tmp_path))
    assert [NUMBER.sub("#", text) for text in now] == [NUMBER.sub("#", text) for text in kept]
    for old, new in zip(kept, now, strict=True):
        for a, b in zip(NUMBER.findall(old), NUMBER.findall(new), strict=True):
            last_digit = 10.0 ** -len(a.partition(".")[2])
            assert abs(float(a) - float(b)) <= 1.5 * last_digit, (old, new)

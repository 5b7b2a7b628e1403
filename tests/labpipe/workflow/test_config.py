"""Mistakes of a configuration, all at once, each on its line, with what to write instead."""

import datetime
import math
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import pytest
from hypothesis import given, settings, strategies as st

from labpipe.errors import ConfigError
from labpipe.units import Quantity, quantity
from labpipe.workflow import config, fields
from labpipe.workflow.fields import POSITIVE, Angle, Dimensionless, File, Length, Range, Time


class Inner(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    radius: Annotated[Length, POSITIVE] = Quantity(0.001, 0.0, "m")
    name: str = ""


class Everything(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    inner: Inner = Inner()
    length: Length | None = None
    angle: Angle | Literal["auto"] = "auto"
    window: Annotated[Time, Range(above=0.0, at_most=1.0)] | None = None
    poisson: Annotated[Dimensionless, Range(at_least=0.0, below=0.5)] | None = None
    count: Annotated[int, msgspec.Meta(ge=1, le=10)] = 1
    rtol: Annotated[float, Range(above=0.0, at_most=0.01)] = 1e-4
    solver: Literal["mdr", "rings"] = "mdr"
    direction: Literal[1, -1] = 1
    switch: bool = False
    files: list[File] = []
    pair: tuple[Length, Length] | None = None
    corners: Annotated[list[tuple[int, int]], msgspec.Meta(description="places, [[x, y], [x, y]]")] | None = None
    table: dict[str, Length] = {}
    day: datetime.date | None = None
    other: fields.ExperimentName | None = None


def read(folder: Path, text: str) -> Everything:
    (folder / "c.toml").write_text(text)
    return config.read(folder / "c.toml", Everything)


def test_units_become_si(tmp_path: Path) -> None:
    found = read(
        tmp_path,
        'length = "9.525 mm"\nangle = "12.0 ± 0.2 deg"\npoisson = 0.35\nwindow = "20 ms"\n'
        'pair = ["1 um", "2 um"]\ntable = { a = "3 cm" }\nday = 2026-01-31\nother = "drop"\n'
        'inner.radius = "5 mm"',
    )
    assert found.length == quantity("9.525 mm")
    assert isinstance(found.angle, Quantity)
    assert found.angle.si == "rad"
    assert found.angle[:2] == pytest.approx((math.radians(12), math.radians(0.2)))
    assert found.poisson == Quantity(0.35, 0.0, "1")
    assert found.pair == (quantity("1 um"), quantity("2 um"))
    assert found.table == {"a": quantity("3 cm")}
    assert found.day == datetime.date(2026, 1, 31)
    assert found.other == "experiment:drop"
    assert found.inner.radius == quantity("5 mm")


WRONG = {
    'length = "3 furlong"': 'expected a length .*, found "3 furlong"',
    'length = "1e999 mm"': "which is not finite",
    'angle = "atuo"': 'expected an angle .* or one of "auto", found "atuo"',
    'window = "2 s"': "must be > 0 and <= 1 s, found 2 s",
    f"count = {10**300}": r"found 10{59}…",
    'switch = "yes"': 'expected true or false, found "yes"',
    "corners = [1, 2]": r"corners no. 1: expected a list in brackets, each a whole number, found 1",
    "files = ['../x']": r'contains "\.\."',
    "files = ['data.csv', 'data.csv']": 'files no. 2: "data.csv" is listed twice',
    'pair = ["1 mm"]': "expected 2 items, found 1",
    "inner.raduis = 3": 'inner.raduis: unknown key; did you mean "radius"',
}


@pytest.mark.parametrize(("line", "says"), WRONG.items(), ids=[k[:40] for k in WRONG])
def test_a_mistake_is_named_on_its_line(tmp_path: Path, line: str, says: str) -> None:
    (tmp_path / "data.csv").write_text("1")
    with pytest.raises(ConfigError, match=says) as caught:
        read(tmp_path, f"# first line\n\n{line}\n")
    assert all(problem.startswith("c.toml:3: ") for problem in caught.value.problems)
    assert caught.value.exit_code == 3


def test_all_mistakes_are_reported_at_once_in_the_order_of_lines(tmp_path: Path) -> None:
    chosen = list({line.split(" ")[0].partition(".")[0]: line for line in WRONG}.values())
    with pytest.raises(ConfigError) as caught:
        read(tmp_path, "\n".join(chosen))
    numbers = [int(problem.split(":")[1]) for problem in caught.value.problems]
    assert numbers == sorted(numbers)
    assert set(numbers) == set(range(1, len(chosen) + 1))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[a]\n[b]\n[a]\n", r"c\.toml:3:3: a key or table is given twice"),
        ("x = 1\n\x00", r"c\.toml:2:"),
        ("a = " + "[" * 20_000, r"cannot be read as TOML"),
        ("a = " + "[" * 60 + "]" * 60, "deeper than 32 levels"),
        ("a" + ".a" * 5000 + " = 1", "deeper than 32 levels"),
        ("# " + "x" * 1_000_001, "1000003 bytes long"),
    ],
)
def test_what_is_not_a_reasonable_toml_file_is_refused(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        read(tmp_path, text)


TEXTS = st.sampled_from(["", "9 mm", "1e999 mm", "2 ± x s", "FILL m", "../x", "auto", "\0é"])

LEAVES = st.none() | st.booleans() | st.integers() | st.floats() | TEXTS
KEYS = st.sampled_from(["radius", "name", "a"])
TREES = st.recursive(LEAVES, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner), max_leaves=5)


@settings(max_examples=40, deadline=None)
@given(st.dictionaries(st.sampled_from(list(Everything.__struct_fields__)), TREES))
def test_no_tree_of_values_escapes_the_check(tree: dict[str, object]) -> None:
    document = config.Document(Path("c.toml"), tree, {(): 1})
    found = config.Checker(document, Path("/nowhere")).value(Everything, tree, ())
    assert isinstance(found, Everything) or document.problems

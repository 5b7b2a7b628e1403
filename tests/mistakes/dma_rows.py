"""Mistakes with a rheometer and its exports: the edit, and what must be said."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from labpipe import files
from pipelines.rig.dma import Protocol, write_dma
from pipelines.rig.session_text import dma_section, session_head
from pipelines.rig.solids import SOLIDS
from tests.mistakes.recordings import Edit, setting
from tests.mistakes.rows import Mistake

FIRST, SECOND, TOML = "dma/acrylic.csv", "dma/acrylic_2.csv", "session.toml"
_CODE = "utf-16"
_POINTS = 9
_PROTOCOL = Protocol(
    temperatures=(-40.0, -20.0, 0.0, 20.0, 40.0),
    frequencies=tuple(np.geomspace(10.0, 0.1, 9).tolist()),
    ramp=(0.0, 5.0),
)
_HEATED = Protocol(
    temperatures=(-20.0, 0.0, 10.0, 20.0, 30.0, 40.0, 60.0),
    frequencies=tuple(np.geomspace(20.0, 0.2, _POINTS).tolist()),
    ramp=tuple(np.arange(-20.0, 61.0, 4.0).tolist()),
)
"""Closer isotherms, and a temperature sweep whose readings wait for the heat."""
_CLOSE = Protocol(
    temperatures=tuple(np.arange(-30.0, 71.0, 10.0).tolist()),
    frequencies=tuple(np.geomspace(20.0, 0.2, _POINTS).tolist()),
    ramp=(0.0, 5.0),
)
"""Isotherms that overlap."""
TIME, T, OMEGA, STORAGE, LOSS, FACTOR, STRAIN, STRESS = range(2, 10)
"""Cells of a row; the first is empty, the second its number."""

Change = Callable[[list[str], int, int], list[str]]
"""Takes the cells of a row, its interval and its point, from 0, and returns the cells."""


def write(folder: Path) -> Path:
    """Write the clean session: five isotherms of two specimens of acrylic."""
    solid = SOLIDS["acrylic"]
    text = session_head("Mistakes (synthetic)") + dma_section("acrylic", FIRST, solid)
    for name, seed in ((FIRST, 3), (SECOND, 8)):
        assert write_dma(folder, Path(name).stem, solid, _PROTOCOL, seed) == name
    files.write_text(folder / TOML, text.replace(f'["{FIRST}"]', f'["{FIRST}", "{SECOND}"]'))
    return folder


def _rewritten(change: Callable[[str], str], name: str = FIRST) -> Edit:
    def edit(folder: Path) -> None:
        text = (folder / name).read_text(_CODE)
        other = change(text)
        assert other != text
        (folder / name).write_text(other, _CODE)

    return edit


def _rows(change: Change, name: str = FIRST) -> Edit:
    def changed(text: str) -> str:
        lines, number = text.split("\n"), 0
        for i, line in enumerate(lines):
            cells = line.split("\t")
            if len(cells) > STRESS and cells[1].isdigit():
                lines[i] = "\t".join(change(cells, number // _POINTS, number % _POINTS))
                number += 1
        return "\n".join(lines)

    return _rewritten(changed, name)


def _scaled(
    column: int, factor: float, offset: float = 0.0, interval: int | None = None, point: int | None = None
) -> Edit:
    """Change a column: everywhere, in one interval, or in one row."""

    def change(cells: list[str], i: int, p: int) -> list[str]:
        if interval in (None, i) and point in (None, p):
            cells[column] = f"{float(cells[column]) * factor + offset:.6g}"
        return cells

    return _rows(change)


def _put(column: int, text: str, interval: int | None = None, point: int | None = None) -> Edit:
    def change(cells: list[str], i: int, p: int) -> list[str]:
        if interval in (None, i) and point in (None, p):
            cells[column] = text
        return cells

    return _rows(change)


def _exchanged(a: int, b: int, interval: int | None = None) -> Edit:
    def change(cells: list[str], i: int, p: int) -> list[str]:
        del p
        if interval in (None, i):
            cells[a], cells[b] = cells[b], cells[a]
        return cells

    return _rows(change)


def _pasted(source: int, target: int) -> Edit:
    """Copy the moduli of one interval into another."""
    kept: dict[int, list[str]] = {}

    def change(cells: list[str], i: int, p: int) -> list[str]:
        if i == source:
            kept[p] = cells[STORAGE : FACTOR + 1]
        return cells[:STORAGE] + kept[p] + cells[FACTOR + 1 :] if i == target else cells

    return _rows(change)


def _twice_the_loss(cells: list[str], i: int, p: int) -> list[str]:
    """Double the loss modulus of one interval, and the loss factor with it."""
    del p
    for column in (LOSS, FACTOR) if i == 3 else ():
        cells[column] = f"{2 * float(cells[column]):.5g}"
    return cells


def _with_frequency(cells: list[str], point: int) -> list[str]:
    cells[OMEGA] = f"{2 * np.pi * _PROTOCOL.frequencies[point]:.6g}"
    return cells


def _warmer(cells: list[str], by: float) -> list[str]:
    cells[T] = f"{float(cells[T]) + by:.2f}"
    return cells


def _sweep_in_fahrenheit(cells: list[str], i: int, p: int) -> list[str]:
    del p
    if i >= len(_HEATED.temperatures):
        cells[T] = f"{float(cells[T]) * 1.8 + 32:.2f}"
    return cells


def _label(old: str, new: str, count: int = -1) -> Edit:
    return _rewritten(lambda text: text.replace(old, new, count))


def _exported(protocol: Protocol) -> Edit:
    """Write the first export anew, by another protocol."""

    def edit(folder: Path) -> None:
        name = write_dma(folder / "other", Path(FIRST).stem, SOLIDS["acrylic"], protocol, 5)
        (folder / FIRST).write_bytes((folder / "other" / name).read_bytes())

    return edit


def _both(*edits: Edit) -> Edit:
    def edit(folder: Path) -> None:
        for one in edits:
            one(folder)

    return edit


def _copied(folder: Path) -> None:
    (folder / SECOND).write_bytes((folder / FIRST).read_bytes())


def _copied_with_other_ends(folder: Path) -> None:
    text = (folder / FIRST).read_text(_CODE)
    (folder / SECOND).write_text(text.replace("acrylic (synthetic)", "second specimen"), _CODE)


def _of(material: str) -> Edit:
    def edit(folder: Path) -> None:
        name = write_dma(folder / "other", material, SOLIDS[material], _PROTOCOL, 5)
        (folder / SECOND).write_bytes((folder / "other" / name).read_bytes())

    return edit


def _short(cells: list[str], i: int, p: int) -> list[str]:
    return cells[:LOSS] if (i, p) == (1, 4) else cells


def _shifted(cells: list[str], i: int, p: int) -> list[str]:
    """Lose one cell, so that all behind it stand one column to the left."""
    return [*cells[:STORAGE], *cells[STORAGE + 1 :], ""] if (i, p) == (2, 3) else cells


def _swapped_intervals(cells: list[str], i: int, p: int) -> list[str]:
    del p
    shift = {1: 40.0, 3: -40.0}.get(i, 0.0)
    cells[T] = f"{float(cells[T]) + shift:.6g}"
    return cells


def _slips(cells: list[str], i: int, p: int) -> list[str]:
    """Let all moduli be less from the fourth interval on."""
    del p
    if i >= 3:
        for column in (STORAGE, LOSS, STRESS):
            cells[column] = f"{float(cells[column]) * 0.72:.6g}"
    return cells


def _cooling(cells: list[str], i: int, p: int) -> list[str]:
    """Let the third interval begin too warm."""
    return _warmer(cells, 6.0 * (1 - p / _POINTS)) if i == 2 else cells


def _cut(text: str) -> str:
    return text[: text.index("\t5\t", text.index("points:\t4"))]


def _as_table(times: float, heading: str = "frequency [Hz]", *, with_time: bool = True) -> Edit:
    """Write the exports as plain tables, with so many times the frequency in Hz under a heading."""

    def edit(folder: Path) -> None:
        for name in (FIRST, SECOND):
            found = ["time [s]," * with_time + f"temperature [°C],{heading},storage modulus [MPa],loss modulus [MPa]"]
            for line in (folder / name).read_text(_CODE).split("\n"):
                cells = line.split("\t")
                if len(cells) > STRESS and cells[1].isdigit():
                    hertz = f"{times * float(cells[OMEGA]) / (2 * np.pi):.6g}"
                    found.append(",".join([cells[TIME]] * with_time + [cells[T], hertz, cells[STORAGE], cells[LOSS]]))
            (folder / name).write_text("\n".join(found) + "\n", "utf-8")

    return edit


def _rubber(folder: Path) -> None:
    """Let both exports be of a rubber, beside the Poisson's ratio of a glass."""
    for name, seed in ((FIRST, 3), (SECOND, 8)):
        made = write_dma(folder / "other", Path(name).stem, SOLIDS["nbr"], _HEATED, seed)
        (folder / name).write_bytes((folder / "other" / made).read_bytes())


ROWS = (
    Mistake("moduli of an interval pasted into the next", _pasted(2, 3), "impossible", ("digit by digit",), FIRST),
    Mistake("loss twice in one interval", _rows(_twice_the_loss, SECOND), "doubtful", ("interval 4", "loss"), SECOND),
    Mistake(
        "second file six degrees too warm",
        _rows(lambda cells, i, p: _warmer(cells, 6.0), SECOND),
        "doubtful",
        ("temperature of one of the two files is off by 6 K",),
        SECOND,
    ),
    # columns
    Mistake("storage and loss swapped", _exchanged(STORAGE, LOSS), "impossible", ("exchanged",), FIRST),
    Mistake("storage and loss swapped in one interval", _exchanged(STORAGE, LOSS, 2), "impossible", (), FIRST),
    Mistake(
        "temperature and frequency swapped", _exchanged(T, OMEGA), "impossible", ("under the name of the frequency",)
    ),
    Mistake("loss factor in percent", _scaled(FACTOR, 100.0), "impossible", ("factor 100",), FIRST),
    Mistake(
        "strain ten times in one interval", _scaled(STRAIN, 10.0, 0.0, 2), "doubtful", ("interval 3", "strain"), FIRST
    ),
    Mistake("loss factor is another test's", _scaled(FACTOR, 1.3), "impossible", ("loss factor",), FIRST),
    Mistake("negative losses", _scaled(LOSS, -1.0), "impossible", (), FIRST),
    Mistake("no losses", _put(LOSS, "0"), "impossible"),
    Mistake("storage doubled", _scaled(STORAGE, 2.0), "impossible", ("loss factor",), FIRST),
    # units
    Mistake("MPa labelled Pa", _label("[MPa]", "[Pa]"), "impossible", ("MPa",), FIRST),
    Mistake("MPa labelled GPa", _label("[MPa]", "[GPa]"), "impossible", (), FIRST),
    Mistake("MPa labelled kPa", _label("[MPa]", "[kPa]"), "impossible", (), FIRST),
    Mistake("loss alone labelled Pa", _label("[MPa]\t[1]", "[Pa]\t[1]"), "impossible", ("unit",), FIRST),
    Mistake("stress in MPa labelled kPa", _label("[kPa]", "[MPa]"), "impossible", ("stress",), FIRST),
    Mistake("strain in % labelled 1", _label("[%]", "[1]"), "impossible", ("stress",), FIRST),
    Mistake("kelvins under degrees", _scaled(T, 1.0, 273.15), "impossible", ("in K",), FIRST),
    Mistake("fahrenheit under degrees", _scaled(T, 1.8, 32.0), "doubtful", ("in °F",), FIRST),
    Mistake(
        "fahrenheit in a temperature sweep beside isotherms",
        _both(_exported(_HEATED), _rows(_sweep_in_fahrenheit)),
        "doubtful",
        ("temperature sweep", "°F under °C"),
        FIRST,
    ),
    Mistake("degrees labelled K", _label("[°C]", "[K]"), "impossible", (), FIRST),
    Mistake("hertz under radians", _scaled(OMEGA, 1 / (2 * np.pi)), "doubtful", ("Hz under rad/s",), FIRST),
    Mistake(
        "hertz under radians beside a long temperature sweep",
        _both(_exported(_HEATED), _scaled(OMEGA, 1 / (2 * np.pi))),
        "doubtful",
        ("Hz under rad/s", "interval"),
        FIRST,
    ),
    Mistake("turns per minute under radians", _scaled(OMEGA, 30 / np.pi), "impossible", ("turns per minute", "9.549")),
    *(
        Mistake(f"plain table, {word}", _as_table(*how, with_time=timed), "doubtful", said, FIRST)
        for word, how, timed, said in (
            ("turns per minute under Hz", (60.0,), True, ("turns per minute",)),
            ("turns per minute under Hz, no times", (60.0,), False, ("turns per minute", "60 times round")),
            ("mHz under Hz", (1e3,), True, ("mHz",)),
            ("radians under Hz", (2 * np.pi,), False, ("rad/s under Hz",)),
            ("hertz under radians", (1.0, "angular frequency [rad/s]"), True, ("Hz under rad/s",)),
        )
    ),
    Mistake("one frequency in all rows", _put(OMEGA, "6.2832"), "doubtful", ("holds one value",), FIRST),
    Mistake("radians labelled Hz", _label("[rad/s]", "[Hz]"), "doubtful", ("Hz",), FIRST),
    Mistake(
        "decimal point of one time lost", _put(TIME, "30147", 1, 4), "note", ("point 5", "its time", "mistyped"), FIRST
    ),
    Mistake("time in min labelled s", _scaled(TIME, 1 / 60), "doubtful", ("time",), FIRST),
    # one value, one row
    *(
        Mistake(f"one {word} x1000", _scaled(column, 1e3, 0.0, i, p), "impossible", ("1000",), FIRST)
        for word, column, i, p in (
            ("storage modulus", STORAGE, 1, 4),
            ("loss modulus", LOSS, 3, 0),
            ("storage modulus at the end", STORAGE, 4, 8),
        )
    ),
    Mistake("decimal point lost in one value", _scaled(STORAGE, 10.0, 0.0, 2, 5), "impossible", ("10",), FIRST),
    Mistake("decimal point lost in one loss factor", _scaled(FACTOR, 10.0, 0.0, 2, 5), "impossible", ("10",), FIRST),
    Mistake("one row 30 K off", _scaled(T, 1.0, 30.0, 1, 4), "doubtful", ("interval 2, point 5", "30.0 K"), FIRST),
    Mistake("last cells of a row lost", _rows(_short), "impossible", ("a cell is missing",), FIRST),
    Mistake("cells shifted to the left", _rows(_shifted), "impossible", (), FIRST),
    Mistake("cut in an interval", _rewritten(_cut), "doubtful", ("declares 9 points and holds 4",), FIRST, 49),
    # intervals
    Mistake("one interval 30 K too high", _scaled(T, 1.0, 30.0, 2), "impossible", ("interval 3",), FIRST),
    Mistake("two intervals exchanged", _rows(_swapped_intervals), "doubtful", ("wrong order",), FIRST),
    Mistake(
        "one interval 20 K too high, where the modulus hardly depends on it",
        _both(_exported(_HEATED), _scaled(T, 1.0, 20.0, 3)),
        "doubtful",
        ("interval 4", "differ by a factor", "temperature"),
        FIRST,
    ),
    Mistake("constant temperature", _put(T, "20"), "impossible", ("constant",), FIRST),
    Mistake(
        "one interval slipped",
        _both(*(_scaled(c, 0.2, 0.0, 3) for c in (STORAGE, LOSS, STRESS))),
        "impossible",
        (),
        FIRST,
    ),
    # files
    Mistake("same file twice", _copied, "doubtful", ("same",), SECOND),
    Mistake("same values under another title", _copied_with_other_ends, "doubtful", ("same values",), SECOND),
    Mistake("second file of PTFE", _of("ptfe"), "doubtful", ("another material",), SECOND),
    Mistake("second file of NBR", _of("nbr"), "impossible", ("another material",), SECOND),
    # what the session states
    Mistake(
        "specimen slipped in its clamp",
        _both(_exported(_CLOSE), _rows(_slips)),
        "doubtful",
        ("interval 4", "slipped"),
        FIRST,
    ),
    Mistake("specimen still cooling", _rows(_cooling), "doubtful", ("interval 3", "still warming or cooling"), FIRST),
    Mistake("nu 0.035", setting('nu = "0.35 ± 0.01"', 'nu = "0.035"'), "doubtful", ("decimal point",), TOML, "nu"),
    Mistake("nu 0.05", setting('nu = "0.35 ± 0.01"', 'nu = "0.05"'), "doubtful", ("nu",), TOML, "nu"),
    Mistake("nu of a rubber", setting('nu = "0.35 ± 0.01"', 'nu = "0.50 ± 0.01"'), "doubtful", ("rubber",), TOML, "nu"),
    Mistake("scale 10", setting('"1.000 ± 0.010"', '"10.00 ± 0.10"'), "doubtful", ("decimal point",), TOML, "scale"),
    Mistake(
        "T_ref with a slipped decimal",
        setting('"20.042 degC"', '"200.42 degC"'),
        "doubtful",
        ("T_ref is wrong", "200.42"),
        TOML,
        "T_ref",
    ),
    Mistake("tension for torsion", setting('"torsion"', '"tension"'), "doubtful", ("not tension",), TOML, "mode"),
    Mistake("bending for torsion", setting('"torsion"', '"bending"'), "doubtful", ("not bending",), TOML, "mode"),
    Mistake(
        "reference of 200 degrees", setting('"20.042 degC"', '"200.42 degC"'), "doubtful", ("T_ref",), TOML, "T_ref"
    ),
    Mistake(
        "frequencies of one interval reversed",
        _rows(lambda cells, i, p: _with_frequency(cells, _POINTS - 1 - p) if i == 1 else cells),
        "doubtful",
        ("interval", "opposite order"),
        FIRST,
    ),
    Mistake(
        "the warmer isotherms in kelvin",
        _rows(lambda cells, i, p: _warmer(cells, 273.15) if i > 2 else cells),
        "doubtful",
        ("in k under °c", "20.2 °c and more are meant"),
        FIRST,
    ),
    Mistake("nu of a glass in a rubber", _rubber, "doubtful", ("nu is that of a glass",), TOML, "nu"),
)

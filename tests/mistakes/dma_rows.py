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


def write_temperatures(folder: Path) -> Path:
    """Write nine isotherms and a temperature sweep of one specimen."""
    solid, temperatures = SOLIDS["acrylic"], tuple(np.arange(-40.0, 41.0, 10.0).tolist())
    protocol = Protocol(temperatures=temperatures, frequencies=_PROTOCOL.frequencies)
    write_dma(folder, "acrylic", solid, protocol, 4)
    files.write_text(folder / TOML, session_head("Mistakes (synthetic)") + dma_section("acrylic", FIRST, solid))
    return folder


def _clamped_anew(cells: list[str], i: int, p: int) -> list[str]:
    """Enlarge moduli and stress of the frequency sweeps from the sixth on; the temperature sweep follows them."""
    del p
    if 5 <= i < 9:
        for column in (STORAGE, LOSS, STRESS):
            cells[column] = f"{1.15 * float(cells[column]):.6g}"
    return cells


def _pasted() -> Change:
    """Put the values of the fifth sweep into the sixth as well."""
    kept = dict[int, list[str]]()

    def pasted(cells: list[str], i: int, p: int) -> list[str]:
        if i == 4:
            kept[p] = cells[STORAGE:]
        return [*cells[:STORAGE], *kept[p]] if i == 5 else cells

    return pasted


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


def _constant_temperature(cells: list[str], i: int, p: int) -> list[str]:
    del i, p
    cells[T] = "20"
    return cells


def _exchanged(cells: list[str], i: int, p: int) -> list[str]:
    """Exchange the two moduli of a row."""
    del i, p
    cells[STORAGE], cells[LOSS] = cells[LOSS], cells[STORAGE]
    return cells


def _reversed(cells: list[str], i: int, p: int) -> list[str]:
    """Let the loss factor of a row agree with its moduli, and the frequency go the other way in one interval."""
    del p
    if i == 1:
        cells[OMEGA] = f"{10.0 / float(cells[OMEGA]):.6g}"
    return cells


def _label(old: str, new: str, count: int = -1) -> Edit:
    return _rewritten(lambda text: text.replace(old, new, count))


def _copied(folder: Path) -> None:
    (folder / SECOND).write_bytes((folder / FIRST).read_bytes())


def _of(material: str) -> Edit:
    def edit(folder: Path) -> None:
        name = write_dma(folder / "other", material, SOLIDS[material], _PROTOCOL, 5)
        (folder / SECOND).write_bytes((folder / "other" / name).read_bytes())

    return edit


def _as_table(times: float) -> Edit:
    """Write the exports as plain tables, with so many times the frequency in Hz."""

    def edit(folder: Path) -> None:
        for name in (FIRST, SECOND):
            found = ["temperature [°C],frequency [Hz],storage modulus [MPa],loss modulus [MPa]"]
            for line in (folder / name).read_text(_CODE).split("\n"):
                cells = line.split("\t")
                if len(cells) > STRESS and cells[1].isdigit():
                    hertz = f"{times * float(cells[OMEGA]) / (2 * np.pi):.6g}"
                    found.append(",".join([cells[T], hertz, cells[STORAGE], cells[LOSS]]))
            (folder / name).write_text("\n".join(found) + "\n", "utf-8")

    return edit


ROWS = (
    # columns
    Mistake("storage and loss swapped", _rows(_exchanged), "impossible", ("exchanged",), FIRST),
    Mistake("negative losses", _scaled(LOSS, -1.0), "impossible", (), FIRST),
    # units
    Mistake("MPa labelled Pa", _label("[MPa]", "[Pa]"), "impossible", ("MPa",), FIRST),
    Mistake("kelvins under degrees", _scaled(T, 1.0, 273.15), "impossible", ("in K",), FIRST),
    Mistake("fahrenheit under degrees", _scaled(T, 1.8, 32.0), "doubtful", ("in °F",), FIRST),
    Mistake("hertz under radians", _scaled(OMEGA, 1 / (2 * np.pi)), "doubtful", ("Hz under rad/s",), FIRST),
    Mistake("plain table, rad/s under Hz", _as_table(2 * np.pi), "doubtful", ("rad/s under Hz",), FIRST),
    # one value, one row
    Mistake("one storage modulus x1000", _scaled(STORAGE, 1e3, 0.0, 1, 4), "impossible", ("1000",), FIRST),
    Mistake("decimal point lost in one value", _scaled(STORAGE, 10.0, 0.0, 2, 5), "impossible", ("10",), FIRST),
    Mistake("one storage modulus mistyped", _scaled(STORAGE, 1.3, 0.0, 1, 4), "doubtful", ("row is mistyped",), FIRST),
    # intervals
    Mistake("frequencies reversed in one", _rows(_reversed), "impossible", ("interval 2", "reverse order"), FIRST),
    Mistake("one interval 30 K too high", _scaled(T, 1.0, 30.0, 2), "impossible", ("interval 3",), FIRST),
    Mistake("constant temperature", _rows(_constant_temperature), "impossible", ("constant",), FIRST),
    # files
    Mistake("file cut", _rewritten(lambda text: text[: text.rindex("\t6\t")]), "doubtful", ("copy it again",), FIRST),
    Mistake("same file twice", _copied, "doubtful", ("same",), SECOND),
    Mistake("second file of PTFE", _of("ptfe"), "doubtful", ("another material",), SECOND),
    # what the session states
    Mistake("nu 0.035", setting('nu = "0.35 ± 0.01"', 'nu = "0.035"'), "doubtful", ("decimal point",), TOML, "nu"),
    Mistake("tension for torsion", setting('"torsion"', '"tension"'), "doubtful", ("not tension",), TOML, "mode"),
)

TEMPERATURE_ROWS = (
    Mistake("clamped anew", _rows(_clamped_anew), "doubtful", ("interval 6", "factor 1.1"), FIRST),
    Mistake("one sweep pasted over another", _rows(_pasted()), "doubtful", ("hold the same moduli",), FIRST),
    Mistake("label 10 K too low", _scaled(T, 1.0, -10.0, 5), "doubtful", ("interval 6", "not 0.2 °C"), FIRST),
)

"""Mistakes with a Mach-1 tester, in an oscillation and in relaxation tests: edits and what must be said."""

import re
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import numpy as np

from labpipe import files, materials
from pipelines.rig.indentations import (
    TESTER,
    Harmonic,
    Relaxation,
    Specimen,
    oscillation_section,
    relaxation_section,
    write_harmonic,
    write_relaxation,
)
from pipelines.rig.session_text import cell_record, session_head
from tests.mistakes.recordings import Edit, setting
from tests.mistakes.rows import Mistake

START = datetime(2024, 5, 14, 9, 30)
RECORD, TOML = "calibration/load_cell.toml", "session.toml"
WAVES, HOLD = "mach1/nbr.txt", "mach1/nbr_100um.txt"

Row = tuple[float, float, float]
"""Time [s], position [mm] and force [N] as a file has them."""
_ROW = re.compile(r"^-?[0-9.]+\t-?[0-9.]+\t-?[0-9.]+$", re.MULTILINE)


def write_waves(folder: Path) -> Path:
    """Write two frequencies in NBR, with a record of the cell."""
    specimen = Specimen(materials.load("nbr"))
    write_harmonic(folder, "nbr", specimen, Harmonic(hold=5.0, frequencies=(1.0, 2.0), cycles=7), TESTER, 31, START)
    return _session(folder, oscillation_section("nbr", specimen))


def write_holds(folder: Path) -> Path:
    """Write two depths held in NBR, with a record of the cell."""
    specimen = Specimen(materials.load("nbr"))
    names = write_relaxation(folder, "nbr", specimen, Relaxation(depths=(1e-4, 2e-4), hold=12.0), TESTER, 41, START)
    assert names[0] == HOLD
    return _session(folder, relaxation_section("nbr", names, specimen) + "elements = 512\n")


def _session(folder: Path, section: str) -> Path:
    files.write_text(folder / RECORD, cell_record())
    files.write_text(folder / TOML, session_head("Mistakes (synthetic)") + section)
    return folder


def columns(change: Callable[[float, float, float], Row], name: str) -> Edit:
    """Change every row of a file."""

    def changed(found: re.Match[str]) -> str:
        return "\t".join(f"{v:.6f}" for v in change(*map(float, found[0].split("\t"))))

    return rewritten(lambda text: _ROW.sub(changed, text), name)


def rewritten(change: Callable[[str], str], name: str) -> Edit:
    """Change the whole text of a file."""

    def edit(folder: Path) -> None:
        text = (folder / name).read_text("utf-8")
        other = change(text)
        assert other != text
        (folder / name).write_text(other, "utf-8")

    return edit


def rows(change: Callable[[list[str]], list[str]], name: str, block: int = -1) -> Edit:
    """Change the list of rows of one block, by its number among those with data."""

    def changed(text: str) -> str:
        begin = [m.end() for m in re.finditer(r"<DATA>\n.*\n", text)][block]
        end = text.index("<END DATA>", begin)
        return text[:begin] + "\n".join(change(text[begin:end].splitlines())) + "\n" + text[end:]

    return rewritten(changed, name)


def _replaced(old: str, new: str, name: str, after: str = "") -> Edit:
    def change(text: str) -> str:
        head, mark, tail = text.partition(after) if after else ("", "", text)
        assert old in tail
        return head + mark + tail.replace(old, new, 1)

    return rewritten(change, name)


def _renewed(lines: list[str]) -> list[str]:
    times = [line.split("\t")[0] for line in lines]
    return ["\t".join([t, *line.split("\t")[1:]]) for t, line in zip(times, lines[:150] + lines[170:], strict=False)]


def _force(change: Callable[[float, float], float], name: str, block: int) -> Edit:
    """Change the force of one block, by time [s] and force [N]."""

    def changed(line: str) -> str:
        t, x, f = map(float, line.split("\t"))
        return f"{t:.6f}\t{x:.6f}\t{change(t, f):.6f}"

    return rows(lambda lines: [changed(line) if _ROW.match(line) else line for line in lines], name, block)


_SLIPS = ("specimen or punch slipped", "at 3.00 s")
_NOISE = np.random.default_rng(7)

_COLUMNS: tuple[tuple[str, Callable[[float, float, float], Row], str], ...] = (
    ("position and force swapped", lambda t, x, f: (t, f, x), "position and force are swapped"),
    ("sign of the force", lambda t, x, f: (t, x, -f), "sign of the column of the force"),
    ("sign of the position", lambda t, x, f: (t, -x, f), "sign of the column of the position"),
    ("time in ms", lambda t, x, f: (1000 * t, x, f), "time is 1000 times too large: in ms"),
    ("time doubled", lambda t, x, f: (2 * t, x, f), "time is 2 times too large"),
    ("position in um", lambda t, x, f: (t, 1000 * x, f), "position is 1000 times too large: in µm"),
    ("force in gf", lambda t, x, f: (t, x, 101.97 * f), "force is in gf or mN"),
    ("force in mN", lambda t, x, f: (t, x, 1000 * f), "force is in gf or mN"),
    ("cell saturated", lambda t, x, f: (t, x, max(f, -14.0)), "saturated"),
    ("cell dead", lambda t, x, f: (t, x, -0.35 + 0.01 * _NOISE.standard_normal()), "dead"),
)


def _of_columns(name: str, *titles: str) -> tuple[Mistake, ...]:
    """Return mistakes with the columns of a file, by default all."""
    return tuple(
        Mistake(title, columns(change, name), "impossible", (words,), name, "Time, s")
        for title, change, words in _COLUMNS
        if title in titles or not titles
    )


def _record(title: str, old: str, new: str, words: str, line: str = "") -> Mistake:
    return Mistake(title, setting(old, new, RECORD), "impossible", (words,), RECORD, line or None)


def _declared(name: str, key: str, old: str, new: str, words: str, after: str = "") -> Mistake:
    edit = _replaced(f"{key}:\t{old}", f"{key}:\t{new}", name, after)
    return Mistake(f"{key} {new} for {old}", edit, "impossible", (words,), name, f"{key}:\t{new}")


_PERIOD, _DEPTH, _DELAY = "8 ± 0.002 mm", "6 ± 0.006 mm", "15.9 ± 0.2 ms"
WAVE_ROWS = (
    *_of_columns(WAVES),
    # record of the load cell
    _record("scale 10", "1.0000 ± 0.0010", "10 ± 0.01", "scale", "scale"),
    _record("delay 159 ms", _DELAY, "159 ± 2 ms", "15.9 ms", "159"),
    _record("delay 15.9 s", _DELAY, "15.9 ± 0.2 s", "15.9 ms", "15.9"),
    # punch
    Mistake(
        "thirty tips", setting("tips = 3", "tips = 30"), "doubtful", ("number of tips is probably 3",), TOML, "tips"
    ),
    Mistake("tips of 6 m", setting(_DEPTH, "6 ± 0.006 m"), "impossible", ("punch.depth",), TOML, "depth"),
    Mistake("pitch 0.8 mm", setting(_PERIOD, "0.8 ± 0.002 mm"), "impossible", ("punch.period",), TOML, "period"),
    # commands
    _declared(WAVES, "Amplitude, mm", "0.0100", "0.1000", "declared amplitude is 10 times"),
    _declared(WAVES, "Frequency, Hz", "1.0", "2.0", "declared frequency is 2 times"),
    # one block
    Mistake("force reversed", _force(lambda t, f: -f, WAVES, -1), "impossible", ("reversed in block",), WAVES),
    Mistake("slip between cycles", _force(lambda t, f: f + 2.0 * (t > 2.995), WAVES, -1), "doubtful", _SLIPS, WAVES),
    # rows
    Mistake("rows lost, times renewed", rows(_renewed, WAVES), "impossible", ("rows were lost",), WAVES),
    Mistake("rows lost", rows(lambda r: r[:150] + r[210:], WAVES), "impossible", ("missing",)),
)

_RELAX = "<Stress Relaxation>"
HOLD_ROWS = (
    *_of_columns(HOLD, "position and force swapped", "sign of the force", "time in ms", "force in mN", "cell dead"),
    _declared(HOLD, "Amplitude, mm", "0.0980", "0.9800", "declared amplitude is 10 times", _RELAX),
    _declared(HOLD, "Velocity, mm/s", "1.0000", "0.1000", "declared velocity is too small by a factor of 10", _RELAX),
    Mistake("slip in a hold", _force(lambda t, f: f + 0.3 * (t > 2.995), HOLD, -1), "doubtful", _SLIPS, HOLD, "\t"),
    Mistake(
        "force in kgf under N", columns(lambda t, x, f: (t, x, f / 9.80665), HOLD), "doubtful", ("factor of 9.8",), HOLD
    ),
)

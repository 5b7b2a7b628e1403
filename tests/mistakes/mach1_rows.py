"""Mistakes with a Mach-1 tester, in an oscillation and in relaxation tests: edits and what must be said."""

import math
import re
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import numpy as np

from labpipe import files, materials
from pipelines.rig.indentation_session import oscillation_section, relaxation_section
from pipelines.rig.indentations import Harmonic, Specimen, write_harmonic
from pipelines.rig.relaxations import TESTER, Relaxation, write_relaxation
from pipelines.rig.session_text import cell_record, session_head
from tests.mistakes.mach1_files import Row, columns, rewritten, rows
from tests.mistakes.recordings import Edit, setting
from tests.mistakes.rows import Mistake

START = datetime(2024, 5, 14, 9, 30)
RECORD, TOML = "calibration/load_cell.toml", "session.toml"
WAVES, HOLD, DEEPER = "mach1/nbr.txt", "mach1/nbr_100um.txt", "mach1/nbr_200um.txt"


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


def _replaced(old: str, new: str, name: str, after: str = "") -> Edit:
    def change(text: str) -> str:
        head, mark, tail = text.partition(after) if after else ("", "", text)
        assert old in tail
        return head + mark + tail.replace(old, new, 1)

    return rewritten(change, name)


def _all(old: str, new: str, name: str) -> Edit:
    return rewritten(lambda text: text.replace(old, new), name)


def _cell(row: str, column: int, value: str) -> str:
    parts = row.split("\t")
    parts[column] = value
    return "\t".join(parts)


def _force(change: Callable[[int, float], float]) -> Callable[[list[str]], list[str]]:
    """Return what changes the forces of a block by their number."""

    def changed(found: list[str]) -> list[str]:
        return [_cell(r, 2, f"{change(i, float(r.split(chr(9))[2])):.6f}") for i, r in enumerate(found) if "\t" in r]

    return changed


def _frozen(at: int) -> Callable[[list[str]], list[str]]:
    """Return what writes the force of one row on until the end of its block."""

    def changed(found: list[str]) -> list[str]:
        forces = [row.split("\t")[2] for row in found if "\t" in row]
        return _force(lambda i, f: float(forces[min(i, at)]))(found)

    return changed


_NOISE = np.random.default_rng(7)
_Z = "Position (z), mm"

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
    ("cell dead", lambda t, x, f: (t, x, -0.35), "dead"),
    ("cell open", lambda t, x, f: (t, x, -0.35 + 0.01 * _NOISE.standard_normal()), "dead"),
)


def _of_columns(name: str) -> tuple[Mistake, ...]:
    return tuple(
        Mistake(title, columns(change, name), "impossible", (words,), name, "Time, s")
        for title, change, words in _COLUMNS
    )


_IN_MM = "position is too small by a factor of 1000: in mm under µm"


def _of_units(name: str) -> tuple[Mistake, ...]:
    return (
        Mistake("header says ms", _all("Time, s\t", "Time, ms\t", name), "impossible", ("unit", "ms")),
        Mistake("header says um", _all(_Z, "Position (z), um", name), "impossible", (_IN_MM,), name, "Time, s"),
    )


def _of_record(name: str) -> tuple[Mistake, ...]:
    del name
    scale, delay = "1.0000 ± 0.0010", "15.9 ± 0.2 ms"
    return (
        Mistake("scale 10", setting(scale, "10 ± 0.01", RECORD), "impossible", ("scale",), RECORD, "scale"),
        Mistake("delay 159 ms", setting(delay, "159 ± 2 ms", RECORD), "impossible", ("15.9 ms",), RECORD, "159"),
        Mistake("delay 15.9 s", setting(delay, "15.9 ± 0.2 s", RECORD), "impossible", ("15.9 ms",), RECORD, "15.9"),
        Mistake("record expired", setting("2025-04-30", "2024-05-10", RECORD), "impossible", ("expired",), RECORD),
        Mistake("record of another cell", setting('"250N"', '"17N"', RECORD), "impossible", ("17N",), RECORD, "17N"),
        Mistake("record of a laser", setting('"load_cell"', '"laser"', RECORD), "impossible", ("values",), RECORD),
    )


def _of_punch(name: str) -> tuple[Mistake, ...]:
    del name
    period, depth = "8 ± 0.002 mm", "6 ± 0.006 mm"
    return (
        Mistake("thirty tips", setting("tips = 3", "tips = 30"), "doubtful", ("punch.tips",), TOML, "tips"),
        Mistake("tips of 6 m", setting(depth, "6 ± 0.006 m"), "impossible", ("punch.depth",), TOML, "depth"),
        Mistake("pitch 0.8 mm", setting(period, "0.8 ± 0.002 mm"), "impossible", ("punch.period",), TOML, "period"),
        Mistake("uncertainty of 6 mm", setting(depth, "6 ± 6 mm"), "doubtful", ("uncertainty",), TOML, "6 ± 6 mm"),
    )


def _of_rows(name: str, block: int) -> tuple[Mistake, ...]:
    return (
        Mistake("rows lost", rows(lambda r: r[:150] + r[210:], name, block), "impossible", ("missing",)),
        Mistake("rows doubled", rows(lambda r: r[:210] + r[150:], name, block), "impossible", ("does not go on",)),
        Mistake(
            "one force of -99 N",
            rows(lambda r: [*r[:200], _cell(r[200], 2, "-99.0"), *r[201:]], name, block),
            "note",
            ("left out as outliers",),
            name,
            "-99.0",
        ),
        Mistake(
            "force jumps",
            rows(_force(lambda i, f: f + 3.0 * (i > 250)), name, block),
            "impossible",
            ("force jumps by", "tared"),
            name,
        ),
        Mistake(
            "cell dies", rows(_force(lambda i, f: f if i < 250 else -0.35), name, block), "impossible", ("force",), name
        ),
        Mistake(
            "cell drifts before contact",
            rows(_force(lambda i, f: f - 0.005 * i), name, 0),
            "impossible",
            ("drifts by",),
            name,
        ),
        Mistake(
            "hum of 0.2 N before contact",
            rows(_force(lambda i, f: f + 0.2 * math.sin(2 * math.pi * 0.2 * i)), name, 0),
            "doubtful",
            ("swings by", "20 Hz"),
            name,
        ),
        Mistake(
            "cut within a block",
            rewritten(lambda text: text[: text.rindex("\n", 0, len(text) - 3000) + 1], name),
            "impossible",
            ("copied before it was complete",),
        ),
        Mistake(
            "letters in a cell",
            rewritten(lambda text: re.sub(r"\t-?\d+\.\d+\n", "\t--\n", text, count=1), name),
            "impossible",
        ),
    )


def _declared(name: str, key: str, old: str, new: str, words: str, after: str = "") -> Mistake:
    edit = _replaced(f"{key}:\t{old}", f"{key}:\t{new}", name, after)
    return Mistake(f"{key} {new} for {old}", edit, "impossible", (words,), name, f"{key}:\t{new}")


WAVE_ROWS = (
    *_of_columns(WAVES),
    *_of_units(WAVES),
    *_of_record(WAVES),
    *_of_punch(WAVES),
    *_of_rows(WAVES, -1),
    _declared(WAVES, "Amplitude, mm", "0.0100", "0.1000", "declared amplitude is 10 times"),
    _declared(WAVES, "Frequency, Hz", "1.0", "2.0", "declared frequency is 2 times"),
    _declared(WAVES, "Amplitude, mm", "0.0980", "0.9800", "declared amplitude is 10 times"),
    Mistake(
        "one position of 99 mm",
        rows(lambda r: [*r[:200], _cell(r[200], 1, "99.0"), *r[201:]], WAVES),
        "note",
        ("left out as outliers",),
        WAVES,
        "\t99.0\t",
    ),
    Mistake(
        "cut-off of the filter ten times",
        _all("(Hz):\t20.00", "(Hz):\t200.00", WAVES),
        "impossible",
        ("a filter of order 3 and 200 Hz has about 1.59 ms",),
        RECORD,
    ),
)

_RELAX = "<Stress Relaxation>"
HOLD_ROWS = (
    Mistake("tips of 6 cm", setting("6 ± 0.006 mm", "6 ± 0.006 cm"), "doubtful", ("length of a tip",), TOML, "depth"),
    *_of_columns(HOLD),
    *_of_units(HOLD),
    *_of_record(HOLD),
    *_of_punch(HOLD),
    *_of_rows(HOLD, 1),
    _declared(HOLD, "Amplitude, mm", "0.0980", "0.9800", "declared amplitude is 10 times", _RELAX),
    _declared(HOLD, "Velocity, mm/s", "1.0000", "0.1000", "declared velocity is too small by a factor of 10", _RELAX),
    Mistake(
        "stage creeps on",
        columns(lambda t, x, f: (t, x, f - 0.3 * t if t > 2.0 else f), HOLD),
        "impossible",
        ("a force in a hold falls",),
        HOLD,
    ),
    Mistake(
        "force in kgf under N",
        columns(lambda t, x, f: (t, x, f / 9.80665), HOLD),
        "impossible",
        ("factor of 9.8",),
        HOLD,
    ),
    Mistake("force frozen in a hold", rows(_frozen(700), DEEPER), "doubtful", ("froze", "530 readings"), DEEPER),
)

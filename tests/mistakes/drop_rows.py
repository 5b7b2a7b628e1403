"""Mistakes that laboratories make with a recorded ball drop: the edit, and what must be said."""

from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import numpy as np

from labpipe import files, materials
from labpipe.arrays import Floats
from pipelines.rig.drops import DropRig, write_drops
from pipelines.rig.samples import STATED_FLOOR
from pipelines.rig.session_text import drop_section, laser_record, session_head
from tests.mistakes.recordings import ALL, HEAD, Edit, cells, header, setting, values
from tests.mistakes.rows import Mistake

FIRST = ALL[:1]
LAST = ALL[-1:]
RECORD = "calibration/laser.toml"
START = datetime(2024, 5, 14, 9, 30)
_DEEP = 0.04  # mm above the lowest reading: inside the contacts


def write(folder: Path) -> Path:
    """Write the clean session: three drops of acrylic over 0.12 s."""
    rig = DropRig(duration=0.12)
    names = write_drops(folder, "drop", rig, materials.load("acrylic"), 1.5e-3, 3, 11, START)
    files.write_text(folder / RECORD, laser_record())
    text = session_head("Mistakes (synthetic)") + drop_section("drop", names, 1.5e-3, "acrylic", STATED_FLOOR)
    files.write_text(folder / "session.toml", text)
    return folder


def _in_contact(text: str) -> Callable[[list[str]], list[str]]:
    """Return what puts a text in place of the readings deep in the contacts."""

    def change(texts: list[str]) -> list[str]:
        x = np.array([float(t) for t in texts])
        lowest = x.min() + _DEEP
        return [text if v < lowest else t for v, t in zip(x, texts, strict=True)]

    return change


def _held(texts: list[str]) -> list[str]:
    x = np.array([float(t) for t in texts])
    lowest, kept = x.min() + _DEEP, []
    for v, t in zip(x, texts, strict=True):
        kept.append(kept[-1] if v < lowest else t)
    return kept


def _clipped(low: float | None, high: float | None) -> Callable[[Floats], Floats]:
    """Return what clips the readings at parts of their range."""

    def change(x: Floats) -> Floats:
        a, b = x.min(), x.max()
        return np.clip(x, None if low is None else a + low * (b - a), None if high is None else a + high * (b - a))

    return change


def _sine(x: Floats) -> Floats:
    t = np.arange(x.size) * 50e-6
    return x[0] - 0.4 * np.abs(np.sin(2 * np.pi * 20 * t)) + np.random.default_rng(2).normal(0.0, 7e-4, x.size)


def _wild(place: int, count: int, size: float) -> Callable[[Floats], Floats]:
    return lambda x: x + size * ((np.arange(x.size) >= place) & (np.arange(x.size) < place + count))


def _averaged(x: Floats) -> Floats:
    return np.convolve(np.concatenate([np.full(47, x[0]), x]), np.ones(48) / 48, "valid")


def _mains(x: Floats) -> Floats:
    return np.sin(2 * np.pi * 50.0 * 50e-6 * np.arange(x.size))


def _second_output(folder: Path) -> None:
    """Put another head's output, constant but for noise, before that of the drop."""
    lines = (folder / ALL[1]).read_text("utf-8").splitlines()
    noise = np.random.default_rng(3).normal(0.5, 0.001, len(lines))
    rows = [line.replace(",", f",{x:+08.4f},", 1) for line, x in zip(lines[HEAD:], noise, strict=False)]
    head = [line.replace("Unit,mm", "Unit,mm,mm").replace("OUT1", "OUT1,OUT2") for line in lines[:HEAD]]
    (folder / ALL[1]).write_text("\n".join([*head, *rows]) + "\n", "utf-8")


def _bump(x: Floats) -> Floats:
    return x + 0.01 * np.exp(-0.5 * ((np.arange(x.size) - 1150) / 20) ** 2)


def _zero_tail(texts: list[str]) -> list[str]:
    return texts[:1400] + ["+00.0000"] * (len(texts) - 1400)


def _copied(folder: Path) -> None:
    (folder / ALL[2]).write_bytes((folder / ALL[1]).read_bytes())


def _of_first(folder: Path) -> None:
    """Put the readings of the first record below the header of the third."""
    lines = (folder / ALL[0]).read_text("utf-8").splitlines()[HEAD:]
    cells(lambda _: [line.partition(",")[2] for line in lines], LAST)(folder)


def _other_height(height: float, material: str = "acrylic") -> Edit:
    def edit(folder: Path) -> None:
        rig = DropRig(duration=0.12)
        name = write_drops(folder / "other", "drop", rig, materials.load(material), height, 1, 14, START)[0]
        (folder / ALL[2]).write_bytes((folder / "other" / name).read_bytes())

    return edit


_TOML = "session.toml"
_SPHERE, _SENSOR = "[experiments.drop.sphere]", "[experiments.drop.sensor]\ndirection = -1"
_INTERVAL, _ANGLE, _RECORD, _CLIPPED = (
    ("sampling interval", "50.0 µs"), ("inclination",), ("calibration record",), ("clipped", "out of its range"),
)  # fmt: skip


def _cycle(text: str) -> Edit:
    return header("Sampling cycle,50us", f"Sampling cycle,{text}")


ROWS = (
    # time
    Mistake("cycle 100 for 50 us", _cycle("100us"), "impossible", _INTERVAL, ALL[0], 4),
    Mistake("cycle 52.5 for 50 us", _cycle("52.5us"), "impossible", _INTERVAL, ALL[0], 4),
    Mistake("cycle without unit", _cycle("50"), "impossible", ("unit",)),
    Mistake("storage x2 written", header("Storage cycle,x1", "Storage cycle,x2"), "impossible", _INTERVAL, ALL[0]),
    Mistake("every second row kept", cells(lambda t: t[::2]), "impossible", ("sampling interval", "100 µs"), ALL[0]),
    # length
    Mistake("unit um", header("Unit,mm", "Unit,um"), "impossible", ("unit", "0.001"), ALL[0], 8),
    Mistake("unit mil", header("Unit,mm", "Unit,mil"), "impossible", ("unit",), ALL[0], 8),
    Mistake("display x10", values(lambda x: 10.0 * x), "impossible", ("10", "times too large")),
    Mistake("gain one half", values(lambda x: 0.5 * x), "impossible", ("too small by a factor of 2",)),
    Mistake("decimal point lost", cells(lambda t: [text.replace(".", "") for text in t]), "impossible", ("unit",)),
    Mistake(
        "gain 1.02 of one", values(lambda x: x.mean() + 1.02 * (x - x.mean()), LAST), "impossible", ("gain",), ALL[2]
    ),
    Mistake("average of 48", values(_averaged), "impossible", ("averages or filters",)),
    # what the session states
    Mistake("height 15 for 1.5 mm", setting('"1.5 ±', '"15 ±'), "impossible", ("drop height", "1.50 mm"), _TOML, 17),
    Mistake("height 1.4 mm", setting('"1.5 ±', '"1.4 ±'), "impossible", ("drop height",), _TOML, 17),
    Mistake("mass 505 kg", setting("505.0 ± 0.5 g", "505.0 ± 0.5 kg"), "impossible", ("mass", "505 g"), _TOML, 22),
    Mistake("mass 5.05 g", setting("505.0 ± 0.5 g", "5.05 ± 0.005 g"), "doubtful", ("mass", "505 g"), _TOML, 22),
    Mistake("uncertainty 5 mm", setting("± 0.005 mm", "± 5 mm"), "doubtful", ("uncertainty",), _TOML, 17),
    # calibration
    Mistake("inclination 22 deg", setting('"12.00', '"22.00', RECORD), "impossible", _ANGLE, RECORD, 13),
    Mistake("inclination in radians", setting("0.10 deg", "0.10 rad", RECORD), "impossible", _ANGLE, RECORD, 13),
    Mistake("inclination 0.12 deg", setting('"12.00', '"0.12', RECORD), "impossible", _ANGLE, RECORD, 13),
    Mistake("corrected twice", values(lambda x: x / np.cos(np.deg2rad(12.0))), "impossible", ("inclination", "twice")),
    Mistake("record expired", setting("2025-04-30", "2024-05-05", RECORD), "impossible", _RECORD),
    Mistake("record of a camera", setting('kind = "laser"', 'kind = "camera"', RECORD), "impossible", ("camera",)),
    # sensor
    Mistake("constant channel", values(lambda x: np.full(x.size, x[0])), "impossible", ("channel",)),
    Mistake(
        "noise only",
        values(lambda x: x[0] + np.random.default_rng(1).normal(0.0, 0.001, x.size)),
        "impossible",
        ("channel",),
    ),
    Mistake("sine with cusps", values(_sine), "impossible", ()),
    Mistake("direction reversed", setting(_SPHERE, f"{_SENSOR}\n\n{_SPHERE}"), "impossible", ("direction",)),
    # out of range
    *(
        Mistake(f"out of range {text!r}", cells(_in_contact(text)), level, ("impact",))
        for text, level in (
            ("FFFFFFF", "doubtful"),
            ("-", "impossible"),
            ("", "impossible"),
            ("+00.0000", "impossible"),
            ("+99.9999", "doubtful"),
            ("-99.9999", "doubtful"),
            ("99999", "impossible"),
        )
    ),
    Mistake("last value held", cells(_held), "impossible", ("held",)),
    Mistake("clipped below", values(_clipped(0.03, None)), "impossible", _CLIPPED),
    Mistake("clipped above", values(_clipped(None, 0.9)), "impossible", _CLIPPED),
    Mistake("drop in OUT2", _second_output, "impossible", ("out2 holds one from 1.47 mm",), ALL[1]),
    # where in time
    Mistake("pasted together", cells(lambda t: t + t), "impossible", ("120 ms",)),
    Mistake("cut, old count", cells(lambda t: t[:1300], FIRST, counted=False), "impossible", ("not copied whole",)),
    Mistake("zero-filled tail", cells(_zero_tail), "impossible", ("70.0 ms",)),
    Mistake("60 rows lost", cells(lambda t: t[:1000] + t[1060:]), "impossible", ("lost",)),
    Mistake("one row lost in flight", cells(lambda t: t[:740] + t[741:], FIRST), "doubtful", ("single rows: 1 lost",)),
    Mistake("one row doubled in flight", cells(lambda t: t[:740] + t[739:], FIRST), "doubtful", ("1 doubled",)),
    Mistake("25 rows doubled", cells(lambda t: t[:1025] + t[1000:], FIRST), "impossible", ("twice",)),
    Mistake("60 rows doubled", cells(lambda t: t[:1060] + t[1000:]), "impossible", ("twice",)),
    Mistake("level jump", values(lambda x: x + 0.5 * (np.arange(x.size) > 1500)), "impossible", ("75", "jump")),
    Mistake(
        "zero jumps by 20 um",
        values(lambda x: x + 0.02 * (np.arange(x.size) > 1800), LAST),
        "doubtful",
        ("step", "90"),
        ALL[2],
    ),
    Mistake("hit in a flight", values(_bump), "doubtful", ("flight after impact 1", "touched"), ALL[0]),
    Mistake(
        "cycle 100 us from 60 ms on",
        cells(lambda t: t[:1200] + t[1200::2]),
        "impossible",
        ("between the rows changes",),
    ),
    Mistake(
        "thirty readings held", cells(lambda t: t[:1150] + 30 * t[1150:1151] + t[1180:]), "doubtful", ("57.5", "held")
    ),
    Mistake("drift 1 mm", values(lambda x: x + np.linspace(0.0, 1.0, x.size)), "impossible", ("drift",)),
    Mistake("begins in mid-fall", cells(lambda t: t[600:]), "impossible", ("mid-fall",)),
    Mistake("ends after first contact", cells(lambda t: t[:820]), "impossible", ("ends",)),
    Mistake("one spike of 3 mm", values(_wild(900, 1, 3.0)), "note", ("spike",)),
    Mistake("thirty wild readings", values(_wild(900, 30, 1.0), FIRST), "impossible", ("readings jump",), FIRST[0]),
    Mistake("hum of 5 um", values(lambda x: x + 0.005 * _mains(x)), "note", ("hum",)),
    Mistake("hum of 50 um", values(lambda x: x + 0.05 * _mains(x)), "note", ("hum of 51",)),
    Mistake("resolution 10 um", values(lambda x: np.round(x, 2)), "note", ("resolution",)),
    Mistake("resolution 100 um", values(lambda x: np.round(x, 1)), "doubtful", ("resolution",)),
    # repeats
    Mistake("same file twice", _copied, "doubtful", ("same bytes",), ALL[2]),
    Mistake("same readings, another header", _of_first, "doubtful", ("digit by digit", "copy"), ALL[2]),
    Mistake("repeat of another height", _other_height(1.7e-3), "impossible", ("1.7", "another height"), ALL[2]),
    Mistake("repeat of another polymer", _other_height(1.5e-3, "ptfe"), "impossible", ("another body",), ALL[2]),
)

"""The synthetic session of rubber under a periodic punch: relaxation, then ten frequencies."""

from datetime import datetime, timedelta
from pathlib import Path

from labpipe import files
from pipelines.rig.indentations import Harmonic, Specimen, write_harmonic
from pipelines.rig.relaxations import TESTER, Relaxation, write_relaxation
from pipelines.rig.session_text import cell_record, from_dma, from_library, section
from pipelines.rig.solids import specimen_of

FREQUENCIES = (0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 4.0)
"""Hz; ten as in the thesis, 0.5 and 2 Hz among them."""

_MATERIAL = "nbr"


def punch_section(name: str, specimen: Specimen, source: str, *, is_calibrated: bool = True) -> str:
    """Return the tables of punch, substrate and model of an indentation, and of the load cell where it is calibrated.

    Without a calibration lengths are stated without their uncertainty too.
    """
    u_tip, u_depth = (" ± 0.002", " ± 0.006") if is_calibrated else ("", "")
    given = {"u_tip": u_tip, "u_depth": u_depth, "source": source or from_library(_MATERIAL)}
    return section("punch", name=name, specimen=specimen, is_calibrated=is_calibrated, **given)


def relaxation_section(name: str, mach1: list[str], specimen: Specimen, source: str = "") -> str:
    """Return the tables of relaxation tests in session.toml."""
    return section("relaxation", name=name, mach1=mach1) + punch_section(name, specimen, source)


def oscillation_section(name: str, specimen: Specimen, source: str = "", *, is_calibrated: bool = True) -> str:
    """Return the tables of a harmonic indentation, by default with a calibrated load cell."""
    head = section("harmonic", name=name, is_calibrated=is_calibrated)
    return head + punch_section(name, specimen, source, is_calibrated=is_calibrated)


def write_indentations(folder: Path, start: datetime, held: Relaxation, oscillating: Harmonic, seed: int) -> str:
    """Write recordings, truth and the cell's record; returns the sections of both experiments."""
    specimen = Specimen(specimen_of(_MATERIAL))
    relaxation, harmonic = f"{_MATERIAL}_relaxation", f"{_MATERIAL}_harmonic"
    recordings = write_relaxation(folder, relaxation, specimen, held, TESTER, seed + 70, start)
    write_harmonic(folder, harmonic, specimen, oscillating, TESTER, seed + 80, start + timedelta(hours=3))
    files.write_text(folder / "calibration/load_cell.toml", cell_record())
    source = from_dma(_MATERIAL)
    return relaxation_section(relaxation, recordings, specimen, source) + oscillation_section(
        harmonic, specimen, source
    )

"""The texts that synthetic sessions share: the head of session.toml, records, sections."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment

from labpipe import files
from labpipe.workflow.session import VERSION
from pipelines.rig.solids import Solid

NOTE = (
    "SYNTHETIC: made by labpipe's virtual rig, not measured. The truth lies in truth/ and is "
    "never read by the analysis."
)
"""What every synthetic file says of itself."""

_ENVIRONMENT = Environment(trim_blocks=True, keep_trailing_newline=True)  # noqa: S701 - TOML, not HTML
_ENVIRONMENT.filters["mm"] = lambda length: f"{length * 1e3:g}"
_TEXTS = _ENVIRONMENT.from_string(Path(__file__).with_name("session.toml.jinja").read_text("utf-8"))
STATED_NU = {
    "nbr": "0.490 ± 0.005",
    "acrylic": "0.35 ± 0.01",
    "peek": "0.38 ± 0.01",
    "nylon": "0.40 ± 0.01",
    "ptfe": "0.46 ± 0.01",
}


@dataclass(frozen=True, slots=True)
class Stated:
    """What the laboratory knows of the rig, within its u: of the room [degC], and of the laser's inclination [deg].

    ``on_plate`` is that of the sensor over the plate.
    """

    room: float = 20.0
    inclination: float = 12.0
    on_plate: float = 5.0
    u_inclination: float = 0.1


STATED = Stated()


def height_name(height: float) -> str:
    """Spell a height for names: ``1p5mm``."""
    return f"{height * 1e3:g}mm".replace(".", "p")


def section(which: str, /, **given: Any) -> str:
    """Return the tables of an experiment in session.toml, or another text of ``session.toml.jinja``."""
    return str(getattr(_TEXTS.module, which)(**given))


def record(kind: str, name: str, instrument: str, how: str, values: str) -> str:
    """Return a calibration record, as a laboratory would have written it; ``instrument`` may be more lines."""
    return section("record", kind=kind, name=name, instrument=instrument, how=how, values=values, note=NOTE)


def laser_record(place: str = "inclination", inclination: float = STATED.inclination, step: str = "1 mm") -> str:
    """Return the record of the sensor in a place, with the angle that the calibration found [deg]."""
    how = f"twelve micrometer steps of {step} against the reading"
    values = f'inclination = "{inclination:.2f} ± {STATED.u_inclination:.2f} deg"\nscale = "1.0000 ± 0.0005"'
    return record("laser", f"laser-{place}", '"LK-G5001"', how, values)


def plate_laser_record() -> str:
    """Return the record of the sensor in its place over the plate."""
    return laser_record("plate", STATED.on_plate, "0.1 mm")


def front_record() -> str:
    """Return the record of the front view (appendix D of the thesis)."""
    return _camera_record("front", "30.00 ± 0.02 mm", "386 ± 1.5 px", "distance of the holder's edges")


def under_record(*, is_binned: bool = True) -> str:
    """Return the record of the view under the disc (appendix D of the thesis).

    The small film is binned two by two: 461 px of it span 2 mm.
    """
    length = "2.0000 ± 0.0005 mm" if is_binned else "1.0000 ± 0.0005 mm"
    return _camera_record("under", length, "461 ± 1 px", "graduations of a glass ruler")


def _camera_record(view: str, length: str, pixels: str, how: str) -> str:
    values = f'reference_length = "{length}"\npixel_length = "{pixels}"'
    return record("camera", f"camera-{view}", f'"labpipe virtual camera"\nview = "{view}"', how, values)


def cell_record() -> str:
    """Return the record of the load cell."""
    values = 'scale = "1.0000 ± 0.0010"\nfilter_delay = "15.9 ± 0.2 ms"  # against an elastic reference'
    return record("load_cell", "load-cell", '"250N"', "five masses", values)


def session_head(title: str) -> str:
    """Return the beginning of a synthetic session.toml."""
    return section("head", version=VERSION, title=title, note=NOTE)


def write_session(folder: Path, title: str, sections: str, *, is_binned: bool = True) -> None:
    """Write session.toml, and those of the calibration records of laser and cameras that its sections name."""
    records = {
        "laser": laser_record(),
        "laser_plate": plate_laser_record(),
        "camera_front": front_record(),
        "camera_under": under_record(is_binned=is_binned),
    }
    for name, text in records.items():
        if f"calibration/{name}.toml" in sections:
            files.write_text(folder / f"calibration/{name}.toml", text)
    files.write_text(folder / "session.toml", session_head(f"{title} (synthetic)") + sections)


def write_truth(folder: Path, name: str, truth: Mapping[str, Any], indent: int | None = 1) -> None:
    """Write the true values of a recording, where the analysis does not read."""
    text = json.dumps({"synthetic": True, **truth}, indent=indent)
    files.write_text(folder / f"truth/{name}.json", text + "\n")


def from_library(material: str) -> str:
    """Return the line that takes a material from the library."""
    return f'material = "{material}"\n'


def from_dma(material: str, temperature: float | None = None) -> str:
    """Return the lines that take a material from its DMA experiment, in the room or heated [degC]."""
    stated = f"{STATED.room:.1f} ± 0.5" if temperature is None else f"{temperature:g} ± 1"
    warm = "" if temperature is None else "homogeneous = true  # it was warmed through\n"
    return f'material_from = "{dma_name(material)}"\ntemperature = "{stated} degC"\n{warm}'


def dma_name(material: str) -> str:
    """Name the DMA experiment of a material."""
    return f"{material}_dma"


def drop_section(
    name: str, recordings: list[str], height: float, material: str, extra: str = "", source: str = ""
) -> str:
    """Return the table of one ball drop in session.toml; ``extra`` are more of its lines.

    ``source`` are the lines that name the material; without it, it is the library's.
    """
    source = source or from_library(material)
    return section("ball_drop", name=name, recordings=recordings, height=height, extra=extra, source=source)


def dma_section(name: str, export: str, solid: Solid) -> str:
    """Return the table of one dynamic mechanical analysis in session.toml.

    A reference temperature above the sweeps, as the thesis has for PEEK, needs a law.
    """
    vertical = "rho_T" if solid.is_entropic else "linear"
    law = "" if solid.T_ref <= 120.0 else 'law = "arrhenius"  # T_ref is above the sweeps\n'
    nu = STATED_NU.get(name.removesuffix("_dma"), f"{solid.nu:g}")
    return section("dma", name=name, export=export, solid=solid, nu=nu, vertical=vertical, law=law)

"""Synthetic sessions by name: recordings of the virtual rig, and the session.toml to process it.

Every session says that it is synthetic, in its session.toml and with every recording. The
truth is in ``truth/``, which the analysis never reads.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path

from labpipe.errors import UsageError
from pipelines.rig._ahead import DEMO_TITLE
from pipelines.rig.dma import sweeps
from pipelines.rig.drops import write_drops
from pipelines.rig.fall import DropRig
from pipelines.rig.film_session import FRONT_HEIGHT, write_films
from pipelines.rig.indentation_session import FREQUENCIES, oscillation_section, write_indentations
from pipelines.rig.indentations import Harmonic, Specimen, write_harmonic
from pipelines.rig.mach1_tester import Tester
from pipelines.rig.plate import PLATE, PLATE_RIG
from pipelines.rig.plate_session import write_plate
from pipelines.rig.relaxations import Relaxation
from pipelines.rig.session_text import (
    dma_name,
    drop_section,
    from_dma,
    front_record,
    height_name,
    laser_record,
    plate_laser_record,
    session_head,
    under_record,
    write_session,
)
from pipelines.rig.solids import SOLIDS, specimen_of
from pipelines.rig.static_loading import record_static

_START = datetime(2024, 5, 14, 9, 30)


@dataclass(frozen=True, slots=True)
class Sample:
    """A synthetic session: its content, and the function that writes it; one with films has another for full size.

    ``has_seed``: the function takes a ``seed``, which draws the rig anew.
    """

    summary: str
    write: Callable[..., list[str]]
    in_full_size: Callable[..., list[str]] | None = None
    has_seed: bool = False


def write_sample(name: str, folder: Path, *, full_size: bool = False, seed: int | None = None) -> list[str]:
    """Write a synthetic session as :func:`pipelines.rig.sample` does; return the names of its experiments."""
    if name not in SAMPLES:
        known = ", ".join(SAMPLES)
        raise UsageError(f'there is no sample "{name}"; known are {known}')
    if folder.exists() and any(folder.iterdir()):
        raise UsageError(f"{folder} is not empty; name a new folder")
    chosen = SAMPLES[name]
    write = chosen.in_full_size if full_size and chosen.in_full_size else chosen.write
    if seed is None:
        return write(folder)
    if not chosen.has_seed:
        drawn = " and ".join(f'"{each}"' for each, sample in SAMPLES.items() if sample.has_seed)
        raise UsageError(f'only {drawn} are drawn by a seed, not "{name}"')
    return write(folder, seed=seed)


STATED_FLOOR = 'plate = { mass = "1450 ± 100 kg", frequency = "390 ± 20 Hz", damping_ratio = "0.03" }\n'
"""What the laboratory knows of its table: near the truth within what it states, not the truth."""


def write_series(
    folder: Path, rig: DropRig, material: str, heights: tuple[float, ...], repeats: int
) -> tuple[list[str], str]:
    """Record one sphere from several heights; returns experiment names and their sections."""
    solid = specimen_of(material)
    names, sections = [], ""
    for number, height in enumerate(heights):
        name = f"{material}_{height_name(height)}"
        seed = 1000 * sum(map(ord, material)) + 100 * number
        recordings = write_drops(
            folder, name, rig, solid, height, repeats, seed, _START + timedelta(minutes=20 * number)
        )
        names.append(name)
        sections += drop_section(name, recordings, height, material, STATED_FLOOR, from_dma(material))
    return names, sections


def _write_core(folder: Path, title: str, heights: tuple[float, ...], repeats: int, protocol: Harmonic) -> list[str]:
    names, sections = write_series(folder, DropRig(), "acrylic", heights, repeats)
    specimen = Specimen(specimen_of("nbr"))
    write_harmonic(folder, "nbr_harmonic", specimen, protocol, Tester(), 7, _START + timedelta(days=1))
    sections += oscillation_section("nbr_harmonic", specimen, from_dma("nbr"), is_calibrated=False)
    sections += sweeps(folder, "acrylic", "nbr")
    write_session(folder, session_head(title) + sections, laser=laser_record())
    return [*names, "nbr_harmonic", "acrylic_dma", "nbr_dma"]


def _demo(folder: Path) -> list[str]:
    protocol = replace(Harmonic(), hold=60.0, frequencies=(0.5, 1.0, 2.0), cycles=8)
    return _write_core(folder, DEMO_TITLE, (1.5e-3,), 3, protocol)


def _core(folder: Path) -> list[str]:
    heights = (1.5e-3, 5e-3, 7e-3, 10e-3)
    return _write_core(folder, "Acrylic on sapphire and NBR under a punch (synthetic)", heights, 5, Harmonic())


def _dma(folder: Path) -> list[str]:
    write_session(folder, session_head("Rheometer sweeps of five materials (synthetic)") + sweeps(folder, *SOLIDS))
    return [dma_name(material) for material in SOLIDS]


def _films(folder: Path, *, full_size: bool = False) -> list[str]:
    laser, sections = write_films(folder, _START, full_size=full_size)
    drops = drop_section("ptfe_7mm", laser, FRONT_HEIGHT, "ptfe", source=from_dma("ptfe"))
    write_session(
        folder,
        session_head("Films of PTFE and acrylic (synthetic)") + drops + sections + sweeps(folder, "ptfe", "acrylic"),
        laser=laser_record(),
        camera_front=front_record(),
        camera_under=under_record(is_binned=not full_size),
    )
    return ["ptfe_7mm", "ptfe_film", "acrylic_film", "ptfe_dma", "acrylic_dma"]


def _indentation(folder: Path) -> list[str]:
    names, sections = write_indentations(
        folder, _START + timedelta(days=1), Relaxation(), Harmonic(frequencies=FREQUENCIES)
    )
    write_session(folder, session_head("NBR under a periodic punch (synthetic)") + sections + sweeps(folder, "nbr"))
    return [*names, "nbr_dma"]


def _static(folder: Path) -> list[str]:
    sections = record_static(folder, "ptfe_static", _START) + sweeps(folder, "ptfe")
    write_session(folder, session_head("PTFE sphere under five loads (synthetic)") + sections, laser=laser_record())
    return ["ptfe_static", "ptfe_dma"]


def _plate(folder: Path) -> list[str]:
    heights = (1.5e-3, 10e-3)
    sections = write_plate(folder, PLATE_RIG, ("acrylic", "ptfe"), heights, 2, _START)
    recordings = write_drops(
        folder,
        "acrylic_10mm",
        DropRig(floor=PLATE),
        specimen_of("acrylic"),
        heights[1],
        2,
        4242,
        _START + timedelta(days=1),
    )
    sections += drop_section(
        "acrylic_10mm", recordings, heights[1], "acrylic", 'plate_from = "plate"\n', from_dma("acrylic")
    )
    sections += sweeps(folder, "acrylic", "ptfe")
    records = {"laser": laser_record(), "laser_plate": plate_laser_record()}
    write_session(folder, session_head("Ringing of the plate (synthetic)") + sections, **records)
    return ["plate", "acrylic_10mm", "acrylic_dma", "ptfe_dma"]


def _campaign(name: str, folder: Path, seed: int | None = None) -> list[str]:
    from pipelines.rig import campaign

    extent = getattr(campaign, name)
    return campaign.write_campaign(folder, _START, extent if seed is None else campaign.drawn(extent, seed))


SAMPLES: dict[str, Sample] = {
    "indentation": Sample("NBR under a periodic punch: relaxation at three depths, ten frequencies", _indentation),
    "static": Sample("a PTFE sphere under five loads, seen by the laser", _static),
    "dma": Sample("rheometer sweeps of five materials over temperature", _dma),
    "demo": Sample("three drops of acrylic, one short harmonic indentation", _demo),
    "plate": Sample("vibration of the plate under acrylic and PTFE; a drop modelled on it", _plate),
    "films": Sample(
        "PTFE by laser and front camera; acrylic filmed through the disc", _films, partial(_films, full_size=True)
    ),
    "thesis": Sample(
        "every experiment of the thesis: the whole campaign",
        partial(_campaign, "THESIS"),
        partial(_campaign, "FULL_SIZE"),
        has_seed=True,
    ),
    "thesis-small": Sample(
        "the campaign in two megabytes: every kind, one height, two repeats", partial(_campaign, "SMALL"), has_seed=True
    ),
    "core": Sample("acrylic from four heights, five repeats; one harmonic indentation", _core),
}

"""Synthetic sessions by name: recordings of the virtual rig, and the session.toml to process it.

Every session says that it is synthetic, in its session.toml and with every recording. The
truth is in ``truth/``, which the analysis never reads.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any

from labpipe.errors import UsageError
from pipelines.rig import DEMO_TITLE, film_front, film_under
from pipelines.rig.apparatus import SPHERE
from pipelines.rig.calibration_images import write_calibration_images
from pipelines.rig.campaign import FULL_SIZE, SMALL, THESIS, Extent, drawn, write_campaign
from pipelines.rig.dma import sweeps
from pipelines.rig.drops import Body, DropRig, write_drops
from pipelines.rig.film_front import FRONT_HEIGHT, FrontCamera, front_section, write_front
from pipelines.rig.film_under import UNDER_HEIGHT, Bursts, UnderCamera, burst_times, under_section, write_under
from pipelines.rig.indentations import Harmonic, Specimen, oscillation_section, write_harmonic
from pipelines.rig.mach1_tester import Tester
from pipelines.rig.reference_drop import Floor
from pipelines.rig.session_text import dma_name, drop_section, from_dma, height_name, write_session
from pipelines.rig.solids import SOLIDS, specimen_of

_START = datetime(2024, 5, 14, 9, 30)
STATED_FLOOR = 'plate = { mass = "1450 ± 100 kg", frequency = "390 ± 20 Hz", damping_ratio = "0.03" }\n'
"""The laboratory's knowledge of its table: near the truth within what it states, not the truth."""


@dataclass(frozen=True, slots=True)
class Sample:
    """A synthetic session: its content, the function that writes it, and which of ``full_size`` and ``seed`` it takes.

    A seed draws the rig anew.
    """

    summary: str
    write: Callable[..., list[str]]
    takes: tuple[str, ...] = ()


def write_sample(name: str, folder: Path, *, full_size: bool = False, seed: int | None = None) -> list[str]:
    """Write a synthetic session as :func:`pipelines.rig.sample` does; return the names of its experiments."""
    if name not in SAMPLES:
        known = ", ".join(SAMPLES)
        raise UsageError(f'there is no sample "{name}"; known are {known}')
    if folder.exists() and any(folder.iterdir()):
        raise UsageError(f"{folder} is not empty; name a new folder")
    takes = SAMPLES[name].takes
    if seed is not None and "seed" not in takes:
        drawn = " and ".join(f'"{each}"' for each, sample in SAMPLES.items() if "seed" in sample.takes)
        raise UsageError(f'only {drawn} are drawn by a seed, not "{name}"')
    given = {"full_size": full_size or None, "seed": seed}
    return SAMPLES[name].write(folder, **{key: value for key, value in given.items() if key in takes and value})


def _core(title: str, heights: tuple[float, ...], repeats: int, protocol: Harmonic, folder: Path) -> list[str]:
    """Record acrylic from several heights, and an indentation of rubber by a tester that is not calibrated."""
    names, sections, rig, acrylic = [], "", DropRig(), specimen_of("acrylic")
    for number, height in enumerate(heights):
        names.append(f"acrylic_{height_name(height)}")
        seed, begun = 1000 * sum(map(ord, "acrylic")) + 100 * number, _START + timedelta(minutes=20 * number)
        recordings = write_drops(folder, names[-1], rig, acrylic, height, repeats, seed, begun)
        sections += drop_section(names[-1], recordings, height, "acrylic", STATED_FLOOR, from_dma("acrylic"))
    specimen = Specimen(specimen_of("nbr"))
    write_harmonic(folder, "nbr_harmonic", specimen, protocol, Tester(), 7, _START + timedelta(days=1))
    sections += oscillation_section("nbr_harmonic", specimen, from_dma("nbr"), is_calibrated=False)
    write_session(folder, title, sections + sweeps(folder, "acrylic", "nbr"))
    return [*names, "nbr_harmonic", "acrylic_dma", "nbr_dma"]


def _films(folder: Path, *, full_size: bool = False) -> list[str]:
    """Film PTFE from the front while the laser records it, and acrylic through the disc.

    In full size films have 1280 × 480 px and 9,367 frames (5.8 GB each) instead of a few megabytes.
    """
    laser = write_drops(folder, "ptfe_7mm", DropRig(), specimen_of("ptfe"), FRONT_HEIGHT, 3, 4711, _START)
    front = film_front.FULL_SIZE if full_size else FrontCamera(rows=144, columns=64, duration=0.138)
    under = film_under.FULL_SIZE if full_size else UnderCamera()
    body = Body(specimen_of("acrylic"), UNDER_HEIGHT, floor=Floor())
    times = film_under.FULL_TIMES if full_size else burst_times(body, under.release, Bursts())
    sections = drop_section("ptfe_7mm", laser, FRONT_HEIGHT, "ptfe", source=from_dma("ptfe"))
    sections += front_section(write_front(folder, "ptfe", FRONT_HEIGHT, front, 31), front)
    film = write_under(folder, "acrylic_under", body, under, times, 37)
    sections += under_section(film, source=from_dma("acrylic")) + sweeps(folder, "ptfe", "acrylic")
    write_calibration_images(folder)
    write_session(folder, "Films of PTFE and acrylic", sections, is_binned=not full_size)
    return ["ptfe_7mm", "ptfe_film", "acrylic_film", "ptfe_dma", "acrylic_dma"]


def _campaign(
    extent: Extent, folder: Path, *, seed: int | None = None, full_size: bool = False, **part: Any
) -> list[str]:
    """Record a campaign or, with a title, some of its experiments."""
    extent = FULL_SIZE if full_size else extent
    return write_campaign(folder, _START, extent if seed is None else drawn(extent, seed), **part)


_DEMO = replace(Harmonic(), hold=60.0, frequencies=(0.5, 1.0, 2.0), cycles=8)

SAMPLES: dict[str, Sample] = {
    "indentation": Sample(
        "NBR under a periodic punch: relaxation at three depths, ten frequencies",
        partial(
            _campaign, THESIS, title="NBR under a periodic punch", only=("nbr_relaxation", "nbr_harmonic", "nbr_dma")
        ),
    ),
    "static": Sample(
        "a PTFE sphere under five loads, seen by the laser",
        partial(_campaign, THESIS, title="PTFE sphere under five loads", only=("ptfe_static", "ptfe_dma")),
    ),
    "dma": Sample(
        "rheometer sweeps of five materials over temperature",
        partial(_campaign, THESIS, title="Rheometer sweeps of five materials", only=tuple(map(dma_name, SOLIDS))),
    ),
    "demo": Sample(
        "three drops of acrylic, one short harmonic indentation",
        partial(_core, DEMO_TITLE, SPHERE.heights[:1], 3, _DEMO),
    ),
    "plate": Sample(
        "vibration of the plate under acrylic and PTFE; a drop modelled on it",
        partial(
            _campaign,
            replace(THESIS, heights=SPHERE.heights[::3], ringing=("acrylic", "ptfe"), repeats=2, plate_repeats=2),
            title="Ringing of the plate",
            only=("plate", "acrylic_10mm", "acrylic_dma", "ptfe_dma"),
        ),
    ),
    "films": Sample("PTFE by laser and front camera; acrylic filmed through the disc", _films, ("full_size",)),
    "thesis": Sample(
        "every experiment of the thesis: the whole campaign", partial(_campaign, THESIS), ("full_size", "seed")
    ),
    "thesis-small": Sample(
        "the campaign in two megabytes: every kind, one height, two repeats", partial(_campaign, SMALL), ("seed",)
    ),
    "core": Sample(
        "acrylic from four heights, five repeats; one harmonic indentation",
        partial(_core, "Acrylic on sapphire and NBR under a punch", SPHERE.heights, 5, Harmonic()),
    ),
}

"""The thesis's campaign as the virtual rig records it: every experiment, on one and the same rig.

Spheres of four polymers fall from four heights, five times each, on a plate that rings; the laser
sees the holder, then the plate; a camera films PTFE from the front, another acrylic through the
disc, at room temperature and heated; PTFE is loaded step by step; rubber is indented by a punch;
all five materials go through the rheometer. What is recorded by itself is written side by side.
"""

import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path

import numpy as np

from labpipe import files, materials
from pipelines.rig import film_front, film_under
from pipelines.rig.calibration_images import write_calibration_images
from pipelines.rig.dma import SOLIDS, Protocol, write_dma
from pipelines.rig.drops import write_drops
from pipelines.rig.fall import Body, DropRig
from pipelines.rig.film_front import FrontCamera
from pipelines.rig.film_session import (
    FRONT_HEIGHT,
    burst_times,
    front_record,
    front_section,
    under_record,
    under_section,
    write_front,
    write_under,
)
from pipelines.rig.film_under import UnderCamera
from pipelines.rig.indentation_session import write_indentations
from pipelines.rig.plate import PLATE, PLATE_RIG
from pipelines.rig.plate_session import plate_laser_record, plate_section, write_ringing_of
from pipelines.rig.session_text import (
    NOTE,
    dma_section,
    drop_section,
    height_name,
    laser_record,
    session_head,
)
from pipelines.rig.static_loading import StaticRig, static_section, write_static

POLYMERS = ("acrylic", "nylon", "peek", "ptfe")
HEIGHTS = (1.5e-3, 5e-3, 7e-3, 10e-3)
HEATED = 39.0
"""degC; of the sphere that was heated, dropped from the highest height."""

_REPEATS, _PLATE_REPEATS = 5, 3
_SMALL_UNDER = UnderCamera(rows=160, columns=640)  # the widest contact, 1.2 mm, needs 550 px
_REST, _REST_PER_ROOT_HEIGHT = 0.28, 5.4  # s, s/sqrt(m) after the third impact: acrylic is at rest
_FULL_FRAMES, _FULL_RATE = 9367, 10_000
_DROPS = "\n[[experiments.plate.drops]]"
_ON_PLATE = 'plate_from = "plate"\n'


@dataclass(frozen=True, slots=True)
class Part:
    """One recording session: what writes it, and the experiment and section that come of it."""

    names: tuple[str, ...]
    write: Callable[[], str]


def write_campaign(
    folder: Path, start: datetime, *, full_size: bool = False, workers: int = 2
) -> list[str]:
    """Write the whole campaign; returns the names of its experiments.

    Parameters
    ----------
    folder : Path
        The session folder.
    start : datetime
        Clock time of the first drop.
    full_size : bool
        Films at 1280 × 480 px and 9,367 frames (5.8 GB each) instead of about ten megabytes.
    workers : int
        Recordings written side by side; the files do not depend on it.
    """
    parts = _parts(folder, start, full_size)
    context = multiprocessing.get_context("forkserver")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        sections = list(pool.map(_write, [part.write for part in parts]))
    write_calibration_images(folder)
    _write_session(folder, sections, full_size)
    return [name for part in parts for name in part.names] + ["plate"]


def _write_session(folder: Path, sections: list[str], full_size: bool) -> None:
    """Write the calibration records, and session.toml with the plate's drops under one head."""
    records = {
        "laser": laser_record(),
        "laser_plate": plate_laser_record(),
        "camera_front": front_record(),
        "camera_under": under_record(is_binned=not full_size),
    }
    for name, text in records.items():
        files.write_text(folder / f"calibration/{name}.toml", text)
    head = session_head("Every experiment of the thesis (synthetic)")
    plate = plate_section([text for text in sections if text.startswith(_DROPS)])
    rest = [text for text in sections if not text.startswith(_DROPS)]
    files.write_text(folder / "session.toml", head + plate + "".join(rest))


def _write(task: Callable[[], str]) -> str:
    return task()


def _parts(folder: Path, start: datetime, full_size: bool) -> list[Part]:
    """List what is recorded, the longest first, so that two workers end together."""
    films = [
        Part((_film(h, None),), partial(_contact_film, folder, h, None, full_size))
        for h in reversed(HEIGHTS)
    ]
    films.insert(
        0,
        Part(
            (_film(HEIGHTS[-1], HEATED),),
            partial(_contact_film, folder, HEIGHTS[-1], HEATED, full_size),
        ),
    )
    rubber = Part(
        ("nbr_relaxation", "nbr_harmonic"),
        partial(_indentations, folder, start + timedelta(days=20)),
    )
    static = Part(("ptfe_static",), partial(_static, folder, start + timedelta(days=12)))
    front = Part(("ptfe_film",), partial(_front_film, folder, full_size))
    drops, rings = [], []
    for day, material in enumerate(POLYMERS):
        for number, height in enumerate(HEIGHTS):
            begun = start + timedelta(days=day, minutes=20 * number)
            name = f"{material}_{height_name(height)}"
            seed = 1000 * sum(map(ord, material)) + 100 * number
            drops.append(
                Part((name,), partial(_drops, folder, name, material, height, seed, begun))
            )
            later = begun + timedelta(days=5)
            rings.append(Part((), partial(_rings, folder, material, height, seed + 50, later)))
    begun = start + timedelta(days=10)
    heated = f"acrylic_{height_name(HEIGHTS[-1])}_{HEATED:g}C"
    drops.append(
        Part(
            (heated,),
            partial(_drops, folder, heated, "acrylic", HEIGHTS[-1], 9900, begun, HEATED),
        )
    )
    sweeps = [
        Part((f"{name}_dma",), partial(_dma, folder, name, 500 + number))
        for number, name in enumerate(SOLIDS)
    ]
    return [rubber, *films, static, front, *drops, *rings, *sweeps]


def _film(height: float, temperature: float | None) -> str:
    heated = "" if temperature is None else f"_{temperature:g}C"
    return f"acrylic_{height_name(height)}{heated}_film"


def _contact_film(folder: Path, height: float, temperature: float | None, full_size: bool) -> str:
    """Film the contact of acrylic through the disc."""
    name = _film(height, temperature)
    body = Body(materials.load("acrylic", temperature=temperature), height, floor=PLATE)
    if full_size:
        camera = replace(film_under.FULL_SIZE, release=5e-3)
        times = np.arange(_FULL_FRAMES, dtype=np.float64) / _FULL_RATE
    else:
        camera = _SMALL_UNDER
        rest = _REST + _REST_PER_ROOT_HEIGHT * float(np.sqrt(height))
        times = burst_times(body, camera.release, rest)
    seed = 3700 + round(1e4 * height) + (0 if temperature is None else 1)
    film = write_under(folder, f"{name}_under", body, camera, times, seed)
    return under_section(film, name, height, temperature=temperature, extra=_ON_PLATE)


def _front_film(folder: Path, full_size: bool) -> str:
    small = FrontCamera(rows=144, columns=128, duration=0.138)
    camera = film_front.FULL_SIZE if full_size else small
    film = write_front(folder, "ptfe", FRONT_HEIGHT, camera, 31, PLATE)
    return front_section(film, camera)


def _drops(
    folder: Path, name: str, material: str, height: float, seed: int, start: datetime,
    temperature: float | None = None,
) -> str:  # fmt: skip
    """Record the repeats of one height by the laser."""
    solid = materials.load(material, temperature=temperature)
    rig = DropRig(floor=PLATE)
    recordings = write_drops(folder, name, rig, solid, height, _REPEATS, seed, start)
    section = drop_section(name, recordings, height, material, _ON_PLATE)
    return section if temperature is None else f'{section}temperature = "{temperature:g} degC"\n'


def _rings(folder: Path, material: str, height: float, seed: int, start: datetime) -> str:
    return write_ringing_of(folder, PLATE_RIG, material, height, _PLATE_REPEATS, seed, start)


def _static(folder: Path, start: datetime) -> str:
    rig = StaticRig()
    file = write_static(folder, "ptfe_static", rig, materials.load("ptfe"), 90, start)
    return static_section("ptfe_static", file, rig, "ptfe")


def _indentations(folder: Path, start: datetime) -> str:
    return write_indentations(folder, NOTE, start)[1]


def _dma(folder: Path, material: str, seed: int) -> str:
    solid = SOLIDS[material]
    name = f"{material}_dma"
    return dma_section(name, write_dma(folder, name, solid, Protocol(), seed), solid)

"""The thesis's campaign as the virtual rig records it: every experiment on the same rig.

Spheres of four polymers fall from four heights, five times each, on a plate that rings; the laser
sees the holder, then the plate; a camera films PTFE from the front, another acrylic through the
disc, at room temperature and heated; PTFE is loaded step by step; rubber is indented by a punch;
all five materials go through the rheometer. Independent recordings are written side by side.
"""

import operator
import re
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from functools import partial
from math import sqrt
from pathlib import Path

import numpy as np

from labpipe import files
from labpipe.errors import LabpipeError
from labpipe.workflow.engines import Died, choose, side_by_side
from pipelines.rig import film_front, film_under, session_text
from pipelines.rig.apparatus import SPHERE
from pipelines.rig.calibration_images import write_calibration_images
from pipelines.rig.dma import CAMPAIGN, Protocol, sweeps
from pipelines.rig.drops import DropRig, write_drops
from pipelines.rig.film_front import FRONT_HEIGHT, FrontCamera, front_section, write_front
from pipelines.rig.film_under import Bursts, UnderCamera, burst_times, under_section, write_under
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
from pipelines.rig.plate import PLATE, PLATE_RIG, plate_section, write_ringing
from pipelines.rig.session_text import STATED, from_dma
from pipelines.rig.solids import ROOM, SAPPHIRE, SOLIDS, Viscoelastic, specimen_of
from pipelines.rig.static_loading import StaticRig, static_section, write_static

POLYMERS = ("acrylic", "nylon", "peek", "ptfe")
_TIMES_OF_FALL = {"acrylic": 22.0, "nylon": 16.0, "peek": 56.0, "ptfe": 4.0}
"""After so many a sphere is about at rest, from whatever height."""

_STATED = re.compile(r'(\w+) = "(\d[\d.]*) ± ([\d.]+)')
_DROPS = "\n[[experiments.plate.drops]]"
_ON_PLATE = 'plate_from = "plate"\n'


@dataclass(frozen=True, slots=True)
class Extent:
    """The extent of a campaign, and its instruments; by default the thesis's.

    ``heights`` are those of the drops that the laser and the camera under the disc see, on
    the plate too, ``front_height`` that of PTFE before the front camera. ``bursts`` says when the
    camera under the disc records; without it, it records evenly. ``to_rest``: laser and camera
    record a sphere until it rests, whatever the height, instead of as long as they say. ``seed`` is
    added to those of all recordings. Acrylic ``heated`` [degC] falls from the highest height; the thermometer is off by
    ``thermometer`` K. Of a sphere at rest ``at_rest`` s are recorded, and a record is a multiple of ``whole`` s long.
    """

    heights: tuple[float, ...] = SPHERE.heights
    ringing: tuple[str, ...] = POLYMERS
    repeats: int = 5
    plate_repeats: int = 3
    rig: DropRig = field(default_factory=lambda: DropRig(floor=PLATE))
    plate_rig: DropRig = PLATE_RIG
    under: UnderCamera = field(default_factory=lambda: UnderCamera(rows=160, columns=640))  # contacts need 550 px
    bursts: Bursts | None = field(default_factory=Bursts)
    front: FrontCamera = field(default_factory=lambda: FrontCamera(rows=144, columns=96, duration=0.32))  # figure 3.8
    front_height: float = FRONT_HEIGHT
    relaxation: Relaxation = field(default_factory=Relaxation)
    harmonic: Harmonic = field(
        default_factory=partial(Harmonic, frequencies=(0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 4.0))
    )
    dma: Protocol = CAMPAIGN
    to_rest: bool = True
    static: StaticRig = field(default_factory=StaticRig)
    seed: int = 0
    heated: float = 39.0
    thermometer: float = 0.4
    at_rest: float = 0.2
    whole: float = 0.05


THESIS = Extent()
"""Four materials, four heights, five repeats; films of about ten megabytes."""

FULL_SIZE = replace(THESIS, under=film_under.FULL_SIZE, bursts=None, front=film_front.FULL_SIZE)
"""The same with films at 1280 × 480 px and 9,367 frames, 5.8 GB each."""

SMALL = replace(
    THESIS,
    heights=SPHERE.heights[:1],
    ringing=("acrylic", "ptfe"),
    repeats=2,
    plate_repeats=1,
    rig=replace(THESIS.rig, sensor=replace(THESIS.rig.sensor, cycle=100e-6), duration=0.4),
    plate_rig=replace(PLATE_RIG, sensor=replace(PLATE_RIG.sensor, cycle=100e-6), duration=0.12),
    under=UnderCamera(rows=32),
    bursts=Bursts(spacing=2e-4, before=0.1e-3, after=1.1e-3, slow=20e-3, rest=0.4891411, frames_at_rest=6),
    front=FrontCamera(rows=52, columns=52, frame_rate=2000, duration=0.06),
    front_height=SPHERE.heights[0],
    relaxation=Relaxation(hold=12.0),
    harmonic=Harmonic(hold=10.0, frequencies=(0.5, 2.0), cycles=6),
    dma=replace(
        CAMPAIGN,
        frequencies=tuple(np.geomspace(10.0, 0.1, 6).tolist()),
        ramp=tuple(np.arange(-40.0, 121.0, 8.0).tolist()),
    ),
    to_rest=False,
)
"""Every kind once or twice, coarse and short: two megabytes, every figure can be drawn."""


def drawn(extent: Extent, seed: int) -> Extent:
    """Return a campaign with noise of its own, on a disc whose modulus is off that of the library by its u.

    What its session and records state is off the truth too, see :func:`misstated`.
    """
    disc = SAPPHIRE / (1.0 + 10 / 403 * float(np.random.default_rng(seed).standard_normal()))
    on_disc = {name: replace(getattr(extent, name), disc=disc) for name in ("rig", "plate_rig", "static")}
    return replace(extent, **on_disc, seed=1_000_000 * seed)


def misstated(text: str, extent: Extent, file: str) -> str:
    """Return a text of a session in which every value with ± is off the true one by chance, within its uncertainty.

    Equal statements are of one measurement, such as the mass of the sphere, but those of heights and of gains.
    """
    true = {("temperature", STATED.room): ROOM, ("temperature", extent.heated): extent.heated + extent.thermometer}
    true |= {("nu", float(nu.split()[0])): SOLIDS[name].nu for name, nu in session_text.STATED_NU.items()}
    lasers = {STATED.inclination: extent.rig, STATED.on_plate: extent.plate_rig}
    true |= {("inclination", deg): float(np.rad2deg(rig.sensor.inclination)) for deg, rig in lasers.items()}
    true |= {("scale", 1.0): 1.0 / TESTER.force_gain} if file == "load_cell.toml" else {}

    def off(match: re.Match[str]) -> str:
        name, value, u = match[1], float(match[2]), match[3]
        if (name, file) == ("scale", "session.toml"):
            return match[0]  # of a specimen's moduli: its error is drawn where its export is written
        hidden = 1e3 * extent.rig.height_scatter * (name == "height")  # the error of a height holds that of the release
        place = [*file.encode(), match.start()] if name in ("height", "scale") else []
        random = np.random.default_rng([extent.seed, *match[0].encode(), *place])
        while True:
            found = true.get((name, value), value) + sqrt(float(u) ** 2 - hidden**2) * random.standard_normal()
            if name != "nu" or found < 0.5:  # nobody states more for an isotropic solid
                return f'{name} = "{found:.{len(u)}f} ± {u}'

    return _STATED.sub(off, text)


Part = tuple[tuple[str, ...], Callable[[], str]]
"""One recording session: its experiments, and the function that writes them and returns their sections."""


def write_campaign(
    folder: Path,
    start: datetime,
    extent: Extent = THESIS,
    *,
    title: str = "Every experiment of the thesis",
    only: Collection[str] = (),
    workers: int = 2,
) -> list[str]:
    """Write a campaign that begins with a drop at ``start``; returns the names of its experiments.

    ``only``: these experiments, by default all. Recordings are written side by side by some workers; the files do not
    depend on it.
    """
    parts = [part for part in _parts(folder, start, extent) if not only or set(part[0]) & set(only)]
    found: dict[int, str] = {}
    tasks = {number: (write,) for number, (_, write) in enumerate(parts)}
    for number, section in side_by_side(choose(workers), operator.call, tasks):
        if isinstance(section, Died):
            raise LabpipeError(f"recording {', '.join(parts[number][0])}: {section}; too little memory?")
        found[number] = section
    if extent is not SMALL and not only:
        write_calibration_images(folder)
    # the plate's drops under one head, before all others
    drops = [found[number] for number in tasks if found[number].startswith(_DROPS)]
    rest = "".join(found[number] for number in tasks if not found[number].startswith(_DROPS))
    sections = (plate_section(drops) if drops else "") + rest
    session_text.write_session(folder, title, sections, is_binned=extent.bursts is not None)
    if extent.seed:
        for path in (folder / "session.toml", *(folder / "calibration").glob("*.toml")):
            files.write_text(path, misstated(path.read_text("utf-8"), extent, path.name))
    return list(dict.fromkeys(name for names, _ in parts for name in names))


def _parts(folder: Path, start: datetime, extent: Extent) -> list[Part]:
    """List the recordings, the longest first, so that two workers end together."""
    highest = max(extent.heights)
    filmed = [(highest, extent.heated), *((height, None) for height in reversed(extent.heights))]
    drops: list[tuple[str, float, float | None, int, datetime]] = []
    rings: list[Part] = []
    for day, material in enumerate(POLYMERS):
        for number, height in enumerate(extent.heights):
            begun = start + timedelta(days=day, minutes=20 * number)
            seed = extent.seed + 1000 * sum(map(ord, material)) + 100 * number
            drops.append((material, height, None, seed, begun))
            if material in extent.ringing:
                of = (extent.plate_rig, material, height, extent.plate_repeats, seed + 50, begun + timedelta(days=5))
                rings.append((("plate",), partial(write_ringing, folder, *of)))
    drops.append(("acrylic", highest, extent.heated, extent.seed + 9900, start + timedelta(days=10)))
    rheometer = partial(sweeps, folder, protocol=extent.dma, seed=extent.seed)
    return [
        (("nbr_relaxation", "nbr_harmonic"), partial(_punched, folder, start + timedelta(days=20), extent)),
        *(((f"{_name('acrylic', *one)}_film",), partial(_contact_film, folder, *one, extent)) for one in filmed),
        (("ptfe_static",), partial(_static, folder, start + timedelta(days=12), extent)),
        (("ptfe_film",), partial(_front_film, folder, extent)),
        *(((_name(*one[:3]),), partial(_drops, folder, extent, *one)) for one in drops),
        *rings,
        *(((session_text.dma_name(name),), partial(rheometer, name)) for name in SOLIDS),
    ]


def _name(material: str, height: float, temperature: float | None) -> str:
    return f"{material}_{session_text.height_name(height)}" + ("" if temperature is None else f"_{temperature:g}C")


def _specimen(extent: Extent, material: str, temperature: float | None) -> Viscoelastic:
    """Return a solid in the room or heated: the thermometer is a little off, within its u of 1 K."""
    return specimen_of(material, None if temperature is None else temperature + extent.thermometer)


def _until_rest(extent: Extent, material: str, height: float) -> float:
    """Return how long after its release [s] a sphere is surely at rest."""
    return _TIMES_OF_FALL[material] * float(np.sqrt(2 * height / SPHERE.gravity)) + extent.at_rest


def _punched(folder: Path, start: datetime, extent: Extent) -> str:
    """Indent rubber: relaxations, then oscillations three hours later, and the record of the load cell."""
    specimen, names = Specimen(specimen_of("nbr")), ("nbr_relaxation", "nbr_harmonic")
    recordings = write_relaxation(folder, names[0], specimen, extent.relaxation, TESTER, extent.seed + 70, start)
    begun = start + timedelta(hours=3)
    write_harmonic(folder, names[1], specimen, extent.harmonic, TESTER, extent.seed + 80, begun)
    files.write_text(folder / "calibration/load_cell.toml", session_text.cell_record())
    relaxed = relaxation_section(names[0], recordings, specimen, from_dma("nbr"))
    return relaxed + oscillation_section(names[1], specimen, from_dma("nbr"))


def _static(folder: Path, start: datetime, extent: Extent) -> str:
    """Load PTFE step by step; the loads are stated as they should have been put on."""
    file = write_static(folder, "ptfe_static", extent.static, specimen_of("ptfe"), extent.seed + 90, start)
    return static_section("ptfe_static", file, StaticRig(), "ptfe", from_dma("ptfe"))


def _contact_film(folder: Path, height: float, temperature: float | None, extent: Extent) -> str:
    """Film the contact of acrylic through the disc."""
    name = f"{_name('acrylic', height, temperature)}_film"
    body = extent.rig.body(_specimen(extent, "acrylic", temperature), height)
    times = film_under.FULL_TIMES
    if extent.bursts is not None:
        rest = _until_rest(extent, "acrylic", height) if extent.to_rest else extent.bursts.rest
        times = burst_times(body, extent.under.release, replace(extent.bursts, rest=rest))
    seed = extent.seed + 3700 + round(1e4 * height) + (0 if temperature is None else 1)
    film = write_under(folder, f"{name}_under", body, extent.under, times, seed)
    return under_section(film, name, height, extra=_ON_PLATE, source=from_dma("acrylic", temperature))


def _front_film(folder: Path, extent: Extent) -> str:
    film = write_front(folder, "ptfe", extent.front_height, extent.front, extent.seed + 31, extent.rig)
    return front_section(film, extent.front, extent.front_height)


def _drops(
    folder: Path, extent: Extent, material: str, height: float, temperature: float | None, seed: int, start: datetime
) -> str:
    """Record the repeats of one height by the laser."""
    rig, name = extent.rig, _name(material, height, temperature)
    if extent.to_rest:
        duration = rig.release + _until_rest(extent, material, height)
        rig = replace(rig, duration=float(np.ceil(duration / extent.whole) * extent.whole))
    solid = _specimen(extent, material, temperature)
    recordings = write_drops(folder, name, rig, solid, height, extent.repeats, seed, start)
    return session_text.drop_section(name, recordings, height, material, _ON_PLATE, from_dma(material, temperature))

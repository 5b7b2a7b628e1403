"""Deviations of measurement and model by the thesis's own chain, over many specimens.

``python -m tests.pipelines.deviations --seeds 30`` records one session of every kind for every seed. All that is stated
with ± has a random error of that size. A deviation is measured minus model, over its standard uncertainty.
"""

import argparse
import re
import sys
import tempfile
import warnings
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from labpipe import files
from pipelines.experiments import KINDS
from pipelines.rig.campaign import SMALL
from pipelines.rig.dma import write_dma
from pipelines.rig.drops import Body, DropRig, LaserSensor, write_drops
from pipelines.rig.film_under import Bursts, burst_times, under_section, write_under
from pipelines.rig.indentations import (
    TESTER,
    Specimen,
    oscillation_section,
    relaxation_section,
    write_harmonic,
    write_relaxation,
)
from pipelines.rig.plate import PLATE_RIG, plate_section, write_ringing
from pipelines.rig.reference_drop import Floor
from pipelines.rig.samples import STATED_FLOOR
from pipelines.rig.session_text import (
    cell_record,
    dma_name,
    dma_section,
    drop_section,
    from_dma,
    laser_record,
    plate_laser_record,
    under_record,
)
from pipelines.rig.solids import SOLIDS, specimen_of
from pipelines.rig.static_loading import StaticRig, static_section, write_static
from pipelines.session import derive, opened, process
from tests.pipelines.coverage import POLYMERS, Scores, drawn, rows_of
from tests.pipelines.sessions import begun
from tests.pipelines.small import START

_HEIGHTS = (1.5e-3, 5e-3, 10e-3)
_MOST_NU = 0.5
_LIGHT = 1e-3  # relative; that of 3 degrees
_NU = re.compile(r'nu = "[\d.]+ ± ([\d.]+)"')


def write_specimens(folder: Path, seed: int, *, drops_only: bool = False) -> None:
    """Write one session whose true values differ from the stated ones within their uncertainties."""
    random = np.random.default_rng(seed)
    polymer, height = POLYMERS[seed % 4], _HEIGHTS[seed % 3]
    room = 20.0 + 0.5 * random.standard_normal()
    body = {"radius": 9.525e-3 + 5e-6 * random.standard_normal(), "mass": 0.505 + 0.5e-3 * random.standard_normal()}
    angle, of_plate = np.deg2rad(np.array([12.0, 5.0]) + 0.1 * random.standard_normal(2)).tolist()
    table = Floor(1450 + 100 * random.standard_normal(), 390 + 20 * random.standard_normal(), 0.03)
    ringing = Floor(random.uniform(20, 60), random.uniform(170, 300), random.uniform(0.02, 0.05))
    on_plate = seed % 2 == 0
    fallen = height + 5e-6 * random.standard_normal()
    drops = DropRig(sensor=LaserSensor(inclination=angle), floor=ringing if on_plate else table, duration=0.3, **body)
    names = write_drops(folder, "drop", drops, specimen_of(polymer, room), fallen, 2, 1000 * seed, START)
    floor = 'plate_from = "plate"\n' if on_plate else STATED_FLOOR
    text = drop_section("drop", names, height, polymer, floor, from_dma(polymer))
    if on_plate:
        rig = replace(PLATE_RIG, floor=ringing, duration=0.12, **body)
        rig = replace(rig, sensor=replace(rig.sensor, inclination=of_plate))
        rung = [
            write_ringing(folder, rig, name, h, 1, 1000 * seed + 10 * i, START)
            for i, (name, h) in enumerate(((polymer, 5e-3), ("ptfe", 10e-3)))
        ]
        text += plate_section(rung)
    if not drops_only:
        stated = StaticRig()
        loads = replace(stated, radius=body["radius"], sensor=replace(stated.sensor, inclination=angle))
        file = write_static(folder, "static", loads, specimen_of("ptfe", room), 1000 * seed + 20, START)
        text += static_section("static", file, stated, "ptfe", from_dma("ptfe"))
        text += _indentations(folder, room, seed, random)
        if polymer != "ptfe":  # its contact is wider than the image
            text += _film(folder, polymer, room, body, seed, random)
    swept = {polymer} | ({"ptfe"} if on_plate or not drops_only else set()) | (set() if drops_only else {"nbr"})
    for number, material in enumerate(sorted(swept)):
        name, solid = dma_name(material), SOLIDS[material]
        export = write_dma(folder, name, solid, SMALL.dma, 10 * seed + number)
        error = random.standard_normal()
        section = dma_section(name, export, solid)
        u = float(_NU.findall(section)[0])
        while solid.nu + error * u > _MOST_NU:  # nobody states more for an isotropic solid
            error = random.standard_normal()
        text += _NU.sub(f'nu = "{solid.nu + error * u:.5f} ± {u:g}"', section)
    delay = cell_record().replace('"15.9 ± 0.2 ms"', f'"{15.915 + 0.2 * random.standard_normal():.4f} ± 0.2 ms"')
    gains = [
        record.replace('scale = "1.0000 ±', f'scale = "{1 + 5e-4 * random.standard_normal():.6f} ±')
        for record in (laser_record(), plate_laser_record())
    ]
    begun(folder, text, laser=gains[0], laser_plate=gains[1], load_cell=delay)


def _indentations(folder: Path, room: float, seed: int, random: np.random.Generator) -> str:
    stated = Specimen(specimen_of("nbr", room))
    true = drawn(stated, random)
    tester = replace(TESTER, force_gain=1 / (1 + 1e-3 * random.standard_normal()), force_offset=0.3)
    held, wave = replace(SMALL.relaxation, depths=(0.1e-3, 0.2e-3)), SMALL.harmonic
    # noise of its own for every file of every session
    names = write_relaxation(folder, "relaxation", true, held, tester, 1000 * seed + 30, START)
    write_harmonic(folder, "harmonic", true, wave, tester, 1000 * seed + 40, START)
    source = from_dma("nbr")
    return relaxation_section("relaxation", names, stated, source) + oscillation_section("harmonic", stated, source)


def _film(
    folder: Path, polymer: str, room: float, sphere: dict[str, float], seed: int, random: np.random.Generator
) -> str:
    """Film the first impact from 1.5 mm on a rigid floor through the disc."""
    stated, height = SMALL.under, 1.5e-3
    # what a cone of light and a lens make of the fringes' scale acts as another wavelength
    camera = replace(
        stated,
        pixel_size=stated.pixel_size * (1 + random.standard_normal() / 461),
        wavelength=stated.wavelength * (1 + _LIGHT * random.standard_normal()),
    )
    body = Body(specimen_of(polymer, room), height + 5e-6 * random.standard_normal(), floor=Floor(), **sphere)
    times = burst_times(body, camera.release, SMALL.bursts or Bursts())
    film = write_under(folder, "film", body, camera, times, 1000 * seed + 50)
    files.write_text(folder / "calibration/camera_under.toml", under_record())
    return under_section(film, "film", height, source=from_dma(polymer))


def deviations(folder: Path) -> Iterator[tuple[str, str, float]]:
    """Process a session; yield kind, quantity and deviation of every row that has one."""
    outcome = process(folder, ["judgement"], jobs=0)
    failed = [o.message for o in outcome.failures]
    if failed:
        raise RuntimeError(failed)
    results = opened(folder)
    for experiment in results.experiments.values():
        rows = KINDS[experiment.kind].rows
        for row in () if rows is None else derive(results, experiment, rows):
            if row.deviation is not None:
                yield experiment.kind, row.quantity.partition(",")[0], row.deviation


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--first", type=int, default=0)
    chosen = parser.parse_args()
    found: dict[str, Scores] = defaultdict(lambda: defaultdict(list))
    for seed in range(chosen.first, chosen.first + chosen.seeds):
        with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            folder = Path(name)
            write_specimens(folder, seed)
            for kind, quantity, deviation in deviations(folder):
                found[kind][quantity].append(deviation)
    for kind, scores in sorted(found.items()):
        sys.stdout.write("\n".join([*rows_of(kind, chosen.seeds, dict(sorted(scores.items()))), ""]))


if __name__ == "__main__":
    main()

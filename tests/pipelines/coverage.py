"""Stated uncertainties against the truth of the virtual rig, for every kind of experiment.

``python -m tests.pipelines.coverage [KIND ...] [--seeds N]`` prints the table of ``labpipe/documentation/evidence.md``.
All that is stated with ± is wrong by as much, drawn anew with every seed; readings carry their noise.

A kind is a function that makes one experiment from a seed, measures it, and notes the errors in
units of their stated standard uncertainties.
"""

import argparse
import re
import sys
import tempfile
import warnings
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from labpipe import materials
from labpipe.errors import InputError
from labpipe.units import Quantity
from pipelines.experiments.ball_drop import measured as ball_drop
from pipelines.experiments.contact_area import measured as contact_area
from pipelines.experiments.dic_validation import measured as dic_validation
from pipelines.experiments.dma import measured as dma, model as dma_model
from pipelines.experiments.harmonic import measured as harmonic
from pipelines.experiments.plate_vibration import measured as plate_vibration, model as plate_vibration_model
from pipelines.experiments.relaxation import measured as relaxation
from pipelines.experiments.shared import laser_readings, mach1_readings
from pipelines.experiments.shared.punch_model import Geometry, elastic_force
from pipelines.experiments.static_loading import measured as static_loading
from pipelines.rig.campaign import SMALL
from pipelines.rig.dma import write_dma
from pipelines.rig.drops import Body, DropRig, LaserSensor, write_drops
from pipelines.rig.film_front import FrontCamera, front_section, write_front
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
from pipelines.rig.plate import PLATE_RIG, plate_section, write_ringing
from pipelines.rig.reference_drop import Floor
from pipelines.rig.session_text import (
    cell_record,
    dma_name,
    dma_section,
    drop_section,
    front_record,
    laser_record,
    plate_laser_record,
    under_record,
)
from pipelines.rig.solids import SOLIDS
from pipelines.rig.static_loading import StaticRig, static_section, write_static
from tests.pipelines.sessions import begun, settings_of, truth
from tests.pipelines.small import START
from tests.pipelines.sweeps import FEW, settings_for

Scores = dict[str, list[float]]
Kind = Callable[[Path, int, Scores], None]

_REFUSED = 0.05  # of the experiments, at most
INSIDE = 1.96
"""Standard uncertainties within which 95 % of the errors shall lie."""

POLYMERS = ("acrylic", "nylon", "peek", "ptfe")
_HEIGHTS = (1.5e-3, 5e-3, 7e-3, 10e-3)


def note(scores: Scores, name: str, error: object, u: object) -> None:
    """Keep errors over their standard uncertainties."""
    z = np.atleast_1d(np.asarray(error, float) / np.asarray(u, float))
    scores[name] += z[np.isfinite(z)].tolist()


def noted(
    scores: Scores, found: Any, known: Mapping[str, Any], names: Sequence[str], at: Any = 0, suffix: str = ""
) -> None:
    """Keep the errors of quantities at a place of a result, whose truths go by the same names."""
    for name in names:
        error = np.atleast_1d(found[name].values)[at] - known[name]
        note(scores, name.replace("_", " ") + suffix, error, np.atleast_1d(found[f"u_{name}"].values)[at])


def ball_drops(folder: Path, seed: int, scores: Scores) -> None:
    """Drops on floors from stiff to light: single bounces, and the mean of two repeats."""
    random = np.random.default_rng(seed)
    floor = Floor(float(np.exp(random.uniform(np.log(20), np.log(2000)))), float(random.uniform(100, 450)), 0.03)
    angle = float(np.deg2rad(12 + random.normal(0.0, 0.1)))
    rig = DropRig(floor=floor, duration=0.12, sensor=LaserSensor(inclination=angle))
    solid, height = POLYMERS[seed % 4], _HEIGHTS[(seed // 4) % 4]
    names = write_drops(folder, "d", rig, materials.load(solid), height, 2, 1000 * seed, START)
    begun(folder, drop_section("d", names, height, solid), laser=laser_record())
    settings, parts = settings_of(folder, "d"), []
    for name in names:
        readings = laser_readings.readings(folder / name, settings=settings)
        moved = ball_drop.displacement(readings, folder / "calibration/laser.toml", settings=settings)
        parts.append((moved, ball_drop.bounces(moved, settings=settings)))
    known = [truth(folder, f"d_{i}") for i in (1, 2)]
    for (_, found), one in zip(parts, known, strict=True):
        some = slice(min(3, found.sizes["impact"], len(one["liftoff_time"])))
        names = ("restitution", "incoming_speed", "outgoing_speed", "touch_time", "liftoff_time")
        noted(scores, found, {name: one[name][some] for name in names}, names, some)
    slow = [ball_drop.velocity(*part, settings=settings) for part in parts]
    moved, found = ([p[i] for p in parts] for i in (0, 1))
    made = ball_drop.repeats(moved, slow, found, settings=settings)
    some = slice(min(3, made.sizes["impact"], *(len(one["liftoff_time"]) for one in known)))
    names = ("restitution", "outgoing_speed")
    mean = {name: np.mean([one[name][some] for one in known], axis=0) for name in names}
    noted(scores, made, mean, names, some, ", mean of two")


def plates(folder: Path, seed: int, scores: Scores) -> None:
    """A plate whose mass, frequency and damping are drawn, heard under one drop of a solid known by its DMA."""
    random = np.random.default_rng(seed)
    floor = Floor(float(random.uniform(20, 60)), float(random.uniform(170, 300)), float(random.uniform(0.02, 0.05)))
    angle = float(np.deg2rad(5 + random.normal(0.0, 0.1)))
    sensor = replace(PLATE_RIG.sensor, inclination=angle)
    rig = replace(PLATE_RIG, floor=floor, sensor=sensor, duration=0.12)
    solid, height = POLYMERS[seed % 4], _HEIGHTS[(seed // 4) % 4]
    table = write_ringing(folder, rig, solid, height, 1, 1000 * seed, START)
    (name,) = re.findall(r'"(laser_plate/.*)"', table)
    export = write_dma(folder, dma_name(solid), SOLIDS[solid], SMALL.dma, seed)
    sections = plate_section([table]) + dma_section(dma_name(solid), export, SOLIDS[solid])
    begun(folder, sections, laser_plate=plate_laser_record())
    settings, sweeps = settings_of(folder, "plate"), settings_of(folder, dma_name(solid))
    curve = dma_model.master_curve(
        dma.sweeps([dma.readings(folder / export, settings=sweeps)], settings=sweeps), settings=sweeps
    )
    readings = laser_readings.readings(folder / name, settings=settings)
    record = folder / "calibration/laser_plate.toml"
    moved = laser_readings.displacement(readings, record, settings=settings)
    ringing = plate_vibration.ringing(moved, settings=settings)
    found, known = plate_vibration.table([ringing], settings=settings), truth(folder, Path(name).stem)
    noted(scores, found, known, ("natural_frequency", "damping_ratio", "amplitude"))
    note(scores, "time of impact", float(ringing["blow_time"]) - known["blow_time"], float(ringing["u_blow_time"]))
    made = plate_vibration_model.plate(found, [curve], settings=settings)
    note(scores, "modal mass", float(made["mass"]) - floor.mass, float(made["u_mass"]))


def static_loadings(folder: Path, seed: int, scores: Scores) -> None:
    """A static loading whose sensor and sphere differ from what is stated."""
    random, stated = np.random.default_rng(seed), StaticRig()
    angle = np.deg2rad(12 + random.normal(0.0, 0.1))
    sensor = LaserSensor(inclination=float(angle), noise=stated.sensor.noise)
    rig = replace(stated, radius=stated.radius + random.normal(0.0, 5e-6), sensor=sensor)
    file = write_static(folder, "s", rig, materials.load("ptfe"), seed, START)
    begun(folder, static_section("s", file, stated, "ptfe"), laser=laser_record())
    settings = settings_of(folder, "s")
    moved = static_loading.displacement(
        laser_readings.readings(folder / file, settings=settings), folder / "calibration/laser.toml", settings=settings
    )
    steps = static_loading.steps(moved, settings=settings)
    found = static_loading.approach(moved, steps, settings=settings)
    known, time = truth(folder, "s"), found["time"].values
    approach = np.interp(time, known["time"], known["approach"])
    radius = np.sqrt(stated.radius * approach)
    seen = np.isfinite(found["contact_radius"].values) & (time > 10.0)
    some = np.flatnonzero(seen)[:: max(int(seen.sum()) // 12, 1)]
    noted(scores, found, {"contact_radius": radius[some]}, ("contact_radius",), some)
    for load, edges in enumerate(zip(steps["begin"].values, steps["end"].values, strict=True)):
        first, last = (approach[w].mean() for w in static_loading.windows(time, edges, settings))
        reached = {"level_approach": last, "creep": last - first}
        noted(scores, found, reached, tuple(reached), load, " under a load")


def relaxations(folder: Path, seed: int, scores: Scores) -> None:
    """A relaxation with a punch, a cell and a surface not quite as stated."""
    specimen, tester = _specimen(seed)
    held = Relaxation(depths=(0.1e-3,), hold=12.0)
    names = write_relaxation(folder, "r", specimen, held, tester, seed, START)
    begun(folder, relaxation_section("r", names, _STATED), load_cell=cell_record())
    settings, record = settings_of(folder, "r"), folder / "calibration/load_cell.toml"
    read = mach1_readings.readings(folder / names[0], settings=settings)
    loads = mach1_readings.loads(read, record, settings=settings)
    ramps = relaxation.ramps(loads, settings=settings)
    curves = relaxation.curves(loads, ramps, None, None, settings=settings)
    known = truth(folder, Path(names[0]).stem)
    noted(scores, ramps, known, ("plateau_force", "depth"))
    note(scores, "first touch", float(ramps["contact_position"]) - known["surface"], ramps["u_contact_position"].values)
    # The plateau's own modulus is asked for here, not the relaxed one that it still falls to.
    punch = msgspec.structs.replace(
        settings.punch, radius=Quantity(specimen.tip_radius, 0.0, "m"), depth=Quantity(specimen.depth, 0.0, "m")
    )
    real = Geometry.of(punch, settings.substrate, settings.model, 0.5)
    modulus = known["plateau_force"] / float(elastic_force(np.array([0.1e-3]), real)[0])
    unfinished = float(ramps["unfinished"][0] / ramps["plateau_force"][0])
    found, u = (float(curves[f"{p}reduced_modulus"][0]) for p in ("", "u_"))
    note(scores, "modulus of the plateau", found - modulus, np.sqrt(u**2 - (unfinished * found) ** 2))


def oscillations(folder: Path, seed: int, scores: Scores) -> None:
    """Oscillations slow and fast; the record's delay of the filter is wrong within its u too."""
    specimen, tester = _specimen(seed)
    wave = Harmonic(hold=2.0, frequencies=(0.5, 2.0), cycles=6)
    write_harmonic(folder, "h", specimen, wave, tester, seed + 1, START)
    delay = 15.915 + 0.2 * np.random.default_rng(seed + 77_000).normal()
    record = cell_record().replace('"15.9 ± 0.2 ms"', f'"{delay:.4f} ± 0.2 ms"')
    begun(folder, oscillation_section("h", _STATED), load_cell=record)
    settings = settings_of(folder, "h")
    readings = mach1_readings.readings(folder / settings.mach1, settings=settings)
    loads = mach1_readings.loads(readings, folder / "calibration/load_cell.toml", settings=settings)
    found = harmonic.oscillations(loads, settings=settings)
    parts = "frequency", "amplitude", "force_amplitude", "storage_stiffness", "loss_stiffness", "work_per_cycle"
    for i, known in enumerate(truth(folder, "h")["oscillations"]):
        noted(scores, found, known, parts, i)


_STATED = Specimen(materials.load("nbr"))


def drawn(stated: Specimen, random: np.random.Generator) -> Specimen:
    """Return a punch and a surface off what is stated within its uncertainty."""
    return replace(
        stated,
        tip_radius=stated.tip_radius + random.normal(0.0, 2e-6),
        depth=stated.depth + random.normal(0.0, 6e-6),
        surface=stated.surface + random.normal(0.0, 1e-5),
    )


def _specimen(seed: int) -> tuple[Specimen, Any]:
    """Draw what differs from the stated punch, surface and load cell, and how far the stage is from what it is asked.

    One and the same oscillation would be rounded to the same steps in every file, and err by one draw alone.
    """
    random = np.random.default_rng(seed)
    specimen = drawn(_STATED, random)
    gain, offset = 1 / (1 + random.normal(0.0, 1e-3)), random.normal(0.0, 0.3)
    slow, wide = TESTER.frequency_error * random.uniform(0.5, 1.5), TESTER.amplitude_error * random.uniform(0.5, 1.5)
    tester = replace(TESTER, force_gain=gain, force_offset=offset, frequency_error=slow, amplitude_error=wide)
    return specimen, tester


def rheometers(folder: Path, seed: int, scores: Scores) -> None:
    """Five isotherms of a solid that no sum of exponentials equals, noise 1 % and 2 %."""
    name = POLYMERS[seed % 4]
    solid = SOLIDS[name]
    at = min(solid.T_ref, 20.0)  # within these few sweeps
    export = write_dma(folder, name, solid, FEW, seed)
    settings = settings_for(name, export, T_ref=Quantity(at, 0.0, "degC"))
    read = dma.readings(folder / export, settings=settings)
    found = dma_model.master_curve(dma.sweeps([read], settings=settings), settings=settings)
    shift = np.array(truth(folder, name)["log10_aT"]) - solid.log10_aT(at)
    note(scores, "shift factors", found["log10_aT"].values - shift, found["u_log10_aT"].values)
    frequency = found["reduced_frequency"].values
    true = solid.modulus(frequency, np.full(frequency.size, at))
    for part, values in (("storage", true.real), ("loss", true.imag)):
        note(scores, f"{part} modulus", found[f"master_{part}"].values - values, found[f"u_master_{part}"].values)


def films_from_below(folder: Path, seed: int, scores: Scores) -> None:
    """The first impact through the disc; pixel size, wavelength and sphere off within their u."""
    random, stated = np.random.default_rng(seed), UnderCamera(samples=3, moments=2)
    camera = replace(
        stated,
        pixel_size=stated.pixel_size * (1 + random.normal(0.0, 1 / 461)),
        centre=tuple(random.uniform(-5, 5, 2).tolist()),
    )
    material, height = POLYMERS[seed % 3], 1.5e-3
    body = Body(materials.load(material), height, radius=9.525e-3 + random.normal(0.0, 5e-6), floor=Floor())
    times = burst_times(body, camera.release, Bursts(spacing=2e-4, slow=10e-3))
    film = write_under(folder, "u", body, camera, times[times < 0.023], seed)
    begun(folder, under_section(film, "u", height), camera_under=under_record())
    settings, record = settings_of(folder, "u"), folder / "calibration/camera_under.toml"
    found = contact_area.radius(folder / film, record, settings=settings, full=False)
    made = contact_area.impacts(found, settings=settings)
    known = truth(folder, "u")
    radius = np.array(known["contact_radius"])[found["frame"].values]
    seen = found["in_contact"].values.astype(bool) & (radius > 100e-6)
    u = np.hypot(found["u_radius"].values, found["radius_systematic"].values)
    u = np.hypot(u, known["resolution"] / np.sqrt(3))  # the truth itself is not known better
    note(scores, "contact radius", (found["radius"].values - radius)[seen], u[seen])
    largest = float(made["peak_radius"][0]) - known["peak_contact_radius"]
    note(scores, "largest radius", largest, float(made["u_peak_radius"][0]))


def films_from_the_front(folder: Path, seed: int, scores: Scores) -> None:
    """The holder filmed while it falls and bounces; the pixel size off within its u."""
    random = np.random.default_rng(seed)
    camera = FrontCamera(rows=72, columns=48, frame_rate=4000, duration=0.05, release=0.006)
    size = camera.pixel_size * (1 + random.normal(0.0, np.hypot(1.5 / 386, 0.02 / 30)))
    camera = replace(camera, pixel_size=size)
    height, material = 1.5e-3, POLYMERS[seed % 4]
    film = write_front(folder, material, height, camera, seed)
    laser = write_drops(folder, "d", DropRig(duration=0.06), materials.load(material), height, 1, seed, START)
    sections = drop_section("ptfe_1p5mm", laser, height, material)
    begun(folder, sections + front_section(film, camera, height), camera_front=front_record(), laser=laser_record())
    settings = settings_of(folder, "ptfe_film")
    track = dic_validation.track(folder / film, settings=settings, full=False)
    record = folder / "calibration/camera_front.toml"
    moved = dic_validation.motion(track, record, settings=settings)
    known = truth(folder, f"{material}_front")
    frame = np.searchsorted(known["time"], moved["time"].values - 1e-9)
    fallen = np.array(known["dy"])[frame] * size
    some = slice(30, None, 5)
    relative = float(moved.attrs["u_systematic_relative"])
    error = moved["displacement"].values + fallen
    u = np.hypot(moved["u_displacement"].values, relative * fallen)
    note(scores, "displacement", (error - error[:20].mean())[some], u[some])
    pixels = track["dy"].values[:, 0] - np.array(known["dy"])[track["frame"].values]
    note(scores, "displacement in px", pixels[some], track["u_dy"].values[some, 0])
    bounces = dic_validation.bounces(moved, settings=settings)
    touched, u_touched = (float(bounces[f"{p}first_contact_time"]) for p in ("", "u_"))
    note(scores, "first contact", touched - known["touch_time"][0], u_touched)
    speed = dic_validation.velocity(moved, bounces, settings=settings)
    # In the fall the truth is gravity's.
    time = moved["time"].values
    since = time - known["release_time"]
    inside = (since > 1e-3) & (time < known["touch_time"][0] - 1e-3)
    some = np.flatnonzero(inside)[::7]
    true = -9.81 * since[some]
    u = np.hypot(speed["u_velocity"].values[some], relative * true)
    note(scores, "velocity in the fall", speed["velocity"].values[some] - true, u)


KINDS: dict[str, tuple[Kind, int]] = {
    "ball_drop": (ball_drops, 80),
    "plate_vibration": (plates, 80),
    "static_loading": (static_loadings, 40),
    "relaxation": (relaxations, 40),
    "harmonic": (oscillations, 60),
    "dma": (rheometers, 80),
    "contact_area": (films_from_below, 45),
    "dic_validation": (films_from_the_front, 40),
}
"""What makes and measures one experiment of each kind, and how many seeds a whole sweep takes."""


def swept(kind: str, seeds: int, folder: Path, first: int = 0) -> Scores:
    """Errors over uncertainties of as many experiments of one kind, each in a folder of its own."""
    scores: Scores = defaultdict(list)
    refused: list[str] = []
    for seed in range(first, first + seeds):
        place = folder / f"{kind}_{seed}"
        place.mkdir()
        try:
            KINDS[kind][0](place, seed, scores)
        except InputError as error:  # a recording that does not tell what is asked; the rows say how many
            refused.append(f"{kind} {seed} is refused: {error}")
            if len(refused) > _REFUSED * seeds:
                raise
    sys.stderr.write("".join(f"{line}\n" for line in refused))
    return scores


def share(z: Sequence[float]) -> float:
    """Share of the errors that lie in their 95 % intervals."""
    return float(np.mean(np.abs(z) <= INSIDE))


def rows_of(kind: str, seeds: int, scores: Scores) -> list[str]:
    """Rows of the table: coverage, mean and root mean square of error over uncertainty."""
    return [
        f"| {kind} | {name} | {seeds} | {len(z)} | {share(z):.3f} | {np.mean(z):+.2f} | "
        f"{np.sqrt(np.mean(np.square(z))):.2f} |"
        for name, z in scores.items()
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kinds", nargs="*", choices=[*KINDS, []], default=[])
    parser.add_argument("--seeds", type=int, help="experiments of each kind")
    chosen = parser.parse_args()
    for kind in chosen.kinds or KINDS:
        seeds = chosen.seeds or KINDS[kind][1]
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = rows_of(kind, seeds, swept(kind, seeds, Path(folder)))
        sys.stdout.write("\n".join([*found, ""]))
        sys.stdout.flush()


if __name__ == "__main__":
    main()

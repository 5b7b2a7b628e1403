"""Every shortcut that can be switched off: work, time and result with and without it."""

import itertools
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import instruments
from instruments import phantom
from labpipe import contact, imaging, materials
from labpipe.arrays import Floats
from labpipe.contact import Shortcuts
from labpipe.contact.memory import Creep, advance, history, step_weights
from labpipe.materials import Prony
from pipelines import process as verbs
from pipelines.bench import sessions
from pipelines.bench.dic import make_film
from pipelines.bench.measure import CLOCK, Point, Suite, paired
from pipelines.experiments.dic_validation import measured as dic_validation
from pipelines.experiments.dic_validation.settings import DicValidation, Tracking

_SPHERE, _MASS, _HEIGHT = 9.525e-3, 0.505, 1.5e-3
#: A drop that flies long, and one (m) that comes to rest soon: after 0.24 s in acrylic.
_HIGH, _LOW = 10e-3, 2e-5
#: Rounds of a shortcut end once its runs together took longer than this (s).
_BUDGET = 10.0
#: Swing, relative to the sag under its weight, below which a sphere counts as resting (``rtol``).
_STILL = 1e-4
#: A spectrum as fine as a master curve may give: many terms (s) lie outside of any drop's times.
_MANY_TERMS = np.geomspace(1e-12, 1e8, 80)
#: Impacts of a drop by the collision law that are fitted, its damping (N s/m^1.5) and tolerance.
_IMPACTS, _DAMPING, _LAW_RTOL = 4, 1500.0, 1e-7
_WAVELENGTH, _PIXEL = 633e-9, 4.34e-6
#: How fast the gap opens (m per length of the contact), and from where on no ring is seen.
_CLIMB, _SMEARED = 1e-4, 2e-5
_SEED = 2
#: The bias (m) that the contact radius may have at most on ideal images.
_RADIUS_TOLERANCE = 1e-8


@dataclass(frozen=True, slots=True)
class Shortcut:
    """One shortcut, and the answers that it must not change.

    ``difference`` of the two answers is in units of the stated tolerance; ``work`` counts what
    was done for an answer, in the unit ``counted``. Times are processor times of this process,
    in which a busy machine shows less, unless ``clock`` says otherwise.
    """

    name: str
    short: Callable[[], Any]
    whole: Callable[[], Any]
    difference: Callable[[Any, Any], float]
    tolerance: str
    work: Callable[[Any], float]
    counted: str
    clock: Callable[[], float] = CLOCK


def run(quick: bool) -> Suite:
    """Run everything with each shortcut and without it."""
    with tempfile.TemporaryDirectory() as folder:
        shortcuts = [
            _rest_in_a_film(Path(folder), 600 if quick else 2400),
            _frames_without_contact(128 if quick else 800),
            _rows_outside(Path(folder)),
            _bytes_instead_of_floats(quick),
            _subsets_asked_for(),
            _one_reference(8 if quick else 40),
            _steps_behind_a_target(Path(folder)),
            _flights(0.15 if quick else 0.4),
            _springs_out_of_reach(0.1 if quick else 0.5),
            _rest(0.5 if quick else 1.0),
            _folded_terms("13 terms of acrylic", materials.load("acrylic")),
            _folded_terms("80 terms over 20 decades", _many_terms()),
            _memory(400 if quick else 1500),
            _impacts_asked_for(0.2 if quick else 0.4),
            _imports(),
        ]
        points = [_measure(shortcut, 1 if quick else 5) for shortcut in shortcuts]
    return Suite(
        "skipping",
        "Shortcuts on, and off as with --full",
        "difference of the results / tolerance",
        points,
        notes=[
            "The run time is that with the shortcut, in processor time. A difference of 1 is the "
            "stated tolerance. The part sessions measures whole sessions with nothing changed.",
            "The camera's 8 bits save memory, eight times, and little time: every frame is converted once either way.",
            "Folding terms and leaving out cells that cannot touch save work in proportion, and "
            "time only where there is much of it: a compiled step of 13 terms and 300 springs "
            "spends most of its time on its force, its ledger and its record.",
        ],
        has_diagram=False,
    )


def _measure(shortcut: Shortcut, repeats: int) -> Point:
    contenders = {"short": shortcut.short, "whole": shortcut.whole}
    timings = paired(contenders, repeats, budget=_BUDGET, clock=shortcut.clock)
    short, whole = timings["short"], timings["whole"]
    ratio, low, high = whole.ratio(short)
    return Point(
        shortcut.name,
        shortcut.difference(short.value, whole.value),
        short.seconds,
        is_default=True,
        cold_seconds=short.cold_seconds,
        extra={
            "without (s)": whole.seconds,
            "times faster": ratio,
            "lowest": low,
            "highest": high,
            "work": shortcut.work(short.value),
            "work without": shortcut.work(whole.value),
            "counted": shortcut.counted,
            "tolerance": shortcut.tolerance,
        },
    )


def _counted(name: str) -> Callable[[xr.Dataset], float]:
    """Return the function that reads one count from a result's ledger."""
    return lambda found: float(json.loads(found.attrs["work"])[name])


def _rest_in_a_film(folder: Path, count: int) -> Shortcut:
    """Film a holder that swings and comes to rest; few frames are needed after that."""
    path = folder / "holder.cine"
    frame = np.arange(count)
    sway = 3.0 * np.exp(-frame / (0.04 * count)) * np.cos(2 * np.pi * frame / (0.05 * count))
    pattern, _ = make_film(96, 1, 0.0)
    spectrum = np.fft.rfft2(pattern[0])
    waves = np.fft.fftfreq(96)[:, None]
    generator = np.random.default_rng(_SEED)

    def images() -> Iterator[NDArray[np.uint8]]:
        for shift in sway - sway[0]:
            grey = np.fft.irfft2(spectrum * np.exp(-2j * np.pi * waves * shift), (96, 96))
            noisy = grey + 2.0 * generator.standard_normal(grey.shape)
            yield np.clip(np.rint(noisy), 0, 255).astype(np.uint8)

    recording = phantom.Recording(10_000, 5e-6, bits=8)
    phantom.write(path, images(), (count, 96, 96), frame / 1e4, recording)
    tracking = Tracking(body=(48.0, 48.0), body_subset=41, static_frames=1)
    settings = DicValidation(kind="dic_validation", film=str(path), camera="unused", tracking=tracking)

    def track(full: bool) -> xr.Dataset:
        return dic_validation.track(path, settings=settings, full=full)

    def difference(short: xr.Dataset, whole: xr.Dataset) -> float:
        same = whole.sel(frame=short["frame"])
        return float(np.abs(short["dy"] - same["dy"]).max() / same["u_dy"].median())

    return Shortcut(
        "front film: few frames after rest",
        lambda: track(False),
        lambda: track(True),
        difference,
        "standard uncertainty of a frame",
        lambda found: float(sum(_work(found, "frames_read", "coarse_frames_read"))),
        "frames",
    )


def _work(found: xr.Dataset, *names: str) -> Iterator[float]:
    counts: Mapping[str, float] = json.loads(found.attrs["work"])
    return (float(counts.get(name, 0)) for name in names)


def _frames_without_contact(count: int) -> Shortcut:
    """Film one impact through the disc; before and after it there are rings only."""
    film = contact_film(count)

    def measure(full: bool) -> xr.Dataset:
        return imaging.contact_radius(film, _PIXEL, _SPHERE, _WAVELENGTH, full=full)

    def difference(short: xr.Dataset, whole: xr.Dataset) -> float:
        both = (short["in_contact"] & whole["in_contact"]).values
        if (short["in_contact"].values != whole["in_contact"].values).any():
            return float("nan")
        apart = np.abs(short["radius"].values - whole["radius"].values)[both]
        return float(apart.max() / _RADIUS_TOLERANCE)

    return Shortcut(
        "under-disc film: frames without contact",
        lambda: measure(False),
        lambda: measure(True),
        difference,
        "0.01 µm",
        _counted("pixels_read"),
        "pixels",
    )


def contact_film(count: int) -> NDArray[np.uint8]:
    """Draw a film (frame, row, column) of one Hertz contact in the middle eighth of ``count``."""
    y, x = np.mgrid[:128, :144].astype(float)
    r = _PIXEL * np.hypot(x - 70.3, y - 62.6)
    generator = np.random.default_rng(_SEED)
    film = np.empty((count, *r.shape), np.uint8)
    for k in range(count):
        phase = 16.0 * (k / count - 0.5)
        if abs(phase) < 1.0:
            gap = imaging.hertz_gap(r, 150e-6 * np.cos(0.5 * np.pi * phase) + 30e-6, _SPHERE)
        else:
            gap = r**2 / (2 * _SPHERE) + _CLIMB * (abs(phase) - 1.0) + 1e-6
        # rings of a wide gap run through the exposure and are smeared out
        fringes = 0.8 * np.exp(-((gap / _SMEARED) ** 2)) * np.cos(4 * np.pi * gap / _WAVELENGTH)
        light = 120.0 * (1.0 - fringes)
        film[k] = np.clip(np.rint(light + 3.0 * generator.standard_normal(r.shape)), 0, 255)
    return film


def _rows_outside(folder: Path) -> Shortcut:
    """Read a rectangle of a film instead of whole frames."""
    path = folder / "rows.cine"
    images = np.random.default_rng(_SEED).integers(0, 256, (40, 480, 1280), dtype=np.uint8)
    recording = phantom.Recording(10_000, 5e-6, bits=8)
    phantom.write(path, images, images.shape, np.arange(40) / 1e4, recording)
    film = instruments.read(path)
    rows, columns = slice(100, 220), slice(200, 840)
    part = film.roi(rows, columns)
    return Shortcut(
        "reading: rows and columns outside the rectangle",
        lambda: np.stack([part[k] for k in range(40)]),
        lambda: np.stack([film[k] for k in range(40)]),
        lambda short, whole: float((short != whole[:, rows, columns]).any()),
        "the same pixels",
        lambda found: float(found.nbytes),
        "bytes",
    )


def _bytes_instead_of_floats(quick: bool) -> Shortcut:
    """Follow points in the camera's own 8 bits instead of a film turned into float64."""
    film, _ = make_film(256, 8 if quick else 40, 2.0)
    axis = np.arange(30.0, 226.0, 28.0)
    points = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)

    def follow(frames: NDArray[Any]) -> xr.Dataset:
        work = json.dumps({"bytes_held": frames.nbytes})
        return imaging.track(frames, points).assign_attrs(work=work)

    def difference(short: xr.Dataset, whole: xr.Dataset) -> float:
        return float(np.abs(short["dx"] - whole["dx"]).max() / 1e-4)

    return Shortcut(
        "image correlation: the camera's 8 bits",
        lambda: follow(film),
        lambda: follow(film.astype(np.float64)),
        difference,
        "0.0001 px",
        _counted("bytes_held"),
        "bytes of the film",
    )


def _subsets_asked_for() -> Shortcut:
    """Follow the four points that are wanted, not the whole field to choose from afterwards."""
    film, _ = make_film(256, 5, 2.0)
    axis = np.arange(30.0, 226.0, 14.0)
    field = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    wanted = np.array([0, len(axis) - 1, len(field) // 2, len(field) - 1])

    def difference(short: xr.Dataset, whole: xr.Dataset) -> float:
        return float(np.abs(short["dx"].values - whole["dx"].values[:, wanted]).max() / 1e-4)

    return Shortcut(
        "image correlation: the subsets asked for",
        lambda: imaging.track(film, field[wanted]),
        lambda: imaging.track(film, field),
        difference,
        "0.0001 px",
        _counted("subsets_solved"),
        "subsets",
    )


def _one_reference(count: int) -> Shortcut:
    """Prepare the reference once and start from the motion, not anew for every frame."""
    film, _ = make_film(128, count, 2.0)
    points = np.array([[48.0, 48.0], [80.0, 48.0], [64.0, 80.0]])

    def anew() -> xr.Dataset:
        pairs = [imaging.track(film, points, select=[k]) for k in range(count)]
        found = xr.concat(pairs, "frame", combine_attrs="drop")
        evaluations = float(found["iterations"].sum())
        found.attrs["work"] = json.dumps({"iterations": evaluations})
        return found

    def once() -> xr.Dataset:
        found = imaging.track(film, points)
        return found.assign_attrs(work=json.dumps({"iterations": float(found["iterations"].sum())}))

    def difference(short: xr.Dataset, whole: xr.Dataset) -> float:
        return float(np.abs(short["dx"].values - whole["dx"].values).max() / 1e-3)

    return Shortcut(
        "image correlation: one reference, start from the motion",
        once,
        anew,
        difference,
        "0.001 px",
        _counted("iterations"),
        "iterations",
    )


def _steps_behind_a_target(folder: Path) -> Shortcut:
    """Compute the bounces alone when only they are wanted, not models and reports."""
    original = folder / "quick session"
    sessions.write_quick(original)
    numbers = itertools.count()

    def process(to: str | None) -> tuple[Path, int]:
        copy = folder / f"run {next(numbers)}"
        shutil.copytree(original, copy)
        outcome = verbs.process(copy, None if to is None else [to], jobs=0)
        return copy, sum(o.state == "done" for o in outcome.outcomes)

    def difference(short: tuple[Path, int], whole: tuple[Path, int]) -> float:
        return abs(sessions.restitution_error(short[0]) - sessions.restitution_error(whole[0]))

    return Shortcut(
        "session: the steps behind a target (--to bounces)",
        lambda: process("bounces"),
        lambda: process(None),
        difference,
        "the same numbers",
        lambda found: float(found[1]),
        "steps",
    )


def _many_terms() -> Prony:
    moduli = np.full(_MANY_TERMS.size, 2.5e9 / _MANY_TERMS.size)
    return Prony(5e8, moduli, _MANY_TERMS, nu=0.35)


def _other_restitution(short: xr.Dataset, whole: xr.Dataset) -> float:
    ratio = short["restitution"] / whole["restitution"] - 1.0
    return float(np.abs(ratio).max() / 1e-4)


def _folded_terms(name: str, solid: Prony) -> Shortcut:
    """Simulate a drop with and without the terms far outside of its times."""

    def drop(fold: bool) -> xr.Dataset:
        return contact.drop(solid, _SPHERE, _MASS, _HEIGHT, 0.1, fold=fold)

    return Shortcut(
        f"simulator: terms far outside the time scale ({name})",
        lambda: drop(True),
        lambda: drop(False),
        _other_restitution,
        "1e-4 of the restitution (rtol)",
        _counted("terms"),
        "terms",
    )


def _flights(duration: float) -> Shortcut:
    """Cross a flight at once, or in steps as long as those of a contact."""
    name = "simulator: a free flight is one step"
    return _dropped(name, Shortcuts(flights=False), _HIGH, duration, "solver_steps", "steps")


def _springs_out_of_reach(duration: float) -> Shortcut:
    """Solve for the springs that a bounce can touch, or for those of the whole sphere."""
    name, unit = "simulator: cells that can touch", "updates of an element"
    return _dropped(name, Shortcuts(near=False), _HEIGHT, duration, "spring_updates", unit)


def _dropped(name: str, without: Shortcuts, height: float, duration: float, count: str, unit: str) -> Shortcut:
    """Drop a sphere with all shortcuts, and without one of them."""
    solid = materials.load("acrylic")

    def drop(shortcuts: Shortcuts) -> xr.Dataset:
        return contact.drop(solid, _SPHERE, _MASS, height, duration, shortcuts=shortcuts)

    return Shortcut(
        name,
        lambda: drop(Shortcuts()),
        lambda: drop(without),
        _other_restitution,
        "1e-4 of the restitution (rtol)",
        _counted(count),
        unit,
    )


def _rest(duration: float) -> Shortcut:
    """Follow the creep at rest in few steps, or go on with the motion until the end."""
    solid = materials.load("acrylic")
    times = np.linspace(0.0, duration, 501)

    def drop(shortcuts: Shortcuts) -> xr.Dataset:
        return contact.drop(solid, _SPHERE, _MASS, _LOW, duration, times=times, shortcuts=shortcuts)

    def difference(short: xr.Dataset, whole: xr.Dataset) -> float:
        apart = np.abs(short["displacement"] - whole["displacement"]).max()
        return float(apart / (_STILL * abs(whole["displacement"][-1])))

    return Shortcut(
        "simulator: stop at rest",
        lambda: drop(Shortcuts()),
        lambda: drop(Shortcuts(rest=False)),
        difference,
        "1e-4 of the sag (rtol)",
        _counted("solver_steps"),
        "steps",
    )


def _memory(steps: int) -> Shortcut:
    """Carry the memory from step to step instead of summing over the whole history."""
    creep = Creep.of(materials.load("acrylic"))
    time = np.linspace(0.0, 0.01, steps + 1)
    load = np.sin(np.pi * time / time[-1]) ** 2 * 1e3

    def carried() -> Floats:
        memory, found = creep.rest(1), [0.0]
        weights = step_weights(creep, float(time[1]))
        for before, after in itertools.pairwise(load):
            past = history(weights, memory, np.array([before]))
            found.append(float((past + weights.compliance * after)[0]))
            memory = advance(weights, memory, np.array([before]), np.array([after]))
        return np.array(found)

    def summed() -> Floats:
        rate = np.diff(load) / np.diff(time)
        found = [0.0]
        for n in range(1, steps + 1):
            late = time[n] - time[: n + 1]
            # integral of J over a segment in which the load grows evenly
            grown = creep.instantaneous * late[:, None] + creep.C * (
                late[:, None] + creep.tau * np.expm1(-late[:, None] / creep.tau)
            )
            total = creep.instantaneous * late + (grown - creep.instantaneous * late[:, None]).sum(1)
            found.append(float(rate[:n] @ -np.diff(total)))
        return np.array(found)

    return Shortcut(
        "simulator: memory carried, not summed",
        carried,
        summed,
        lambda short, whole: float(np.abs(short - whole).max() / np.abs(whole).max() / 1e-9),
        "1e-9 of the largest displacement",
        lambda found: float(len(found)),
        "steps",
    )


def _impacts_asked_for(duration: float) -> Shortcut:
    """End a drop of the collision law behind the impacts that a fit asks for."""

    def drop(impacts: int | None) -> xr.Dataset:
        return contact.collision(
            _SPHERE, _MASS, _HEIGHT, damping=_DAMPING, duration=duration, impacts=impacts, rtol=_LAW_RTOL
        )

    def difference(short: xr.Dataset, whole: xr.Dataset) -> float:
        apart = short["restitution"].values - whole["restitution"].values[:_IMPACTS]
        return float(np.abs(apart).max() / 1e-12)

    return Shortcut(
        "collision: impacts that nobody asked for",
        lambda: drop(_IMPACTS),
        lambda: drop(None),
        difference,
        "1e-12 of restitution",
        lambda found: float(found["restitution"].size),
        "impacts",
    )


def _imports() -> Shortcut:
    """Answer --help without the numerical libraries."""

    def start(code: str) -> int:
        done = subprocess.run(
            [sys.executable, "-c", code + "; import sys; print(len(sys.modules))"],
            capture_output=True,
            text=True,
            check=True,
        )
        return int(done.stdout)

    light = "import pipelines.cli"
    return Shortcut(
        "command line: libraries that the answer does not need",
        lambda: start(light),
        lambda: start(light + ", xarray, scipy.signal, matplotlib, numba, cv2"),
        lambda short, whole: 0.0,
        "the same answer",
        float,
        "modules",
        clock=time.perf_counter,  # the work is done in another process
    )

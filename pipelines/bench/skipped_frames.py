"""Shortcuts of films: frames, rows, subsets and references that need not be read or made."""

import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import instruments
from instruments import phantom
from labpipe import imaging
from pipelines.bench.dic import make_film
from pipelines.bench.film_scenes import View, digitised, from_spectrum, random_field
from pipelines.bench.shortcut import Shortcut, counted, work_of
from pipelines.experiments.dic_validation import measured as dic_validation
from pipelines.experiments.dic_validation.settings import DicValidation, Tracking

_SPHERE = 9.525e-3
_WAVELENGTH, _PIXEL = 633e-9, 4.34e-6
#: How fast the gap opens (m per length of the contact), and from where on no ring is seen.
_CLIMB, _SMEARED = 1e-4, 2e-5
_SEED = 2
#: The bias (m) that the contact radius may have at most on ideal images.
_RADIUS_TOLERANCE = 1e-8


def rest_in_a_film(folder: Path, count: int) -> Shortcut:
    """Film a holder that swings and comes to rest; few frames are needed after that."""
    path = folder / "holder.cine"
    frame = np.arange(count)
    sway = 3.0 * np.exp(-frame / (0.04 * count)) * np.cos(2 * np.pi * frame / (0.05 * count))
    pattern = random_field(96, 1.9, 1)
    images = digitised([from_spectrum(pattern, View((0.0, shift))) for shift in sway - sway[0]], 2.0, _SEED)
    recording = phantom.Recording(10_000, 5e-6, bits=8)
    phantom.write(path, images, images.shape, frame / 1e4, recording)
    tracking = Tracking(body=(48.0, 48.0), body_subset=41, static_frames=1)
    settings = DicValidation(kind="dic_validation", film=str(path), camera="unused", tracking=tracking)

    def track(full: bool) -> xr.Dataset:
        return dic_validation.track(path, settings=settings, full=full)

    def difference(short: xr.Dataset, whole: xr.Dataset) -> float:
        same = whole.sel(frame=short["frame"])
        return float(np.abs(short["dy"] - same["dy"]).max() / same["u_dy"].median())

    short, long, work = partial(track, False), partial(track, True), ("frames_read", "coarse_frames_read")
    name, unit = "front film: few frames after rest", "standard uncertainty of a frame"
    return Shortcut(name, short, long, difference, unit, lambda found: float(sum(work_of(found, *work))), "frames")


def frames_without_contact(count: int) -> Shortcut:
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

    short, long = partial(measure, False), partial(measure, True)
    name, work = "under-disc film: frames without contact", counted("pixels_read")
    return Shortcut(name, short, long, difference, "0.01 µm", work, "pixels")


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


def rows_outside(folder: Path) -> Shortcut:
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


def bytes_instead_of_floats(quick: bool) -> Shortcut:
    """Follow points in the camera's own 8 bits instead of a film turned into float64."""
    film, _ = make_film(256, 8 if quick else 40, 2.0)
    axis = np.arange(30.0, 226.0, 28.0)
    points = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)

    def follow(frames: NDArray[Any]) -> xr.Dataset:
        work = json.dumps({"bytes_held": frames.nbytes})
        return imaging.track(frames, points).assign_attrs(work=work)

    def difference(short: xr.Dataset, whole: xr.Dataset) -> float:
        return float(np.abs(short["dx"] - whole["dx"]).max() / 1e-4)

    short, long = partial(follow, film), lambda: follow(film.astype(np.float64))
    name, work = "image correlation: the camera's 8 bits", counted("bytes_held")
    return Shortcut(name, short, long, difference, "0.0001 px", work, "bytes of the film")


def subsets_asked_for() -> Shortcut:
    """Follow the four points that are wanted, not the whole field to choose from afterwards."""
    film, _ = make_film(256, 5, 2.0)
    axis = np.arange(30.0, 226.0, 14.0)
    field = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    wanted = np.array([0, len(axis) - 1, len(field) // 2, len(field) - 1])

    def difference(short: xr.Dataset, whole: xr.Dataset) -> float:
        return float(np.abs(short["dx"].values - whole["dx"].values[:, wanted]).max() / 1e-4)

    short, long = partial(imaging.track, film, field[wanted]), partial(imaging.track, film, field)
    name, work = "image correlation: the subsets asked for", counted("subsets_solved")
    return Shortcut(name, short, long, difference, "0.0001 px", work, "subsets")


def one_reference(count: int) -> Shortcut:
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

    name, work = "image correlation: one reference, start from the motion", counted("iterations")
    return Shortcut(name, once, anew, difference, "0.001 px", work, "iterations")

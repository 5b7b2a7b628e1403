"""Extreme films: subsets and contacts in saturated, empty and noisy images.

Patterns are sums of waves, moved in their phase, so that every pixel follows from the formula.
Contacts are those of Hertz, as in :mod:`tests.labpipe.imaging.fringe_film`.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labpipe import imaging
from labpipe.arrays import Floats
from tests.extremes.inputs import Random, laid_out
from tests.extremes.outcome import Case, Outcome, silently, worst
from tests.labpipe.imaging.fringe_film import Scene, clean_image

Film = NDArray[Any]

_ROWS, _COLUMNS = 56, 64
#: Waves of a pattern, and their shortest and longest length (px).
_WAVES, _LENGTHS = 40, (5.0, 18.0)


def pattern(random: Random) -> Any:
    """Draw a pattern: a function of a shift (x, y) in px that gives its image, about 0, sd 1."""
    length, angle = random.uniform(*_LENGTHS, _WAVES), random.uniform(0.0, np.pi, _WAVES)
    kx, ky = 2 * np.pi * np.cos(angle) / length, 2 * np.pi * np.sin(angle) / length
    begin = random.uniform(0.0, 2 * np.pi, _WAVES)
    across = np.exp(1j * kx[:, None] * np.arange(_COLUMNS))
    down = np.exp(1j * ky[:, None] * np.arange(_ROWS))

    def image(dx: float, dy: float) -> Floats:
        turned = np.exp(1j * (begin - kx * dx - ky * dy)) * np.sqrt(2.0 / _WAVES)
        return np.asarray(((down * turned[:, None]).T @ across).real)

    return image


def _as_camera(random: Random, film: Floats, kind: str) -> Film:
    """Round to what a camera gives, in a memory layout of any kind, read-only."""
    if kind == "float64":
        return laid_out(random, film)
    if kind == "float32":
        return laid_out(random, film, is_single=True)
    white = 255 if kind == "uint8" else 65535
    grey = np.clip(np.rint(film), 0, white).astype(kind)
    grey = np.asfortranarray(grey) if random.random() < 0.3 else grey
    grey.setflags(write=False)
    return grey


def moved_pattern(random: Random) -> Outcome:
    """Shifts up to some px, any type, contrast, noise and saturation, and one-frame films."""
    image = pattern(random)
    count = int(random.choice([1, 2, 3, 4]))
    shifts = np.concatenate([[[0.0, 0.0]], np.cumsum(random.uniform(-1.5, 1.5, (count - 1, 2)), 0)])
    kind = str(random.choice(["uint8", "uint16", "float32", "float64"]))
    contrast = {"uint8": 30.0, "uint16": 3000.0}.get(kind, 10 ** random.uniform(-9, 9))
    contrast *= random.uniform(0.3, 2.5)  # up to a fifth of the pixels are black or white
    middle = {"uint8": 127.0, "uint16": 30000.0}.get(kind, contrast * random.choice([0.0, 1e3]))
    noise = contrast * float(random.choice([0.0, 10 ** random.uniform(-3, -0.8)]))
    film = np.stack([image(*shift) for shift in shifts]) * contrast + middle
    film += noise * random.standard_normal(film.shape)
    points = random.uniform([20.0, 20.0], [_COLUMNS - 20.0, _ROWS - 20.0], (2, 2))
    with silently():
        found = imaging.track(
            _as_camera(random, film, kind),
            points,
            int(random.choice([15, 21, 25])),
            str(random.choice(["rigid", "affine"])),  # type: ignore[arg-type]
            int(random.choice([3, 5])),  # type: ignore[arg-type]
        )
    return _motion(found, shifts, floor=0.03)


def _motion(found: Any, shifts: Floats, floor: float) -> Outcome:
    """Compare what is said to be valid; what is not must be NaN, and most must be valid."""
    is_valid = found["valid"].values
    errors = []
    for axis, name in enumerate(("dx", "dy")):
        error = np.abs(found[name].values - shifts[:, axis, None])
        if not np.array_equal(np.isfinite(error), is_valid):
            return Outcome(np.inf, "a value that is not valid, or the reverse")
        errors.append(error / (8.0 * found[f"u_{name}"].values + floor))
    largest = float(np.nanmax(errors, initial=0.0, where=np.isfinite(errors)))
    return worst(
        (largest, f"a displacement by 8 u and {floor} px"),
        (np.inf if is_valid.mean() < 0.5 else 0.0, "a sound pattern was lost"),
    )


def film_without_pattern(random: Random) -> Outcome:
    """No pattern to follow (constant, fine stripes in one direction, saturated, noise): no value.

    A frame that shows something else than the first has no displacement either.
    """
    kind = str(random.choice(["constant", "saturated", "noise", "other", "lost", "stripes"]))
    image, other = pattern(random), pattern(random)
    film = np.stack([image(0.0, 0.0), image(0.3, 0.1), image(0.6, 0.2)]) * 40.0 + 120.0
    if kind == "constant":
        film[:] = random.uniform(0.0, 255.0)
    elif kind == "saturated":
        film[:] = np.where(film > -1e9, 400.0, film)
    elif kind == "noise":
        film = 120.0 + 40.0 * random.standard_normal(film.shape)
    elif kind == "other":
        film[1:] = 120.0 + 40.0 * other(0.0, 0.0)
    elif kind == "lost":
        film[1:] = random.uniform(0.0, 255.0)
    else:
        film[:] = film[:, :1, :]
    frames = _as_camera(random, film, "uint8")
    with silently():
        found = imaging.track(frames, [(32.0, 28.0)], int(random.choice([21, 25, 31])))
    told = found["valid"].values[1:]
    u = np.hypot(found["u_dx"].values[1:], found["u_dy"].values[1:])
    # Along stripes nothing is known; saying so by an uncertainty of a pixel is right, too.
    return Outcome(np.inf if np.any(told & ~(u > 1.0)) else 0.0, f"{kind}: a displacement")


_SCENE = Scene(rows=112, columns=128, pixel_size=4e-6)


def seen_contact(random: Random) -> Outcome:
    """Contacts of any size and place, dim to saturated light, noise, one frame: within 8 u."""
    radius = random.uniform(60e-6, 150e-6)
    centre = float(random.uniform(50.0, 78.0)), float(random.uniform(44.0, 68.0))
    scene = replace(
        _SCENE,
        sphere_radius=10 ** random.uniform(-2.2, -1.7),
        slope_x=float(random.choice([0.0, random.uniform(-0.2, 0.2)])),
    )
    light = float(random.choice([1.0, random.uniform(0.3, 1.4)]))
    noise = 10 ** random.uniform(-1, 1)
    count = int(random.choice([1, 2]))
    image = clean_image(scene, radius, centre) * light
    film = image + noise * random.standard_normal((count, *image.shape))
    frames = _as_camera(random, film, "uint8")
    with silently():
        found = imaging.contact_radius(frames, scene.pixel_size, scene.sphere_radius, scene.wavelength)
    fitted = (found["method"].values == 1) | (found["method"].values == 5)
    if not found["in_contact"].values.all():
        return (
            Outcome(0.0, "", "no contact was seen")
            if noise > 0.15 * 120 * light
            else Outcome(np.inf, "a contact was not seen")
        )
    error = np.abs(found["radius"].values - radius)
    # What an edge says is an estimate, whose uncertainty is stated as such.
    allowed = 8.0 * found["u_radius"].values + np.where(fitted, 0.1, 1.0) * scene.pixel_size
    return Outcome(float(np.nanmax(error / allowed)), "a radius by 8 u and 0.1 px")


def no_contact(random: Random) -> Outcome:
    """Black, white, noise, slopes and patterns hold no contact."""
    rows, columns = 64, 72
    kind = str(random.choice(["black", "white", "grey", "noise", "slope", "pattern"]))
    y, x = np.mgrid[:rows, :columns]
    images: Mapping[str, Floats] = {
        "black": np.zeros((rows, columns)),
        "white": np.full((rows, columns), 255.0),
        "grey": np.full((rows, columns), random.uniform(1.0, 254.0)),
        "noise": 120.0 + 30.0 * random.standard_normal((rows, columns)),
        "slope": 100.0 + random.uniform(-1.0, 1.0) * x + random.uniform(-1.0, 1.0) * y,
        "pattern": 120.0 + 40.0 * np.tile(pattern(random)(0.0, 0.0), (2, 2))[:rows, :columns],
    }
    noise = float(random.choice([0.0, 3.0]))
    count = int(random.choice([1, 3]))
    film = images[kind] + noise * random.standard_normal((count, rows, columns))
    frames = _as_camera(random, film, str(random.choice(["uint8", "uint16"])))
    with silently():
        found = imaging.contact_radius(frames, 4e-6, 9.5e-3, 633e-9)
    seen = bool(found["in_contact"].values.any() or np.isfinite(found["radius"].values).any())
    return Outcome(np.inf if seen else 0.0, f"{kind}: a contact")


#: Families and how many of their cases the tests try.
FAMILIES: Mapping[str, tuple[Case, int]] = {
    "moved pattern": (moved_pattern, 150),
    "film without pattern": (film_without_pattern, 120),
    "seen contact": (seen_contact, 12),
    "no contact": (no_contact, 12),
}

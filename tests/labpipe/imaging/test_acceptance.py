"""Acceptance of image correlation: errors, coverage of the uncertainties and refusals against known truth."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

import instruments
from labpipe.imaging import track
from tests.labpipe.imaging.speckle import Motion, digitise, grey_levels, grid, make_speckle, waves

Floats = NDArray[np.float64]

SAMPLES = Path(__file__).parents[3] / "sample_data"
PHOTOGRAPHS = Path(__file__).parents[4] / "shared/samples/images/mudic"
SIZE = (260, 280)


@dataclass(frozen=True)
class Figures:
    """Figures of one scene: all components of all valid results after the static frames."""

    valid: float  # share of the results
    rms: float  # px
    within_2u: float  # share
    worst: float  # largest |error| / u
    beyond_5u: int
    count: int

    @classmethod
    def of(cls, film: object, points: Floats, truth: Floats, static_frames: int = 1, **options: object) -> "Figures":
        """Track a film; ``truth`` (frame, point, 2) in px."""
        found = track(film, points, static_frames=static_frames, **options)
        error = np.stack([found.dx, found.dy], axis=-1) - truth
        u = np.stack([found.u_dx, found.u_dy], axis=-1)
        moved = slice(static_frames, None)
        valid = found.valid.values[moved]
        error, u = error[moved][valid], u[moved][valid]
        if not valid.any():
            return cls(0.0, np.nan, np.nan, np.nan, 0, 0)
        ratio = np.abs(error) / u
        return cls(
            float(valid.mean()),
            float(np.sqrt(np.mean(error**2))),
            float(np.mean(ratio < 2.0)),
            float(ratio.max()),
            int((ratio > 5.0).sum()),
            ratio.size,
        )


# --- front films of the bundled sessions -----------------------------------------------------


def front_film(
    session: Path, body: tuple[float, float], width: int, line: tuple[float, float], small: int, static: int
) -> Figures:
    """Body and line of subsets on the falling holder, against the truth of the session."""
    known = json.loads((session / "truth/ptfe_front.json").read_text("utf-8"))
    points = np.array([body, *((x, body[1]) for x in np.linspace(*line, 6))])
    pivot, angle = np.array(known["pivot"]), np.array(known["rotation"])[:, None]
    x, y = (points - pivot).T
    cosine, sine = np.cos(angle) - 1.0, np.sin(angle)
    dx, dy = (np.array(known[name])[:, None] for name in ("dx", "dy"))
    truth = np.stack([dx + cosine * x - sine * y, dy + sine * x + cosine * y], axis=-1)
    truth -= truth[:static].mean(axis=0)
    film = instruments.read(session / "film/ptfe_front.cine")
    return Figures.of(film, points, truth, static, subset=[width, *[small] * 6])


def films() -> Figures:
    return front_film(SAMPLES / "films", (31.5, 21.6), 37, (21.0, 42.0), 21, 32)


def thesis_small() -> Figures:
    return front_film(SAMPLES / "thesis-small", (25.5, 13.1), 21, (17.0, 34.0), 17, 16)


# --- photographs, moved by whole pixels at full size and reduced ---------------------------------


@cache
def photograph(name: str, left: int, top: int) -> tuple[Floats, Floats]:
    """Film (frame, row, column) of a part of a photograph moved by up to 2 px, and its shifts (frame, 2)."""
    import cv2

    grey = cv2.imread(str(PHOTOGRAPHS / name), cv2.IMREAD_GRAYSCALE)
    assert grey is not None
    rng = np.random.default_rng(left)
    moves = np.concatenate([[[0, 0]], rng.integers(-8, 9, (6, 2))])
    frames = []
    for x, y in moves:
        part = grey[top - y : top - y + 640, left - x : left - x + 640].astype(float)
        frames.append(digitise(part.reshape(160, 4, 160, 4).mean(axis=(1, 3)), 1.0, int(100 + x * 17 + y) % 997))
    return np.stack(frames), moves / 4.0


def of_photograph(name: str, left: int, top: int, subset: int) -> Figures:
    film, shifts = photograph(name, left, top)
    points = grid(film.shape[1:], 20, 12)
    return Figures.of(film, points, np.repeat(shifts[:, None], len(points), axis=1), subset=subset)


# --- speckle drawn analytically ------------------------------------------------------------------

MIDDLE = (140.0, 130.0)
MOTIONS = {
    "shift": [Motion(0.17 * k, -0.11 * k) for k in range(7)],
    "rotation": [Motion(0.3 * k, 0.2 * k, np.deg2rad(0.5 * k), MIDDLE) for k in range(7)],
    "strain": [Motion(0.1 * k, 0.0, 0.0, MIDDLE, (0.002 * k, -0.001 * k)) for k in range(7)],
    "jump": [Motion(), Motion(), *[Motion(23.4 + 0.1 * k, -31.7) for k in range(4)]],
}


@cache
def speckle_film(kind: str, motion: str, noise: float, seed: int) -> NDArray[np.uint8]:
    speckle = make_speckle(kind, SIZE, seed)
    frames = [grey_levels(speckle, SIZE, one) for one in MOTIONS[motion]]
    return np.stack([digitise(grey, noise, 100 * seed + k) for k, grey in enumerate(frames)])


def of_speckle(kind: str, motion: str, noise: float, subset: int, seed: int = 0, **options: object) -> Figures:
    film = speckle_film(kind, motion, noise, seed)
    points = grid(SIZE, 60 if motion == "jump" else 26, 14)
    truth = np.stack([one.displacement(points) for one in MOTIONS[motion]])
    return Figures.of(film, points, truth, subset=subset, **options)


# --- scenes that must be refused, or kept --------------------------------------------------------

FORMULA_SIZE = 160


def drawn(formula: Callable[[Floats, Floats], Floats], shifts: list[tuple[float, float]], noise: float) -> Floats:
    """Film (frame, row, column) of a formula (about 0) of the place, shifted."""
    row, column = np.mgrid[:FORMULA_SIZE, :FORMULA_SIZE].astype(float)
    return np.stack([digitise(127.0 + formula(column - x, row - y), noise, 7 * k) for k, (x, y) in enumerate(shifts)])


def of_edge(angle: float, grain: float, noise: float = 1.0) -> Figures:
    """One straight edge through the middle; points along it."""
    texture = waves(3)

    def grey(x: Floats, y: Floats) -> Floats:
        across = (x - 80.3) * np.cos(angle) + (y - 79.6) * np.sin(angle)
        return 60.0 * erf(across / (0.8 * np.sqrt(2.0))) + grain * texture(x, y)

    shifts = [(0.37 * k, -0.21 * k) for k in range(5)]
    along = np.arange(-48.0, 49.0, 8.0)
    points = np.stack([80.3 - along * np.sin(angle), 79.6 + along * np.cos(angle)], axis=1)
    truth = np.repeat(np.array(shifts)[:, None], len(points), axis=1)
    return Figures.of(drawn(grey, shifts, noise), points, truth)


def of_dots(step: float, subset: int = 31, period: float = 9.0) -> Figures:
    def grey(x: Floats, y: Floats) -> Floats:
        u, v = x * 0.955 + y * 0.296, y * 0.955 - x * 0.296
        return 60.0 * np.tanh(2.0 * (np.cos(2 * np.pi * u / period) + np.cos(2 * np.pi * v / period) - 0.5))

    shifts = [(step * k, 0.4 * step * k) for k in range(6)]
    points = grid((FORMULA_SIZE, FORMULA_SIZE), 40, 10)
    return Figures.of(drawn(grey, shifts, 1.0), points, np.repeat(np.array(shifts)[:, None], len(points), axis=1),
                      subset=subset)  # fmt: skip


def of_wall() -> Figures:
    shifts = [(0.3 * k, 0.0) for k in range(4)]
    film = drawn(lambda x, y: 0.2 * (x + y) - 30.0, shifts, 2.0)
    points = grid((FORMULA_SIZE, FORMULA_SIZE), 30, 10)
    return Figures.of(film, points, np.repeat(np.array(shifts)[:, None], len(points), axis=1))


def of_turn(degrees: float, seed: int = 1) -> Figures:
    """Turn between two frames, too far for a subset to be recognised."""
    motions = [Motion(), Motion(angle=np.deg2rad(degrees), centre=MIDDLE)]
    speckle = make_speckle("medium", SIZE, seed)
    film = np.stack([digitise(grey_levels(speckle, SIZE, one), 1.0, k) for k, one in enumerate(motions)])
    points = grid(SIZE, 55, 25)
    return Figures.of(film, points, np.stack([one.displacement(points) for one in motions]))


def of_bar(texture: float, subset: int = 31) -> Figures:
    """A bar that nobody stated crosses a specimen at rest and one that moves."""
    film = speckle_film("medium", "shift", 1.0, 5).astype(float)
    speckle = 80.0 + texture * waves(9)(*np.meshgrid(np.arange(280.0), np.arange(260.0)))
    for k, frame in enumerate(film):
        frame[:, 20 + 35 * k : 34 + 35 * k] = speckle[:, 20:34] if k else frame[:, 20:34]
    points = grid(SIZE, 26, 14)
    truth = np.stack([one.displacement(points) for one in MOTIONS["shift"]])
    return Figures.of(np.clip(np.rint(film), 0, 255).astype(np.uint8), points, truth, subset=subset)

"""Run time and memory against size: exponents for every size that can grow."""

import math
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np
import xarray as xr

from labpipe import contact, files, imaging, materials, signals
from labpipe.materials import Prony
from pipelines import process as verbs
from pipelines.bench.dic import make_film
from pipelines.bench.laser_truth import record
from pipelines.bench.measure import Point, Suite, paired, peak_bytes
from pipelines.rig.session_text import drop_section, laser_record, session_head

_SPHERE, _MASS, _HEIGHT = 9.525e-3, 0.505, 1.5e-3
#: n log n over the range of sizes below looks like n to this power.
_ALLOWED = 1.25


@dataclass(frozen=True, slots=True)
class Growth:
    """Something that grows: sizes, and what to do at each of them."""

    name: str
    size_label: str
    sizes: Sequence[int]
    prepare: Callable[[int], Callable[[], object]]


def run(quick: bool) -> list[Suite]:
    """Measure everything at three sizes or more, each twice the one before."""
    with tempfile.TemporaryDirectory() as folder:
        found = [_measure(growth, quick) for growth in _growths(Path(folder), quick)]
    summary = Suite(
        "scaling",
        "Exponents: run time and memory grow like size to this power",
        "exponent of the run time",
        [point for _, point in found],
        notes=[
            "The exponent is the slope of the logarithm of the run time from the second smallest to the largest size; "
            f"up to {_ALLOWED:g} counts as linear (n log n). All sizes run in turn, round by round; the exponent is "
            "the median of the rounds, and counts as more than linear only if it is so in every round. The run time is "
            "that of the largest size. All are processor times, which a busy machine lengthens less than wall time, "
            "but for short calls still by half."
        ],
        has_diagram=False,
    )
    return [summary, *(suite for suite, _ in found)]


def _measure(growth: Growth, quick: bool) -> tuple[Suite, Point]:
    calls = {str(size): growth.prepare(size) for size in growth.sizes}
    rounds, budget = (2, 3.0) if quick else (9, 8.0)
    timings = paired(calls, rounds, budget=budget)
    # Traced runs take several times as long, and the slope leaves the smallest size out.
    memory = [peak_bytes(call) for call in list(calls.values())[1:]]
    # the shortest run: what disturbs a run only ever lengthens it
    best = [min(timings[str(size)].samples) for size in growth.sizes]
    points = [
        Point(f"{size}", float(size), seconds, cold_seconds=timings[str(size)].cold_seconds, peak_bytes=used)
        for size, seconds, used in zip(growth.sizes, best, [None, *memory], strict=True)
    ]
    found = exponents(growth.sizes, [timings[str(size)].samples for size in growth.sizes])
    summary = Point(
        growth.name,
        max(0.0, median(found)),  # a size is never negative; what was found stands beside it
        best[-1],
        peak_bytes=memory[-1],
        extra={
            "lowest": min(found),
            "highest": max(found),
            "exponent of the memory": slope(growth.sizes, [0.0, *map(float, memory)]),
            "from": growth.sizes[0],
            "to": growth.sizes[-1],
            "size": growth.size_label,
            "at most linear": min(found) <= _ALLOWED,
        },
    )
    suite = Suite(
        f"scaling-{growth.name.replace(' ', '-')}", f"{growth.name}: size against run time", growth.size_label, points
    )
    return suite, summary


def exponents(sizes: Sequence[int], samples: Sequence[Sequence[float]]) -> list[float]:
    """Return the exponent of every round, given the times of each size, round by round.

    Examples
    --------
    >>> [round(n, 3) for n in exponents([1, 10, 100], [[5, 5], [10, 20], [100, 2000]])]
    [1.0, 2.0]
    """
    return [slope(sizes, taken) for taken in zip(*samples, strict=True)]


def slope(sizes: Sequence[int], values: Sequence[float]) -> float:
    """Fit the exponent over all sizes but the smallest, which costs what every call costs.

    Examples
    --------
    >>> round(slope([1, 10, 20, 40], [5.0, 30.0, 60.0, 120.0]), 3)
    1.0
    """
    tail = slice(1 if len(sizes) > 2 else 0, None)
    x, y = np.log(np.array(sizes[tail], float)), np.log(np.maximum(values[tail], 1e-12))
    return float(np.polyfit(x, y, 1)[0]) if len(x) > 1 else math.nan


def _growths(folder: Path, quick: bool) -> list[Growth]:
    """List what is measured."""
    shrink = 1 if quick else 2
    return [
        Growth("film length", "frames", _doubled(20, 3, shrink), _film_length),
        Growth("image size", "px", [128**2, 256**2, 512**2], _image_size),
        Growth("number of subsets", "subsets", _doubled(64, 3, shrink), _subsets),
        Growth("velocity", "samples", _doubled(1000, 3, shrink), _velocity),
        Growth("laser events", "samples", _doubled(2000, 3, shrink), _events),
        Growth("Prony terms in a drop", "terms", _doubled(8, 3, shrink), _terms),
        Growth("simulated time in contact", "impacts", _doubled(1, 3, shrink), _impacts),
        Growth("elements of an indentation", "elements", _doubled(256, 3, shrink), _elements),
        Growth("planning a session", "experiments", _doubled(8, 3, shrink), lambda n: _planned(folder, n)),
    ]


def _doubled(first: int, count: int, factor: int) -> list[int]:
    return [factor * first * 2**k for k in range(count)]


def _film_length(count: int) -> Callable[[], object]:
    film, _ = make_film(160, 11, 2.0)
    # there and back again, so that the pattern stays in the image however long the film is
    turns = np.concatenate([np.arange(11), np.arange(9, 0, -1)])
    axis = np.arange(26.0, 160 - 26.0, 28.0)
    points = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    long = film[np.resize(turns, count)]
    return lambda: imaging.track(long, points)


def _image_size(pixels: int) -> Callable[[], object]:
    size = math.isqrt(pixels)
    film, _ = make_film(size, 6, 2.0)
    # the corners make every pixel between them needed
    middle, end = size / 2, size - 27.0
    points = [(26.0, 26.0), (end, end), (middle, middle)]
    return lambda: imaging.track(film, points)


def _subsets(count: int) -> Callable[[], object]:
    film, _ = make_film(192, 6, 2.0)
    side = np.linspace(26.0, 165.0, math.ceil(math.sqrt(count)))
    points = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)[:count]
    return lambda: imaging.track(film, points)


def _repeated(samples: int) -> xr.DataArray:
    """Return a bouncing record of any length: the same fall again and again."""
    one = record("acrylic", 0.05).displacement
    step = float(one.time[1] - one.time[0])
    copies = math.ceil(samples / len(one))
    values = np.tile(one.values, copies)[:samples]
    return xr.DataArray(values, {"time": np.arange(samples) * step}, ["time"], attrs=one.attrs)


def _velocity(samples: int) -> Callable[[], object]:
    displacement = _repeated(samples)
    return lambda: signals.velocity(displacement)


def _events(samples: int) -> Callable[[], object]:
    whole = record("acrylic", samples * 50e-6).displacement

    def call() -> object:
        import warnings

        with warnings.catch_warnings(action="ignore", category=UserWarning):
            # short records end before rest, on purpose
            return signals.bounces(whole)

    return call


def _terms(count: int) -> Callable[[], object]:
    # all of them within the duration of an impact, where none can be folded away
    times = np.geomspace(1e-5, 1e-2, count)
    solid = Prony(1e9, np.full(count, 1e9 / count), times, nu=0.35)
    return lambda: contact.drop(solid, _SPHERE, _MASS, _HEIGHT, 0.03)


def _impacts(count: int) -> Callable[[], object]:
    solid = materials.load("acrylic")
    first = math.sqrt(2 * _HEIGHT / 9.81)
    # flights shorten by the restitution, about 0.94; each is twice the time of the first fall
    flights = sum(2 * first * 0.94**k for k in range(1, count))
    duration = first + flights + 2e-3 * count
    return lambda: contact.drop(solid, _SPHERE, _MASS, _HEIGHT, duration)


def _elements(count: int) -> Callable[[], object]:
    solid = materials.load("nbr")
    time = np.linspace(0.0, 1.0, 11)
    pressed = 0.3e-3 * np.sin(np.pi * time) ** 2
    return lambda: contact.indent(solid, 1e-3, 5e-3, 10e-3, time, pressed, elements=count)


def _planned(folder: Path, count: int) -> Callable[[], object]:
    """Write a session of many experiments over one recording; nothing of it is computed."""
    place = folder / f"plan{count}"
    files.write_text(place / "calibration/laser.toml", laser_record())
    files.write_text(place / "laser/one.csv", "not read by a plan\n")
    text = session_head("Planned (synthetic)")
    for number in range(count):
        text += drop_section(f"drop_{number}", ["laser/one.csv"], _HEIGHT, "acrylic")
    files.write_text(place / "session.toml", text)
    return lambda: verbs.plan(place)

"""Numbers that no instrument should give: a documented result or an error of ours, never more.

The input of every step is damaged in one to three ways, drawn at random; one example of each comes first where steps
are quick. No warning of numpy escapes, nothing infinite is returned, and no input is changed.
"""

import dataclasses
import random
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray

from labpipe import signals
from labpipe.errors import LabpipeError
from labpipe.signals._first_touch import first_touch

Amount = Callable[[int, int], int]
Array = NDArray[Any]
Columns = list[Array]


def drop() -> Columns:
    """A fall of 5 mm, three bounces without loss of time in between, then rest; 670 Hz."""
    time = np.arange(0.0, 0.35, 1.5e-3)
    height, start, speed = np.where(time < 0.032, 0.005 - 0.5 * 9.81 * time**2, 0.0), 0.032, 0.3132
    for _ in range(3):
        speed *= 0.6
        s = time - start
        start += 2 * speed / 9.81
        height = np.where((s >= 0.0) & (time < start), speed * s - 0.5 * 9.81 * s**2, height)
    return [time, height + 1e-7 * np.sin(1e6 * time)]


def fall() -> Columns:
    """The drop as a slow sensor sees it, for steps that need no impacts."""
    return [column[::2] for column in drop()]


def wave() -> Columns:
    time = np.arange(0.0, 6.0, 0.02)
    return [time, 1e-4 * np.sin(2 * np.pi * time + 0.3) + 1e-6 * np.sin(1e4 * time)]


def indented() -> Columns:
    time, moved = wave()
    return [time, moved, 2.0 + np.sin(2 * np.pi * time + 0.6) + 1e-3 * np.cos(1e4 * time)]


def approach() -> Columns:
    position = np.linspace(0.0, 1e-4, 150)
    force = np.maximum(0.0, position - 6e-5) * 1e5
    return [position, force + 1e-3 * np.sin(1e9 * position)]


def record(time: Array, values: Array) -> xr.DataArray:
    size = min(time.size, values.size)
    time, values = time.ravel()[:size], values.ravel()[:size]
    attrs = {"units": "m", "long_name": "displacement"}
    axis = ("time", time, {"units": "s", "long_name": "time"})
    return xr.DataArray(values, dims="time", coords={"time": axis}, name="displacement", attrs=attrs)


STEPS: dict[str, tuple[Callable[[], Columns], Callable[..., object]]] = {
    "velocity": (fall, lambda t, y: signals.velocity(record(t, y))),
    "bounces": (drop, lambda t, y: signals.bounces(record(t, y))),
    "sinusoid": (wave, signals.fit_sinusoid),
    "common fit": (indented, signals.common_fit),
    "first touch": (approach, first_touch),
}

Fault = Callable[[Columns, random.Random], Columns]


def one(change: Callable[[Array, random.Random], Array]) -> Fault:
    """Damage one column of several, the last one more often than the first."""

    def fault(columns: Columns, rng: random.Random) -> Columns:
        k = max(rng.randrange(len(columns)), rng.randrange(len(columns)))
        return [*columns[:k], change(columns[k].copy(), rng), *columns[k + 1 :]]

    return fault


def every(change: Callable[[Array], Array]) -> Fault:
    return lambda columns, rng: [change(c) for c in columns]


def kept(count: int) -> Fault:
    return every(lambda c: c[:count])


def put(value: float) -> Fault:
    def change(column: Array, rng: random.Random) -> Array:
        for _ in range(rng.choice([1, 1, 3])):
            if column.size:
                column[rng.randrange(column.size)] = value
        return column

    return one(change)


def gap(column: Array, rng: random.Random) -> Array:
    start = rng.randrange(column.size + 1)
    column[start : start + rng.randrange(column.size + 1)] = np.nan
    return column


def uneven(columns: Columns, rng: random.Random) -> Columns:
    """Readings left out at random, all columns alike."""
    keep = np.array([rng.random() < 0.8 for _ in range(max(c.size for c in columns))], bool)
    return [c[keep[: c.size]] if c.ndim == 1 else c for c in columns]


FAULTS: dict[str, Fault] = {
    "empty": kept(0),
    "one point": kept(1),
    "nine points": kept(9),
    "constant": one(lambda c, rng: np.full_like(c, rng.choice([0.0, 1e-9, 3.0]))),
    "all NaN": one(lambda c, rng: np.full_like(c, np.nan)),
    "NaN": put(np.nan),
    "infinite": put(np.inf),
    "outlier": put(1e3),
    "gap": one(gap),
    "uneven": uneven,
    "offset": one(lambda c, rng: c + rng.choice([1e9, -1e9, 1e6])),
    "huge": one(lambda c, rng: c * 1e200),
    "tiny": one(lambda c, rng: c * 1e-200),
    "two dimensions": one(lambda c, rng: c.reshape(-1, 1)),
}
COSTLY = {"bounces": 3, "velocity": 12}
"""Examples in every run, of steps that take a tenth of a second."""


def parts(found: object) -> list[Array]:
    """All numbers of a result."""
    if isinstance(found, xr.Dataset):
        return [v.values for v in [*found.data_vars.values(), *found.coords.values()]]
    if isinstance(found, xr.DataArray):
        return parts(found.to_dataset(name="values"))
    if dataclasses.is_dataclass(found):
        return [a for f in dataclasses.fields(found) for a in parts(getattr(found, f.name))]
    if isinstance(found, tuple | list):
        return [a for part in found for a in parts(part)]
    return [np.asarray(found)]


def tried(step: str, columns: Columns) -> list[Array] | str:
    """Run a step on columns that cannot be written; return its numbers, or its error's text."""
    given = [c.copy() for c in columns]
    for column in columns:
        column.setflags(write=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", UserWarning)
        try:
            found = parts(STEPS[step][1](*columns))
        except LabpipeError as error:
            return str(error)
    for before, after in zip(given, columns, strict=True):
        np.testing.assert_array_equal(before, after)
    numbers = [a for a in found if a.dtype.kind == "f"]
    assert not any(np.isinf(a).any() for a in numbers)
    return numbers


@pytest.mark.parametrize("step", STEPS)
def test_damaged_columns_give_a_result_or_an_error_of_ours(step: str, amount: Amount) -> None:
    rng = random.Random(step)
    sound, names = STEPS[step][0](), list(FAULTS)
    rng.shuffle(names)
    for n in range(amount(COSTLY.get(step, len(names) + 8), 3_400)):
        chosen = [names[n]] if n < len(names) else rng.choices(names, k=rng.randint(1, 3))
        columns = [c.copy() for c in sound]
        with np.errstate(all="ignore"):
            for name in chosen:
                columns = FAULTS[name](columns, rng)
        try:
            tried(step, columns)
        except BaseException as error:
            error.add_note(f"example {n}: {', '.join(chosen)}")
            raise

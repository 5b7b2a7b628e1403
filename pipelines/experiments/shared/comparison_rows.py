"""One row of ``compare``: a curve or a single value, measured and simulated; where curves of a drop are compared."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from math import erfc, sqrt
from typing import Any

import numpy as np
import xarray as xr

from labpipe.arrays import Floats, Integers
from labpipe.judging import Agreement
from labpipe.report import quantity, value_with_uncertainty
from labpipe.signals import nrmse
from labpipe.variables import variable

IMPACTS = 3
"""Impacts that are compared one by one, and have a budget; the thesis compares the first three."""
FORCE_SCALE, STIFFNESS = "scale of force", "modulus of the rubber"
"""Inputs of the rows of an indentation, relative: the cell's gain, and the material as a whole."""
_WORDS = ("against", "slopes", "simulated")
"""Arguments of a row that are no numbers."""


@dataclass(frozen=True, slots=True)
class Row:
    """One comparison.

    ``experiment``, ``kind``, ``material`` and ``condition`` (height, temperature or load) that a kind leaves empty are
    filled in by ``compare``. ``quantity`` is in the SI ``unit``, of ``n`` repeats or points of a curve, compared
    ``against`` the model or another measurement. Values of an event have standard uncertainties; the difference is
    measured minus model. Of a curve only the difference is given, the bias, with ``nrmse``, relative to the range of
    the model, and chi square where its uncertainties are known along it (:func:`labpipe.judging.along_curve`).

    ``slopes`` are derivatives of the difference to each input that several rows share [SI], so that it is counted once;
    ``simulated`` are variable and impact, from 0, of the simulated drop with which the measurement is compared;
    ``kept`` are results behind it that earlier code made and that were taken as they are.
    """

    experiment: str
    kind: str
    material: str
    condition: str
    quantity: str
    unit: str
    n: int
    against: str = "model"
    measured: float | None = None
    u_measured: float | None = None
    model: float | None = None
    u_model: float | None = None
    difference: float | None = None
    u_difference: float | None = None
    nrmse: float | None = None
    chi2: float | None = None
    degrees_of_freedom: float | None = None
    p_of_curve: float | None = None
    slopes: Mapping[str, float] = field(default_factory=dict)
    simulated: tuple[str, int] | None = None
    kept: tuple[str, ...] = ()

    @property
    def is_curve(self) -> bool:
        """Return whether a whole curve is compared."""
        return self.nrmse is not None

    @property
    def deviation(self) -> float | None:
        """Difference in units of its standard uncertainty."""
        if self.is_curve or self.difference is None or not self.u_difference:
            return None
        return self.difference / self.u_difference

    @property
    def p(self) -> float | None:
        """Probability of a larger difference, if model and uncertainties are right."""
        if self.is_curve:
            return self.p_of_curve
        return None if self.deviation is None else erfc(abs(self.deviation) / sqrt(2))

    @property
    def texts(self) -> tuple[str | None, ...]:
        """Measured and expected value and their difference, in words; None where there is none."""
        pairs = ((self.measured, self.u_measured), (self.model, self.u_model), (self.difference, self.u_difference))
        return tuple(
            None if v is None else value_with_uncertainty(v, u, self.unit) if u else quantity(v, self.unit)
            for v, u in pairs
        )

    def document(self) -> dict[str, Any]:
        """Return the row for JSON."""
        shown = asdict(self) | {"deviation": self.deviation, "p": self.p}
        return {name: value for name, value in shown.items() if name not in ("slopes", "p_of_curve", "simulated")}


def row(quantity: str, unit: str, n: int, *, material: str = "", condition: str = "", **values: Any) -> Row:
    """Return a row without its experiment; numbers that are not finite become None.

    A value with its standard uncertainty is given as a pair.

    Examples
    --------
    >>> made = row("restitution", "1", 3, measured=(0.8, 0.1), model=0.7)
    >>> made.measured, made.u_measured, made.u_model
    (0.8, 0.1, None)
    """
    made: dict[str, Any] = {name: values.pop(name) for name in _WORDS if name in values}
    pairs = {name: value for name, value in values.items() if isinstance(value, tuple)}
    values |= {key: v for name, pair in pairs.items() for key, v in zip((name, f"u_{name}"), pair, strict=True)}
    made |= {name: float(value) for name, value in values.items() if value is not None and np.isfinite(value)}
    if "degrees_of_freedom" in made:
        made["degrees_of_freedom"] = told_freedom(made["degrees_of_freedom"])
    return Row("", "", material, condition, quantity, unit, n, **made)


def with_its_u(result: xr.Dataset, name: str, i: int) -> tuple[Any, Any]:
    """Return one of the values of a result, and its standard uncertainty."""
    return result[name][i], result[f"u_{name}"][i]


def told_freedom(value: float) -> float:
    """Return degrees of freedom as they are shown: a whole number, or one with a decimal."""
    return int(value) if value == int(value) else round(value, 1)


_OF_CURVE = {
    "chi2": ("chi_square", "chi square of the curve, in stretches"),
    "degrees_of_freedom": ("degrees_of_freedom", "degrees of freedom of the curve"),
    "p_of_curve": ("p", "probability of a larger chi square of the curve"),
}
"""Values of a row by which a curve agrees: the end of the name of each in a table, and its text."""


def curve_table(dim: str | tuple[()], found: Sequence[Agreement | None], name: str = "curve") -> dict[str, Any]:
    """Return chi square, degrees of freedom and p of one curve, or of several over a dimension; NaN where unknown."""
    known = [(np.nan,) * 3 if a is None else (a.chi2, float(a.degrees_of_freedom), a.p) for a in found]
    columns = zip(_OF_CURVE.values(), np.array(known, float).reshape(-1, 3).T, strict=True)
    return {f"{name}_{key}": variable(dim, v if dim else v[0], "1", text) for (key, text), v in columns}


def of_curve(comparison: xr.Dataset, name: str = "curve") -> dict[str, Any]:
    """Return the agreement of a curve as values of a row, from a table of :func:`curve_table`."""
    return {key: comparison[f"{name}_{of}"] for key, (of, _) in _OF_CURVE.items()}


def apart(measured: xr.DataArray, model: Floats) -> xr.Dataset:
    """Return the residual (time,), measured minus model, with ``nrmse`` and ``bias``."""
    left, units = measured.values - model, str(measured.attrs["units"])
    text = f"measured minus model: {measured.attrs['long_name']}"
    return xr.Dataset(
        {
            "residual": variable("time", left, units, text),
            "nrmse": variable((), nrmse(measured, model), "1", "root-mean-square error over range of model"),
            "bias": variable((), float(np.nanmean(left)), units, "mean of measured minus model"),
        },
        coords={"time": measured["time"]},
    )


def flights(
    time: Floats, touches: Floats, leaves: Floats, release: float, *, count: int = 3, fewest: int = 10
) -> list[Integers]:
    """Return the samples of ``count`` stretches, of at least ``fewest``, in the fall and each flight that is whole.

    The fall begins with the release [s], contacts begin and end at ``touches`` and ``leaves`` (impact,) [s]. A tenth of
    a flight is left out at either end, where a small shift in time is a large one in height.
    """
    places: list[Integers] = []
    for begin, end in zip((max(release, float(time[0])), *leaves), touches, strict=False):
        margin = 0.1 * (end - begin)
        inside = np.flatnonzero((time >= begin + margin) & (time <= end - margin))
        if inside.size >= count * fewest and end <= time[-1]:
            places += np.array_split(inside, count)
    return places


def moved_by_scatter(time: Floats, touches: Floats, sd: Floats, velocity: Floats) -> Iterator[Floats]:
    """Yield the effect on a path (sample,) [m] of the scatter that each impact adds: it moves all that follows.

    ``sd`` (impact,) are the standard deviations [s] of times of touch between drops since the first of them.
    """
    for touch, grown in zip(touches[1:], np.diff(np.square(np.nan_to_num(sd))), strict=False):
        if grown > 0.0:
            yield np.where(time > touch, np.sqrt(grown) * velocity, 0.0)

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
from labpipe.variables import variable

IMPACTS = 3
"""Impacts that are compared one by one, and have a budget; the thesis compares the first three."""
FORCE_SCALE, STIFFNESS = "scale of force", "modulus of the rubber"
"""Inputs of the rows of an indentation, relative: the cell's gain, and the material as a whole."""


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
    def p_alone(self) -> float | None:
        """Probability of a curve that decides alone whether a model differs, None of others.

        Along an impact whose moment the model predicts, uncertainties are not propagated linearly.
        """
        return self.p_of_curve if self.is_curve and "impact" not in self.quantity else None

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


def row(
    quantity: str,
    unit: str,
    n: int,
    *,
    material: str = "",
    condition: str = "",
    against: str = "model",
    slopes: Mapping[str, float] | None = None,
    simulated: tuple[str, int] | None = None,
    **values: Any,
) -> Row:
    """Return a row without its experiment; numbers that are not finite become None.

    A value with its standard uncertainty is given as a pair. The difference is by default that of the two values,
    which are independent.

    Examples
    --------
    >>> made = row("restitution", "1", 3, measured=(0.8, 0.03), model=(0.7, 0.04))
    >>> made.measured, f"{made.difference:.2f} ± {made.u_difference:.2f}"
    (0.8, '0.10 ± 0.05')
    """
    pairs = {name: value for name, value in values.items() if isinstance(value, tuple)}
    values |= {key: v for name, pair in pairs.items() for key, v in zip((name, f"u_{name}"), pair, strict=True)}
    made: dict[str, Any] = {n: float(v) for n, v in values.items() if v is not None and np.isfinite(v)}
    if {"measured", "model"} <= made.keys():
        made.setdefault("difference", made["measured"] - made["model"])
        made.setdefault("u_difference", float(np.hypot(made.get("u_measured", 0.0), made.get("u_model", 0.0))))
    if "degrees_of_freedom" in made:
        made["degrees_of_freedom"] = told_freedom(made["degrees_of_freedom"])
    made |= {"slopes": slopes or {}, "simulated": simulated}
    return Row("", "", material, condition, quantity, unit, n, against, **made)


def with_its_u(result: xr.Dataset, name: str, i: int) -> tuple[float, float]:
    """Return one of the values of a result, and its standard uncertainty."""
    return float(result[name].values[i]), float(result[f"u_{name}"].values[i])


def told_freedom(value: float) -> float:
    """Return degrees of freedom as they are shown: a whole number, or one with a decimal."""
    return int(value) if value == int(value) else round(value, 1)


def curve_table(
    dim: str | tuple[()], found: Sequence[tuple[Agreement | None, float, float]], unit: str, part: str = ""
) -> dict[str, Any]:
    """Return the comparison of one curve, or a ``part`` of it, or of several over a dimension; NaN where unknown.

    Of each ``found`` are the agreement along it, the root-mean-square error over the range of the model, and the mean
    of measured minus model, in its ``unit``.
    """
    columns = (
        (f"nrmse{part}", "1", "root-mean-square error over the range of the model"),
        (f"bias{part}", unit, "mean of measured minus model"),
        (f"curve{part}_chi_square", "1", "chi square of the curve, in stretches"),
        (f"curve{part}_degrees_of_freedom", "1", "degrees of freedom of the curve"),
        (f"curve{part}_p", "1", "probability of a larger chi square of the curve"),
    )
    nothing = Agreement(np.nan, np.nan, np.nan, np.nan)
    known = [(error, bias, a.chi2, a.degrees_of_freedom, a.p) for one, error, bias in found for a in [one or nothing]]
    values = zip(columns, np.array(known, float).reshape(-1, len(columns)).T, strict=True)
    return {name: variable(dim, v if dim else v[0], units, text) for (name, units, text), v in values}


def curve_row(quantity: str, unit: str, n: int, comparison: xr.Dataset, part: str = "", **words: Any) -> Row:
    """Return the row of a curve, or of a ``part`` of it, from its :func:`curve_table`."""
    values: dict[str, Any] = {
        "nrmse": comparison[f"nrmse{part}"],
        "difference": comparison[f"bias{part}"],
        "u_difference": comparison.get(f"u_bias{part}"),
        "chi2": comparison[f"curve{part}_chi_square"],
        "degrees_of_freedom": comparison[f"curve{part}_degrees_of_freedom"],
        "p_of_curve": comparison[f"curve{part}_p"],
    }
    return row(quantity, unit, n, **values, **words)


STRETCHES, FEWEST = 3, 10
"""Stretches of a part of a curve that is compared, and the fewest samples of each."""


def split(time: Floats, inside: Integers, since: float, until: float, origin: float) -> list[Integers]:
    """Return ``inside`` samples in stretches from one time [s] to another, ever longer ones behind the origin."""
    count, start = min(STRETCHES, inside.size // FEWEST), max(since - origin, 0.0)
    if not count:
        return []
    share = np.linspace if since < origin else np.geomspace
    edges = share(start, start + until - since, count + 1)[1:-1] + since - start
    return np.split(inside, np.searchsorted(time[inside], edges))


def flights(time: Floats, touches: Floats, leaves: Floats, release: float) -> list[Integers]:
    """Return the samples of stretches in the fall and each flight that is whole.

    The fall begins with the release [s], contacts begin and end at ``touches`` and ``leaves`` (impact,) [s]. A tenth of
    a flight is left out at either end, where a small shift in time is a large one in height.
    """
    places: list[Integers] = []
    for begin, end in zip((max(release, float(time[0])), *leaves), touches, strict=False):
        margin = 0.1 * (end - begin)
        inside = np.flatnonzero((time >= begin + margin) & (time <= end - margin))
        if inside.size >= STRETCHES * FEWEST and end <= time[-1]:
            places += np.array_split(inside, STRETCHES)
    return places


def moved_by_scatter(time: Floats, touches: Floats, sd: Floats, velocity: Floats) -> Iterator[Floats]:
    """Yield the effect on a path (sample,) [m] of the scatter that each impact adds: it moves all that follows.

    ``sd`` (impact,) are the standard deviations [s] of times of touch between drops since the first of them.
    """
    for touch, grown in zip(touches[1:], np.diff(np.square(np.nan_to_num(sd))), strict=False):
        if grown > 0.0:
            yield np.where(time > touch, np.sqrt(grown) * velocity, 0.0)

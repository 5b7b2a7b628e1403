"""Mistakes that several kinds have in common: a stated value, a sampling interval, the scale of a film."""

from collections.abc import Mapping
from math import inf, log
from typing import Any

import xarray as xr

from labpipe.judging import SLIPS, Cause, too_large
from labpipe.report import quantity
from labpipe.units import Quantity
from pipelines.experiments.shared.exact_values import usual_uncertainty
from pipelines.experiments.shared.judgements._page import counted_from_one

ANOTHER_VIEW = 3.0
"""Factor in scale beyond which the record is of another view of the camera."""
_TILTED = 0.94
"""Factor by which a camera that is tilted by 20 degrees shortens lengths."""


def stated_wrongly(
    effects: Mapping[str, float],
    name: str,
    given: Quantity,
    setting: str,
    usual: str = "decimal",
    u: float | None = None,
) -> Cause:
    """Return the mistake that a value of session.toml was typed wrongly, or lies beyond its uncertainty.

    Parameters
    ----------
    effects : mapping of str to float
        See :class:`labpipe.judging.Cause`.
    name : str
        For the sentence.
    given : Quantity
    setting : str
    usual : str
        Key of :data:`labpipe.judging.SLIPS`.
    u : float, optional
        Relative; by default as stated, or half a unit of the last digit.
    """
    relative = (given.u or usual_uncertainty(given)) / given.value if u is None else u
    say = times_over(name, given.value, given.si, f"{counted_from_one(setting)} in session.toml")
    return Cause(effects, say, SLIPS[usual], u=relative, setting=setting)


def wrong_interval(effects: Mapping[str, float], file: str, readings: xr.Dataset, is_stated: bool) -> Cause:
    """Return the mistake that a sampling interval is wrong, in a recording's header or as session.toml states it."""
    line = None if is_stated else line_of(str(readings.attrs.get("header", "")), "cycle", "period", "周期")
    place = "" if line is None else f"line {line} of {file}"
    say = times_over("the sampling interval", float(readings.attrs["sampling_interval"]), "s", place)
    setting = "keyence.cycle" if is_stated else ""
    return Cause(effects, say, SLIPS["interval"], file="" if is_stated else file, line=line, setting=setting)


def wrong_scale(effects: Mapping[str, float], record: str, u: float = inf) -> Cause:
    """Return the mistake that the scale of a camera's calibration record is wrong."""

    def say(factor: float) -> str:
        why = ", of another view" if abs(log(factor)) > log(ANOTHER_VIEW) else ""
        why = ", or the camera is tilted" if _TILTED < factor < 1.0 else why
        return f"lengths come out {too_large(factor)}: the scale in {record} is wrong{why}"

    usual = SLIPS["length"] + SLIPS["gain"] + SLIPS["view"]
    return Cause(effects, say, usual, u=u, file=record, setting="values.pixel_length")


def times_over(name: str, stated_value: float, unit: str, what: str) -> Any:
    """Return the sentence of a cause: what a stated value [SI] would have to be, and where it stands.

    Examples
    --------
    >>> say = times_over("the height", 1.5e-3, "m", "")
    >>> say(0.1)
    'the height is probably 15.0 mm, not 1.50 mm'
    >>> say(1.0004)
    'the height is probably 0.04 % less than the 1.50 mm that are stated'
    """

    def say(factor: float) -> str:
        right = quantity(stated_value / factor, unit)
        given = quantity(stated_value, unit)
        place = f" ({what})" if what else ""
        if right == given:
            off, more = abs(100.0 * (1.0 / factor - 1.0)), "more" if factor < 1.0 else "less"
            return f"{name} is probably {off:.2g} % {more} than the {given} that are stated{place}"
        return f"{name} is probably {right}, not {given}{place}"

    return say


def line_of(header: str, *words: str) -> int | None:
    """Return the line of a file's header that holds one of some words; None when none does."""
    for number, text in enumerate(header.splitlines(), 1):
        if any(word.lower() in text.lower() for word in words):
            return number
    return None

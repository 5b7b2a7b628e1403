"""Checks and causes that several kinds have in common: failed steps, stated values, days, intervals, scales."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import date, timedelta
from math import inf, log
from types import MappingProxyType
from typing import Any

import xarray as xr

from calibration.record import UNDATED
from labpipe import errors
from labpipe.judging import SLIPS, Cause, Check, Level, not_made, too_large
from labpipe.report import quantity, value_with_uncertainty
from labpipe.units import Quantity
from labpipe.workflow.context import Context
from labpipe.workflow.document import counted
from labpipe.workflow.fields import POSITIVE, REFERENCE, Range, every_setting, mark
from pipelines.experiments.shared.exact_values import usual_uncertainty

_NOT_READ = "the file is not what the session says, or was not copied whole"
_USUAL = {
    errors.NO_MATERIAL: "the name of the material is misspelt",
    errors.MATERIAL_FILE: "the file of the material lacks a table or holds a wrong value",
    errors.UNKNOWN_FORMAT: "the file is not what the session says, or of a format that is not read",
    errors.UNREADABLE: _NOT_READ,
    errors.UNSAID: _NOT_READ,
    "readings": _NOT_READ,
    errors.NO_FILM: "the folder is not that of the film, or its images are of a format that is not read",
    "displacement": "the calibration record does not belong to this recording: it is expired, of another instrument or "
    "of a camera, or a value of it is wrong; or the clock of the instrument was reset",
}
"""Most likely fault of a record, by the reason of the error or the step that fails, of many kinds."""
_SETTINGS = {errors.NO_MATERIAL: "sphere.material", errors.MATERIAL_FILE: "sphere"}
"""Setting that mends it, by the reason of the error."""

_LOST = "the file was not copied into the session, or session.toml gives it another name"
_OF_RUN = (
    "the program did not get through this step, which tells nothing about the record: run it again, and report it if "
    "it happens again"
)
_ONE_DAY = timedelta(days=1)
"""By which days may differ that are the same: clocks of cameras count in UTC."""
_ANOTHER_VIEW = 3.0
"""Factor in scale beyond which the record is of another view of the camera."""


def measured_by(material: Any) -> str:
    """Return the experiment or file that knows a material as settings choose it; empty for one known by its name."""
    chosen = getattr(material, "material_from", None) or getattr(material, "material_file", None)
    return (chosen or "").removeprefix(REFERENCE)


def uncertainties_stated(settings: Any) -> Iterator[Check]:
    """Compare the stated uncertainties of positive quantities with their values, lengths more strictly."""
    for setting, value, kind in every_setting(settings):
        is_positive = mark(kind, Range) == POSITIVE
        if isinstance(value, Quantity) and value.u > 0.0 and is_positive:
            text = f"{counted(setting)} is {value_with_uncertainty(*value)}"
            share = 1 / 3 if value.si == "m" else 1 / 2
            level: Level | None = "doubtful" if value.u >= share * value.value else None
            cause = "the uncertainty was typed in another unit or with a lost decimal"
            yield Check(f"uncertainty of {counted(setting)}", text, level, cause=cause, setting=setting)


def day_known(calibrated: xr.Dataset | None, record: str, file: str = "the recording") -> Check:
    """Compare the day of a recording with that of its clock; a calibration record is chosen by it."""
    name = "day of the recording"
    if calibrated is None or not str(calibrated.attrs.get("calibration", "")).startswith("{"):
        return not_made(name, "a calibration record")
    checked = json.loads(calibrated.attrs["calibration"])
    said, told, clock = (str(checked.get(of, "")) for of in ("validity_check", "stated_day", "recorded_day"))
    if told and clock and abs(date.fromisoformat(told) - date.fromisoformat(clock)) > _ONE_DAY:
        is_valid = checked["valid_from"] <= clock <= checked["valid_until"]
        text = f"{file}: session.toml says measured_on = {told}, which is used; the file itself says {clock}"
        text += "" if is_valid else f", when {record} was not valid"
        cause = "measured_on is the day of another recording, or the clock of the instrument was set wrongly"
        return Check(name, text, "note" if is_valid else "doubtful", cause=cause, setting="measured_on")
    if not checked.get("no_day"):
        return Check(name, f"{record}: {said}", None)
    cause = "the clock of the instrument was never set, or lost its battery"
    if checked["no_day"] == UNDATED:
        cause = "files of this form hold no day: state it as measured_on"
    return Check(name, f"whether {record} was valid is {said}", "note", cause=cause, setting="measured_on")


def failed_steps(
    context: Context, causes: Mapping[str, str], settings: Mapping[str, str] = MappingProxyType({})
) -> list[Check]:
    """Turn steps that gave no result into checks that failed, or that could not be made.

    Where the run was at fault, as by a program that changed under it, a full disk, or a mistake of
    the program itself, nothing is said of the record but that the verdict lacks a step. ``causes`` give
    by stage, or by the reason of the error, the likeliest fault of a record on which it fails,
    ``settings`` by that reason which setting mends it.
    """
    found: dict[str, Check] = {}
    for failure in context.failures:
        if failure.is_consequence or failure.stage in found:
            continue
        if experiment := failure.stage.rpartition("/")[0]:
            text, cause = f"{experiment} gave no result", f"see {experiment} first"
            found[failure.stage] = Check(f"input from {experiment}", text, "note", cause=cause, is_generic=True)
            continue
        names_it = not failure.recording or failure.message.startswith(failure.recording)
        where = "" if names_it else f"{failure.recording}: "
        name, text = f"step {failure.stage}", f"{where}{failure.message}"
        is_lost = failure.reason == errors.MISSING
        if failure.is_of_run or is_lost:
            needs, cause = ("this file", _LOST) if is_lost else ("a run that gets through this step", _OF_RUN)
            found[failure.stage] = Check(name, text, "note", needs=needs, cause=cause, is_generic=True)
            continue
        known, place = _USUAL | dict(causes), (_SETTINGS | dict(settings)).get(failure.reason, "")
        cause, file = known.get(failure.reason) or known.get(failure.stage, ""), failure.recording or ""
        found[failure.stage] = Check(name, text, "impossible", cause=cause, file=file, setting=place, is_generic=True)
    return list(found.values())


def because(checks: Sequence[Check], cause: str, *names: str, **changes: Any) -> list[Check]:
    """Return checks, those of some names that fail for a cause that another one found; "" blames nothing.

    ``changes`` are further fields of those checks, such as a ratio that is no longer one: NaN.
    """
    return [replace(c, cause=cause, **changes) if cause and c.level and c.name in names else c for c in checks]


def stated_wrongly(
    effects: Mapping[str, float],
    name: str,
    given: Quantity,
    setting: str,
    usual: str = "decimal",
    u: float | None = None,
) -> Cause:
    """Return the mistake that a value of session.toml was typed wrongly, or is beyond its uncertainty.

    ``usual`` is a key of :data:`labpipe.judging.SLIPS`; ``u``, relative, is by default as stated, or half a unit of the
    last digit.
    """
    relative = (given.u or usual_uncertainty(given)) / given.value if u is None else u
    say = times_over(name, given.value, given.si, f"{counted(setting)} in session.toml")
    return Cause(effects, say, SLIPS[usual], u=relative, is_stated=given.u > 0.0, setting=setting)


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
        why = ", of another view" if abs(log(factor)) > log(_ANOTHER_VIEW) else ""
        return wrong_lengths(f"the scale in {record} is wrong{why}")(factor)

    usual = SLIPS["length"] + SLIPS["gain"] + SLIPS["view"]
    return Cause(effects, say, usual, u=u, file=record, setting="values.pixel_length")


def wrong_lengths(why: str) -> Callable[[float], str]:
    """Return the sentence of a cause that multiplies all lengths: by how much, and why."""
    return lambda factor: f"lengths come out {too_large(factor)}: {why}"


def times_over(name: str, stated_value: float, unit: str, what: str) -> Any:
    """Return the sentence of a cause: the right value [SI] for a stated one, and its place.

    Examples
    --------
    >>> say = times_over("the height", 1.5e-3, "m", "")
    >>> say(0.1)
    'the height is probably 15.0 mm, not 1.50 mm'
    >>> say(1.0004)
    'the height is probably 0.04 % less than the 1.50 mm that are stated'
    """

    def say(factor: float) -> str:
        values = (stated_value / factor, stated_value)
        right, given = (f"{value:.3g}" if unit == "1" else quantity(value, unit) for value in values)
        said = f"{right}, not {given}"
        if right == given:
            more = "more" if factor < 1.0 else "less"
            said = f"{abs(100.0 * (1.0 / factor - 1.0)):.2g} % {more} than the {given} that are stated"
        return f"{name} is probably {said}{f' ({what})' * bool(what)}"

    return say


def line_of(header: str, *words: str) -> int | None:
    """Return the line of a file's header that holds one of some words, in small letters; None when none does."""
    lines = enumerate(header.lower().splitlines(), 1)
    return next((number for number, text in lines if any(word in text for word in words)), None)

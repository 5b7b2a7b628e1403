"""Checks that several kinds have in common."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import date, timedelta
from types import MappingProxyType
from typing import Any

import xarray as xr

from calibration.record import UNDATED
from labpipe import errors
from labpipe.judging import Check, Level, not_made, stated, unfinished
from labpipe.report import value_with_uncertainty
from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.shared.judgements._page import counted_from_one

_LARGE, _VAGUE = 0.2, 0.05
"""Of a stated value, beyond which its uncertainty is doubtful, and beyond which it hides a slip of typing."""
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
    "of a camera, or a value of it is wrong",
}
"""Most likely fault of a record, by the reason of the error or the step that fails, of many kinds."""
_SETTINGS = {errors.NO_MATERIAL: "sphere.material", errors.MATERIAL_FILE: "sphere"}
"""Setting that mends it, by the reason of the error."""

_ONE_DAY = timedelta(days=1)
"""By which days may differ that are the same: clocks of cameras count in UTC."""


def uncertainties_stated(given: Iterable[tuple[str, Quantity]]) -> Iterator[Check]:
    """Compare stated uncertainties, each with its setting, with the values to which they belong."""
    for setting, value in given:
        named = counted_from_one(setting)
        text = f"{named} is stated as {value_with_uncertainty(value.value, value.u, value.si)}"
        text += "" if value.u else ", without ±"
        level: Level | None = None
        cause, share = "", value.u / abs(value.value) if value.value else 0.0
        if share > _LARGE:
            level, cause = "doubtful", "the uncertainty was typed in another unit or with a lost decimal"
        elif share > _VAGUE:
            level = "note"
            cause = f"{named} is known too vaguely to judge by: a difference of {400 * share:.0f} % would pass"
        yield stated(f"uncertainty of {setting}", text, level, cause=cause, setting=setting)


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
        return stated(name, text, "note" if is_valid else "doubtful", cause=cause, setting="measured_on")
    if not checked.get("no_day"):
        return stated(name, f"{record}: {said}", None)
    cause = "the clock of the instrument was never set, or lost its battery"
    if checked["no_day"] == UNDATED:
        cause = "files of this form hold no day: state it as measured_on"
    return stated(name, f"whether {record} was valid is {said}", "note", cause=cause, setting="measured_on")


def failed_steps(
    context: Context, causes: Mapping[str, str], settings: Mapping[str, str] = MappingProxyType({})
) -> list[Check]:
    """Turn steps that gave no result into checks that failed, or that could not be made.

    Where the run was at fault, as by a program that changed under it, a full disk, or a mistake of
    the program itself, nothing is said of the record but that the verdict lacks a step. ``causes`` say
    by stage, or by the reason of the error, what most likely is wrong with a record on which it fails,
    ``settings`` by that reason which setting mends it.
    """
    found: dict[str, Check] = {}
    for failure in context.failures:
        if failure.is_consequence or failure.stage in found:
            continue
        names_it = not failure.recording or failure.text.startswith(failure.recording)
        where = "" if names_it else f"{failure.recording}: "
        if failure.is_of_run:
            found[failure.stage] = unfinished(
                f"step {failure.stage}",
                f"{where}{failure.text}",
                "the program did not get through this step, which tells nothing about the record: run it again, and "
                "report it if it happens again",
            )
            continue
        known = _USUAL | dict(causes)
        found[failure.stage] = stated(
            f"step {failure.stage}",
            f"{where}{failure.text}",
            "impossible",
            cause=known.get(failure.reason) or known.get(failure.stage, ""),
            file=failure.recording or "",
            setting=(_SETTINGS | dict(settings)).get(failure.reason, ""),
            is_generic=True,
        )
    return list(found.values())


def because(checks: Sequence[Check], cause: str, *names: str, **changes: Any) -> list[Check]:
    """Return checks, those of some names that fail for a cause that another one found; "" blames nothing.

    ``changes`` are further fields of what is blamed: a ratio that is no longer one of what it seemed is NaN.
    """
    return [replace(c, cause=cause, **changes) if cause and c.level and c.name in names else c for c in checks]

"""Dates and times of day as instruments write them."""

import contextlib
from datetime import datetime

_DATES = ("%Y/%m/%d", "%Y-%m-%d", "%d.%m.%Y", "%a, %b %d, %Y", "%b %d, %Y")
_CLOCKS = ("", " %H:%M:%S", " %H:%M:%S.%f", "T%H:%M:%S", "T%H:%M:%S.%f", " %H:%M")


def moment(text: str) -> datetime | None:
    """Return the moment of a date, with or without a time of day; None in a form that is not known or ambiguous."""
    for form in (day + time for day in _DATES for time in _CLOCKS):
        with contextlib.suppress(ValueError):
            return datetime.strptime(text, form)
    return None

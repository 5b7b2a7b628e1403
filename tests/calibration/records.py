"""Calibration records of one day, made of texts as a file states them."""

from datetime import date

from calibration.record import KINDS, CameraValues, LaserValues, LoadCellValues, Record
from labpipe.units import quantity

VALUES = {"camera": CameraValues, "laser": LaserValues, "load_cell": LoadCellValues}


def made(kind: str, instrument: str, day: date, texts: dict[str, str], **changes: object) -> Record:
    whole = {"version": 1, "kind": kind, "id": "r", "instrument": instrument, "who": "a", "when": day, "how": "b"}
    whole |= {"valid_from": day, "valid_until": day} | changes
    return KINDS[kind](**whole, values=VALUES[kind](**{name: quantity(text) for name, text in texts.items()}))

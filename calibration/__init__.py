"""Calibration: readings to SI quantities with uncertainty.

A calibration is a record: one TOML file per sensor and period (:mod:`calibration.record`). Each
kind is applied by one module: :mod:`calibration.laser`, :mod:`calibration.load_cell`,
:mod:`calibration.camera`. :func:`apply` chooses by the kind of the record. A record of another
sensor, another view or another time is refused.
"""

import importlib
import os
from typing import Any

from calibration.record import KINDS, Record, load_record, require
from labpipe.errors import CalibrationError
from labpipe.installation import BUILD

__all__ = ["APPLY", "BUILD", "KINDS", "Record", "apply", "load_record", "require"]

#: Kind of record to the function of the module of its name that applies it, imported only when it is called.
APPLY: dict[str, str] = {"laser": "displacement", "load_cell": "force", "camera": "motion"}


def apply(readings: Any, record: Record | str | os.PathLike[str], **options: Any) -> Any:
    """Turn readings into SI quantities with the record that belongs to them.

    Parameters
    ----------
    readings : Dataset
        As an instrument reader returns them.
    record : Record or path-like
        The calibration, or the file that holds it.
    **options
        Of the function for this kind of record, for example ``zero``, ``direction`` for
        :func:`calibration.laser.displacement`.

    Returns
    -------
    Dataset
        Quantities with their ``u_``.

    Raises
    ------
    CalibrationError
        The record is of another kind, sensor or time.

    Examples
    --------
    >>> moved = apply(readings, "calibration/laser.toml", direction=-1)  # doctest: +SKIP
    """
    if not isinstance(record, Record):
        record = load_record(record)
    if record.kind not in APPLY:
        raise CalibrationError(
            f'record "{record.id}" is of the kind "{record.kind}", which is not applied to '
            f"readings; these are: {', '.join(APPLY)}"
        )
    module = importlib.import_module(f"calibration.{record.kind}")
    return getattr(module, APPLY[record.kind])(readings, record, **options)

"""What a stored judgement holds."""

import json
from typing import Any

import numpy as np
import xarray as xr

from labpipe.judging import Judgement, from_json
from pipelines.experiments.shared.comparison_rows import told_freedom
from pipelines.experiments.shared.judgements._words import of_error


def believed(result: xr.Dataset) -> Judgement:
    """Return the checks and the verdict of a stored judgement."""
    return from_json(result.attrs["judgement"])


def suspected(result: xr.Dataset) -> list[str]:
    """Return what would explain a model that differs or cannot be held against the record, the likeliest first."""
    return list(json.loads(result.attrs.get("suspects", "[]")))


def counted_as_exact(result: xr.Dataset) -> list[str]:
    """Return the names of the values that were stated without an uncertainty."""
    return list(json.loads(result.attrs.get("exact", "[]")))


def compared(result: xr.Dataset) -> dict[str, Any]:
    """Return what the comparison of one experiment came to, for JSON."""
    units = json.loads(result.attrs["units"])
    errors = result["detectable_error"].values
    names = [str(name) for name in result["input"].values]
    return {
        "model": str(result.attrs["model"]),
        "chi2": _finite(result["chi_square"]),
        "degrees_of_freedom": told_freedom(float(result["degrees_of_freedom"])),
        "p": _finite(result["p"]),
        "suspects": suspected(result),
        "detectable": {
            name: {"value": float(error) if np.isfinite(error) else None, "unit": of_error(unit)}
            for name, error, unit in zip(names, errors, units, strict=True)
        },
    }


def _finite(value: Any) -> float | None:
    return float(value) if np.isfinite(float(value)) else None

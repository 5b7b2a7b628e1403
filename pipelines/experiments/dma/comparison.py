"""Comparison of a master curve: shifted readings with the fitted spectrum."""

from collections.abc import Iterator

import numpy as np
import xarray as xr

from labpipe import signals
from pipelines.experiments.shared.comparison_rows import Row, row


def rows(master_curve: xr.Dataset) -> Iterator[Row]:
    """Yield the row of ``compare``."""
    parts = ("storage", "loss")
    measured = np.concatenate([master_curve[f"{p}_reduced"].values.ravel() for p in parts])
    ratio = 1 + np.concatenate([master_curve[f"{p}_residual"].values.ravel() for p in parts])
    known = (measured > 0) & (ratio > 0)
    # As they are drawn: a modulus spans decades, and both parts belong to one curve.
    ours = np.log10(measured[known])
    theirs = ours + np.log10(ratio[known])
    n, nrmse, bias = int(known.sum()), signals.nrmse(ours, theirs), np.mean(ours - theirs)
    at, name = f"{float(master_curve['T_ref']):g} °C", "storage and loss modulus, log10"
    yield row(name, "1", n, against="fit", nrmse=nrmse, difference=bias, condition=at)

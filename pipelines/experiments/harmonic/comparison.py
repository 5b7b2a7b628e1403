"""What a harmonic indentation compares: force over time, and work per cycle."""

from collections.abc import Iterator

import xarray as xr

from pipelines.experiments.harmonic.settings import Harmonic
from pipelines.experiments.shared.comparison_rows import Row, row


def rows(
    comparison: xr.Dataset, oscillations: xr.Dataset, model: xr.Dataset, *, settings: Harmonic
) -> Iterator[Row]:
    """Yield the rows of ``compare``; none where nothing is simulated."""
    del settings
    if "nrmse" not in comparison:
        return
    for i in range(oscillations.sizes["oscillation"]):
        condition = f"{float(oscillations['frequency'][i]):.3g} Hz"
        yield row("force", "N", 1, condition=condition, nrmse=comparison["nrmse"][i],
                  difference=comparison["bias"][i])  # fmt: skip
        yield row(
            "dissipated work per cycle", "J", 1, condition=condition,
            measured=oscillations["work_per_cycle"][i],
            u_measured=oscillations["u_work_per_cycle"][i],
            model=model["work_per_cycle"][i], u_model=model["u_work_per_cycle"][i],
            difference=comparison["work_per_cycle_difference"][i],
            u_difference=comparison["u_work_per_cycle_difference"][i],
        )  # fmt: skip

"""What a static loading compares: contact radii, over time and under each load."""

from collections.abc import Iterator

import xarray as xr

from pipelines.experiments.shared.comparison_rows import Row, row
from pipelines.experiments.static_loading.settings import StaticLoading


def rows(comparison: xr.Dataset, *, settings: StaticLoading) -> Iterator[Row]:
    """Yield the rows of ``compare``."""
    yield row("contact radius", "m", int(comparison["time"].size),
              nrmse=comparison["nrmse_contact_radius_model"],
              difference=comparison["bias_contact_radius_model"])  # fmt: skip
    for i, load in enumerate(settings.loads):
        value, difference = comparison["radius_model"][i], comparison["radius_difference"][i]
        yield row(
            "contact radius", "m", 1, condition=f"{load.mass.value:g} kg",
            measured=float(value) + float(difference), model=value, difference=difference,
            u_difference=comparison["u_radius_difference"][i],
        )  # fmt: skip

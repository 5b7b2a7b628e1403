"""What a film of the contact compares: radii around an impact, and the largest ones."""

from collections.abc import Iterator

import xarray as xr

from pipelines.experiments.contact_area.settings import ContactArea
from pipelines.experiments.shared.comparison_rows import IMPACTS, Row, row


def rows(
    comparison: xr.Dataset, impacts: xr.Dataset, model: xr.Dataset, *, settings: ContactArea
) -> Iterator[Row]:
    """Yield the rows of ``compare``."""
    del settings
    counts = comparison["impact_number"].values
    for i in range(min(IMPACTS, comparison.sizes["impact"])):
        inside = counts == i + 1
        gap = (comparison["film"] - comparison["model"]).values[inside]
        yield row(f"contact radius, impact {i + 1}", "m", int(inside.sum()),
                  nrmse=comparison["nrmse"][i], difference=gap.mean())  # fmt: skip
        yield row(
            f"largest radius, impact {i + 1}", "m", 1,
            measured=comparison["peak_radius_film"][i], u_measured=impacts["u_peak_radius"][i],
            model=comparison["peak_radius_model"][i], u_model=model["u_peak_contact_radius"][i],
            difference=comparison["peak_radius_difference"][i],
            u_difference=comparison["u_peak_radius_difference"][i],
        )  # fmt: skip

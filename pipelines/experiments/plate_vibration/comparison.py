"""What a plate vibration compares: the ringing after a blow, and its amplitude."""

from collections.abc import Iterator
from typing import Any

import xarray as xr

from pipelines.experiments.plate_vibration.settings import PlateVibration
from pipelines.experiments.shared.comparison_rows import Row, row


def rows(
    comparison: xr.Dataset, table: xr.Dataset, plate: xr.Dataset, *, settings: PlateVibration
) -> Iterator[Row]:
    """Yield the rows of ``compare``."""
    del settings
    for i in range(table.sizes["series"]):
        where: dict[str, Any] = {
            "material": str(table["material"].values[i]),
            "condition": f"{float(table['height'][i]) * 1e3:g} mm",
        }
        n = int(table["n"][i])
        yield row("plate's displacement", "m", n, nrmse=comparison["nrmse"][i],
                  difference=comparison["bias"][i], **where)  # fmt: skip
        scale = float(plate["modal_mass"][i]) / float(plate["mass"])
        measured = float(table["amplitude"][i])
        own = float(plate["u_modal_mass"][i]) / float(plate["modal_mass"][i])
        yield row(
            "amplitude at the blow", "m", n, measured=measured,
            u_measured=table["u_amplitude"][i], model=measured * scale,
            difference=measured * (1 - scale), u_difference=measured * own, **where,
        )  # fmt: skip

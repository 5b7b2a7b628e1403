"""What a film of the holder compares: its motion with that which the laser saw."""

from collections.abc import Iterator

import xarray as xr

from pipelines.experiments.dic_validation.settings import DicValidation
from pipelines.experiments.shared.comparison_rows import IMPACTS, Row, row


def rows(comparison: xr.Dataset, *, settings: DicValidation) -> Iterator[Row]:
    """Yield the rows of ``compare``; none where no laser saw the motion."""
    del settings
    if "bias" not in comparison:
        return
    yield row("displacement", "m", int(comparison["n_compared"]), against="laser",
              nrmse=comparison["nrmse"], difference=comparison["bias"],
              u_difference=comparison["u_bias"])  # fmt: skip
    for i in range(min(IMPACTS, comparison.sizes["impact"])):
        yield row(
            f"restitution, impact {i + 1}", "1", 1, against="laser",
            measured=comparison["restitution_film"][i], model=comparison["restitution_laser"][i],
            difference=comparison["restitution_difference"][i],
            u_difference=comparison["u_restitution_difference"][i],
        )  # fmt: skip

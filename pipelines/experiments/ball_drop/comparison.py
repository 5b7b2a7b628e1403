"""What a ball drop compares: displacement and restitutions, measured and simulated."""

from collections.abc import Iterator

import numpy as np
import xarray as xr

from pipelines.experiments.ball_drop.settings import BallDrop
from pipelines.experiments.shared.comparison_rows import IMPACTS, Row, row


def rows(
    comparison: xr.Dataset, repeats: xr.Dataset, model: xr.Dataset, *, settings: BallDrop
) -> Iterator[Row]:
    """Yield the rows of ``compare``."""
    del settings
    n = int(repeats.sizes["repeat"])
    relative = float(repeats.attrs["u_systematic_relative"])
    mean_size = float(np.abs(repeats["displacement_mean"]).mean())
    yield row("displacement", "m", n, nrmse=comparison["nrmse"], difference=comparison["bias"],
              u_difference=relative * mean_size)  # fmt: skip
    for i in range(min(IMPACTS, comparison.sizes["impact"])):
        yield row(
            f"restitution, impact {i + 1}", "1", int(repeats["n_repeats"][i]),
            measured=comparison["restitution_measured"][i], u_measured=repeats["u_restitution"][i],
            model=comparison["restitution_model"][i], u_model=model["u_restitution"][i],
            difference=comparison["restitution_difference"][i],
            u_difference=comparison["u_restitution_difference"][i],
        )  # fmt: skip

"""What relaxations compare: the force in the ramp, early and late, and its plateau."""

from collections.abc import Iterator

import xarray as xr

from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared.comparison_rows import Row, row


def rows(tests: xr.Dataset, *, settings: Relaxation) -> Iterator[Row]:
    """Yield the rows of ``compare``; none where nothing is simulated."""
    del settings
    if "nrmse_all" not in tests:
        return
    for i in range(tests.sizes["test"]):
        condition = f"{float(tests['depth'][i]) * 1e3:.2g} mm"
        for part in ("ramp", "early", "late"):
            yield row(f"force, {part}", "N", 1, condition=condition,
                      nrmse=tests[f"nrmse_{part}"][i],
                      difference=tests[f"bias_{part}"][i])  # fmt: skip
        yield row(
            "plateau force", "N", 1, condition=condition,
            measured=tests["plateau_force"][i], u_measured=tests["u_plateau_force"][i],
            model=tests["plateau_force_model"][i],
            difference=tests["plateau_force_difference"][i],
            u_difference=tests["u_plateau_force_difference"][i],
        )  # fmt: skip

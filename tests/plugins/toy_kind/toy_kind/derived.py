"""What ``compare``, ``sensitivity`` and ``init`` make of a ringing bar."""

from collections.abc import Iterator, Sequence
from functools import partial

import xarray as xr

from labpipe.uncertainty import Input
from pipelines.experiments import Found, Proposed
from pipelines.experiments.shared import proposals
from pipelines.experiments.shared.budget_quantity import MEASURED, Quantity
from pipelines.experiments.shared.comparison_rows import Row, row
from toy_kind.settings import RingingBar


def rows(comparison: xr.Dataset, *, settings: RingingBar) -> Iterator[Row]:
    """Yield the one row of ``compare``."""
    yield row(
        "frequency",
        "Hz",
        int(comparison.attrs["recordings"]),
        condition=f"sag {settings.sag.value * 1e3:g} mm",
        **{str(name): value for name, value in comparison.data_vars.items()},
    )


def quantities(comparison: xr.Dataset, *, settings: RingingBar) -> Iterator[Quantity]:
    """Yield the frequency; only the noise of the recordings acts on it."""
    del settings
    inputs = {
        MEASURED: Input(float(comparison["measured"]), 0.0, "Hz"),
        "noise": Input(0.0, float(comparison["u_measured"]), "Hz"),
    }
    yield Quantity("frequency of the bar", "Hz", lambda measured, noise: measured + noise, inputs)


def proposed(found: Found, names: Sequence[str]) -> Iterator[Proposed]:
    """Propose an experiment for repeats of the vibrometer that are called after a bar."""
    ours = [n for n in names if n in found.of("toy_vibrometer") and "bar" in n]
    for stem, files in proposals.grouped(ours, proposals.without_repeat):
        yield Proposed(stem, tuple(files), partial(_text, files))


def _text(files: Sequence[str], name: str) -> str:
    """Return the tables of session.toml."""
    return (
        f'[experiments.{name}]\nkind = "ringing_bar"\n'
        f"recordings = {proposals.listed(files)}\n"
        f'sag = "{proposals.GAP} mm"  # by its own weight, e.g. "0.99 ± 0.01 mm"'
    )

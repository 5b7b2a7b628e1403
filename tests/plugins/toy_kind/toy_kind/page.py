"""The report of a ringing bar."""

import xarray as xr

from labpipe.report import KeyValues, Section, value_with_uncertainty
from labpipe.workflow.context import Context
from pipelines.experiments.shared import pages
from toy_kind.settings import RingingBar


def page(
    readings: list[xr.Dataset | None] | None, comparison: xr.Dataset | None, *, settings: RingingBar, context: Context
) -> str:
    """Write the page; a step that failed leaves its numbers out and its error in."""
    rows = [("sag", pages.stated(settings.sag), "")]
    if comparison is not None:
        rows += [
            (name, value_with_uncertainty(float(comparison[key]), float(comparison[f"u_{key}"]), "Hz"), "")
            for name, key in (("frequency", "measured"), ("by the sag", "model"))
        ]
    blocks = (KeyValues(rows), *pages.raw_headers(pages.present(readings)))
    return pages.document(context, "Ringing bar", [Section("Summary", blocks)]).render()

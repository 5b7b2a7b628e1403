"""The part of the DMA page that compares the shifts with a published table."""

import json

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from labpipe.report import Block, Details, LineChart, Listed, Paragraph, Series, Table, listed
from pipelines.experiments.dma.published import rms
from pipelines.experiments.shared import pages

_SMALL = 0.005  # decades


def series(found: xr.Dataset) -> Series:
    """Return the published shifts, zero at the reference temperature of the page, to draw beside the fitted."""
    good = np.isfinite(found["published"].values)
    T, published = found["temperature"].values[good], found["published"].values[good]
    order = np.argsort(T, kind="stable")
    return Series("published", T[order], published[order], style="points", role="reference")


def blocks(found: xr.Dataset, curve: xr.Dataset) -> list[Block]:
    """Say how far both tables differ and, folded, where it comes from."""
    T = found["temperature"].values
    order = np.argsort(T, kind="stable")
    shared = order[np.isfinite(found["published"].values[order])]
    apart, u = (found["fitted"] - found["published"]).values[shared], found["u_fitted"].values[shared]
    drawn = [Series("difference", T[shared], apart, style="points", role="measured", u=u)]
    gap = LineChart("Fitted less published", "temperature / °C", "difference of log₁₀ a_T", drawn, height_px=220)
    size, *causes = [Paragraph(text) for text in reasons(found, curve)]
    return [size, Details("Differences by temperature", (*causes, gap, _shift_table(found, order)))]


def reasons(found: xr.Dataset, curve: xr.Dataset) -> list[str]:
    """Say in sentences how large the difference is, and whether the readings support it."""
    difference = found["difference"].values
    good = np.isfinite(difference)
    T = found["temperature"].values
    worst = int(np.nanargmax(np.abs(difference)))
    name = found.attrs["published_source"] or found.attrs["published_file"]
    T_ref = float(curve["T_ref"])
    texts = [
        f"The shifts of {name} differ from the fitted ones by {float(np.sqrt(np.mean(difference[good] ** 2))):.2f} "
        f"decades (rms), at most by {abs(difference[worst]):.1f} at {_celsius(T[worst])}.",
        _reference(found, T_ref),
        _imposed(found, curve),
    ]
    return [text for text in texts if text]


def _reference(found: xr.Dataset, T_ref: float) -> str:
    """Say what was done about reference and temperatures."""
    offset = found.attrs["published_at_reference"]
    shift = (
        "which is the reference here too"
        if abs(offset) < _SMALL
        else f"at {_celsius(T_ref)} it has {_signed(offset)}, which is subtracted"
    )
    return (
        f"Reference: the published table is zero at {_celsius(found.attrs['published_zero'])}, "
        f"{shift}; so the reference explains no difference. Its temperatures lie up to "
        f"{found.attrs['temperature_distance']:.1f} K from the measured means; it was interpolated."
    )


def _imposed(found: xr.Dataset, curve: xr.Dataset) -> str:
    """Compare the residuals that either table leaves."""
    ours = [rms(curve[name].values) * 100 for name in ("storage_residual", "loss_residual")]
    theirs = [found.attrs[name] * 100 for name in ("residual_storage", "residual_loss")]
    delay = float(curve["delay"])
    also = f" and the delay of {delay * 1e6:.0f} µs" if delay else ""
    if max(theirs[0] / max(ours[0], 1e-9), theirs[1] / max(ours[1], 1e-9)) > 1.3:
        verdict = (
            "one spectrum fitted to both moduli contradicts the published steps; a table made "
            "from one modulus, with other vertical factors or by hand need not fit both"
        )
    else:
        verdict = "the data do not distinguish the two tables"
    text = (
        f"Test: imposed on these readings, with the same vertical law{also}, the published shifts "
        f"leave {theirs[0]:.1f} % (E′) and {theirs[1]:.1f} % (E″) rms where the fitted ones leave "
        f"{ours[0]:.1f} % and {ours[1]:.1f} %: {verdict}."
    )
    if json.loads(curve.attrs["superposition"])["is_violated"]:
        text += (
            " Superposition itself does not hold to the scatter of the sweeps, so no table of shifts fits both moduli; "
            "the stated uncertainties include how far ours depend on weights and laws."
        )
    return text


def _shift_table(found: xr.Dataset, order: NDArray[np.intp]) -> Table:
    shown = found.isel(temperature=order[np.isfinite(found["published"].values[order])])
    difference, u = shown["difference"].values, shown["u_fitted"].values
    ratio = np.divide(difference, u, out=np.full(u.size, np.nan), where=u > 0)
    return listed(
        (
            Listed("temperature / °C", shown["temperature"].values.tolist(), digits=3),
            pages.column(shown, "fitted", "fitted"),
            pages.column(shown, "published", "published"),
            pages.column(shown, "difference", "difference", digits=3),
            Listed("difference / u", ratio.tolist(), digits=2),
            pages.column(shown, "imposed_storage_residual", "imposed: E′ / %", 100, digits=2),
            pages.column(shown, "imposed_loss_residual", "E″ / %", 100, digits=2),
        ),
        "log₁₀ a_T. The last columns are the residuals (rms) that the published shifts leave when they are imposed.",
    )


def _celsius(value: float) -> str:
    return f"{value:.0f} °C".replace("-", "\N{MINUS SIGN}")


def _signed(value: float) -> str:
    return f"{value:+.2f}".replace("-", "\N{MINUS SIGN}")

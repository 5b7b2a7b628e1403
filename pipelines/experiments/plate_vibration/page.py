"""The report of a plate vibration."""

from collections.abc import Sequence
from itertools import groupby
from typing import Any, cast

import numpy as np
import xarray as xr

from labpipe.report import Band, Block, LineChart, Listed, Role, Section, Series, listed
from pipelines.experiments.plate_vibration.budget import quantities
from pipelines.experiments.plate_vibration.comparison import rows as compared_rows
from pipelines.experiments.plate_vibration.measured import OF_PLATE, drops_label
from pipelines.experiments.plate_vibration.settings import PlateVibration
from pipelines.experiments.shared import pages
from pipelines.experiments.shared.reports import Report, budgets, summary

_UM = 1e6


def _details(
    settings: PlateVibration, table: xr.Dataset, plate: xr.Dataset | None = None
) -> list[tuple[str, str, str]]:
    remark = f"weighted mean of {pages.counted(int(table['n'].sum()), 'recording')}; standard uncertainty"
    rows = [(title, pages.told(table, f"plate_{name}"), remark) for name, (_, title) in OF_PLATE.items()]
    if plate is not None and np.isfinite(float(plate["mass"])):
        remark = "from amplitude and simulated momentum; the uncertainty of the spheres' moduli is not included"
        rows.append(("modal mass", pages.told(plate, "mass"), remark))
    return rows


def _motion(settings: PlateVibration, comparison: xr.Dataset) -> Section:
    time = comparison["time"].values * 1e3
    charts: list[Block] = []
    numbered = sorted(enumerate(settings.drops), key=lambda pair: pair[1].height.value)
    for height, group in groupby(numbered, key=lambda pair: pair[1].height.value):
        curves: list[Band | Series] = []
        for i, drops in group:
            for of, name in (("measured", drops.material), ("model", f"{drops.material}, model")):
                y = comparison[of].values[i] * _UM
                if np.isfinite(y).any():
                    curves.append(Series(name, time, y, role=cast("Role", of)))
        # of one height this chart stands under the verdict, and nothing is left of the section
        text = "Mean of the repeats, and the simulated drop on the fitted plate. Times are counted from the "
        text += "instantaneous impulse that would start the same vibration."
        shape: dict[str, Any] = {"views": (("first ringing", -2.0, 20.0),), "height_px": 260, "caption": text}
        title, label = f"Plate after a drop from {height * 1e3:g} mm", "displacement, upwards / µm"
        charts.append(LineChart(title, "time since impact / ms", label, tuple(curves), group="plate", **shape))
    return Section("Motion", tuple(charts))


def _table(settings: PlateVibration, table: xr.Dataset, plate: xr.Dataset) -> Section:
    columns = (
        Listed("material", [drops.material for drops in settings.drops]),
        Listed("height", [drops.height.value for drops in settings.drops], "m"),
        Listed("n", [len(drops.laser) for drops in settings.drops]),
        pages.column(table, "natural_frequency", "natural frequency"),
        pages.column(table, "damping_ratio", "damping ratio"),
        *([pages.column(plate, "modal_mass", "modal mass")] if "modal_mass" in plate else []),
    )
    return Section("By material and height", (listed(columns, "Means of the repeats, standard uncertainties."),))


def _recordings(settings: PlateVibration, ringing: Sequence[xr.Dataset | None]) -> Section:
    named = [(name, drops_label(drops)) for drops in settings.drops for name in drops.laser]
    kept = [both for both, each in zip(named, ringing, strict=True) if each is not None]
    found = pages.present(ringing)
    columns = (
        Listed("recording", [name for name, _ in kept]),
        Listed("drop", [label for _, label in kept]),
        *(
            pages.of_each(found, name, title, has_u=f"u_{name}" in found[0])
            for name, title in (
                ("free_from", "free from"),
                ("free_to", "free to"),
                ("natural_frequency", "frequency"),
                ("damping_ratio", "damping ratio"),
                ("amplitude", "amplitude"),
                ("chi_square", "reduced χ²"),
            )
        ),
    )
    text = (
        "The free vibration is evaluated over the longest interval between two contacts that one damped oscillation "
        "predicts. The amplitude is the envelope at impact. Random uncertainties only; the reduced χ² is the scatter "
        "over the noise, squared."
    )
    return Section("Recordings", (listed(columns, text),))


def _methods(settings: PlateVibration, table: xr.Dataset, plate: xr.Dataset | None = None) -> Section:
    kinds = sorted({drops.material for drops in settings.drops})
    text = (
        f"The laser was directed at the plate beside the disc while spheres ({', '.join(kinds)}) were dropped in "
        f"{pages.counted(int(table['n'].sum()), 'recording')}. The free vibration between the first and the second "
        "contact was fitted by one damped oscillation, over the interval in which the fit predicts the next readings."
    )
    if plate is not None and np.isfinite(float(plate["mass"])):
        text += (
            " The modal mass follows from the amplitudes and the momentum of the simulated impacts at its natural "
            "frequency."
        )
    return pages.methods(text, settings)


page = Report(
    "Vibration of the plate",
    ("readings", "displacement", "ringing", "table", "plate", "comparison"),
    (summary(compared_rows, _details), pages.recordings, _motion, _table, _recordings, budgets(quantities), _methods),
    compared_rows,
)

"""The report of a plate vibration."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import xarray as xr

from labpipe.report import Block, Listed, Role, Section, Series, listed
from pipelines.experiments.plate_vibration.budget import quantities
from pipelines.experiments.plate_vibration.comparison import rows
from pipelines.experiments.plate_vibration.measured import OF_PLATE, drops_label
from pipelines.experiments.plate_vibration.settings import PlateVibration
from pipelines.experiments.shared import pages
from pipelines.experiments.shared.reports import Report


def _details(table: xr.Dataset, plate: xr.Dataset | None = None) -> list[tuple[str, str, str]]:
    remark = f"weighted mean of {pages.counted(int(table['n'].sum()), 'recording')}; standard uncertainty"
    rows = pages.known(table, {f"plate_{name}": (title, remark) for name, (_, title) in OF_PLATE.items()})
    remark = "from amplitude and simulated momentum; the uncertainty of the spheres' moduli is not included"
    return rows + pages.known(plate, {"mass": ("modal mass", remark)})


def _motion(settings: PlateVibration, comparison: xr.Dataset) -> Section:
    time, charts = comparison["time"].values, list[Block]()
    by_height: dict[float, list[int]] = {}
    for i, drops in enumerate(settings.drops):
        by_height.setdefault(drops.height.value, []).append(i)
    roles: tuple[tuple[Role, str], ...] = (("measured", ""), ("model", ", model"))
    for height, places in sorted(by_height.items()):
        # materials have a scale of colours, and their names at the ends of the curves
        curves = [
            Series(f"{settings.drops[i].material}{word}", time, values, role=role, level=pages.level(n, len(places)))
            for role, word in roles
            for n, i in enumerate(places)
            if np.isfinite(values := comparison[role].values[i]).any()
        ]
        # of one height this chart stands under the verdict, and nothing is left of the section
        text = "Mean of the repeats, and the simulated drop on the fitted plate. Times are counted from the "
        text += "instantaneous impulse that would start the same vibration."
        title = f"Plate after a drop from {height * 1e3:g} mm"
        labels = (title, "time since impact / ms", "displacement, upwards / µm")
        shape: dict[str, Any] = {"views": [("first ringing", -2e-3, 20e-3)], "height_px": 260, "caption": text}
        charts.append(pages.chart(*labels, curves, group="plate", **shape))
    return Section("Motion", charts)


def _tables(
    settings: PlateVibration,
    ringing: Sequence[xr.Dataset | None],
    table: xr.Dataset | None = None,
    plate: xr.Dataset | None = None,
) -> Iterator[Section]:
    if table is not None and plate is not None:
        columns = [
            Listed("material", [drops.material for drops in settings.drops]),
            Listed("height", [drops.height.value for drops in settings.drops], "m"),
            Listed("n", [len(drops.laser) for drops in settings.drops]),
            *pages.columns(table, {name: title for name, (_, title) in OF_PLATE.items()}),
            *pages.columns(plate, {"modal_mass": "modal mass"}),
        ]
        text = "Means of the repeats, standard uncertainties."
        yield Section("By material and height", (listed(columns, text),))
    named = [(name, drops_label(drops)) for drops in settings.drops for name in drops.laser]
    kept = [both for both, each in zip(named, ringing, strict=True) if each is not None]
    found = pages.present(ringing)
    columns = [
        Listed("recording", [name for name, _ in kept]),
        Listed("drop", [label for _, label in kept]),
        *pages.columns(found, {"free_from": "free from", "free_to": "free to", "natural_frequency": "frequency"}),
        *pages.columns(found, {n: n.replace("_", " ") for n in ("damping_ratio", "amplitude")}),
        *pages.columns(found, {"chi_square": "reduced χ²"}),
    ]
    text = (
        "The free vibration is evaluated over the longest interval between two contacts that one damped oscillation "
        "predicts. The amplitude is the envelope at impact. Random uncertainties only; the reduced χ² is the scatter "
        "over the noise, squared."
    )
    yield Section("Recordings", (listed(columns, text),))


def _methods(settings: PlateVibration, table: xr.Dataset, plate: xr.Dataset | None = None) -> str:
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
    return text


page = Report(
    subtitle="Vibration of the plate",
    shown=("readings", "displacement", "ringing", "table", "plate", "comparison"),
    details=_details,
    rows=rows,
    sections=(pages.recordings, _motion, _tables),
    budget=quantities,
    methods=_methods,
)

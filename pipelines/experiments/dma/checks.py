"""Whether sweeps of a rheometer can be believed: redundant columns, causality, order with temperature."""

from collections.abc import Sequence

import xarray as xr

from labpipe.workflow.context import Context
from pipelines.experiments.dma import _column_checks, _specimen_checks
from pipelines.experiments.dma._checked_sweeps import Export, isothermal_sweeps, trusted_rows
from pipelines.experiments.dma._curve_checks import order_of_shifts, published_shifts, superposition
from pipelines.experiments.dma._stated_checks import mode_of_loading, poisson_ratio, scale_of_moduli
from pipelines.experiments.dma._temperature_checks import softening, strayed_readings, temperatures_of
from pipelines.experiments.dma.settings import Dma
from pipelines.experiments.shared import judgements
from pipelines.experiments.shared.judgements import Scene, Title

_FAILED = {
    "sweeps": "the exports hold no sweeps at several temperatures, or a column has the wrong unit",
    "master_curve": "the exports hold too few readings, or T_ref, their temperatures or their moduli are wrong",
}


TITLES = {
    "whole file": Title(
        "An export holds all declared points, each once.", ("whole file", "readings of another interval")
    ),
    "columns": Title(
        "Loss factor, stress over strain and frequency are consistent with the moduli.",
        ("loss factor", "stress over strain", "frequency", "signs of the moduli"),
    ),
    "single values": Title(
        "Moduli change steadily with frequency.",
        ("single values",),
    ),
    "size of the moduli": Title(
        "Moduli lie in the range of polymers for the stated mode of loading.",
        ("modulus of a polymer", "mode of loading", "scale of the moduli"),
    ),
    "causality": Title(
        "Storage and loss of a linear solid determine each other (Kramers and Kronig).",
        ("storage and loss belong together",),
    ),
    "temperature": Title(
        "Temperature is constant within a sweep, and moduli fall as it rises.",
        (
            "temperature within an interval", "temperatures", "temperature is measured", "order with temperature",
        ),
    ),
    "one specimen": Title(
        "All sweeps are of one specimen: repeated temperatures agree.",
        ("repeated temperatures", "files of one specimen", "same values twice"),
    ),
    "superposition": Title(
        "One master curve describes all temperatures, with shifts in order.",
        ("superposition", "order of the shifts", "published shifts"),
    ),
    "Poisson's ratio": Title("Polymers have Poisson's ratios of 0.2 to 0.5.", ("Poisson's ratio",)),
}  # fmt: skip


@judgements.judging("readings", "sweeps", "master_curve", "published", titles=TITLES)
def judgement(
    settings: Dma,
    context: Context,
    readings: Sequence[xr.Dataset | None] = (),
    master_curve: xr.Dataset | None = None,
    published: xr.Dataset | None = None,
) -> Scene:
    """Judge the exports of one specimen; what gave no result is judged by that."""
    exports = [
        Export(name, data, trusted_rows(data))
        for name, data in zip(settings.rheometer, readings, strict=False)
        if data is not None and {"storage_modulus", "loss_modulus", "temperature", "frequency"} <= set(data)
    ]
    exports = [e for e in exports if e.good.any()]
    found = [list(isothermal_sweeps(e, settings)) for e in exports]
    checks = judgements.failed_steps(context, _FAILED)
    checks += [poisson_ratio(settings), scale_of_moduli(settings)]
    for export, own in zip(exports, found, strict=True):
        checks += [
            _column_checks.whole_file(export),
            _column_checks.loss_factor(export),
            _column_checks.frequencies(export),
            _column_checks.stress_over_strain(export),
            _column_checks.size_of_modulus(export, settings),
            _column_checks.signs_of_moduli(export),
            mode_of_loading(export, settings),
            _column_checks.single_values(export, own),
            strayed_readings(export, settings),
            _specimen_checks.causality(export, own),
            _specimen_checks.pasted_readings(export, own),
        ]
    isotherms = sorted((s for own in found for s in own), key=lambda s: s.temperature)
    checks += [
        *temperatures_of(exports, isotherms, settings),
        softening(isotherms),
        _specimen_checks.repeated_temperatures(isotherms),
        *_specimen_checks.files_of_one_specimen(exports, found),
        order_of_shifts(master_curve),
        superposition(master_curve),
        published_shifts(published, master_curve),
    ]
    return Scene(checks)

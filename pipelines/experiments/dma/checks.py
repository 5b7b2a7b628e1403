"""Whether sweeps of a rheometer can be believed: redundant columns, causality, order with temperature."""

from collections.abc import Sequence

import xarray as xr

from labpipe.workflow.context import Context
from pipelines.experiments.dma._checked_sweeps import Export, isothermal_sweeps, trusted_rows
from pipelines.experiments.dma._column_checks import (
    frequencies,
    loss_factor,
    signs_of_moduli,
    single_values,
    size_of_modulus,
    stress_over_strain,
    times_in_order,
    whole_file,
)
from pipelines.experiments.dma._curve_checks import order_of_shifts, published_shifts, superposition
from pipelines.experiments.dma._specimen_checks import (
    causality,
    files_of_one_specimen,
    loss_of_each_sweep,
    pasted_readings,
    repeated_temperatures,
    rise_with_frequency,
    slipped_specimen,
    temperatures_of_files,
)
from pipelines.experiments.dma._stated_checks import bulk_modulus, mode_of_loading, poisson_ratio, scale_of_moduli
from pipelines.experiments.dma._temperature_checks import (
    one_condition,
    softening,
    steady_temperature,
    strayed_readings,
    temperature_sweep,
    temperatures_of,
)
from pipelines.experiments.dma.settings import Dma
from pipelines.experiments.shared import judgements
from pipelines.experiments.shared.judgements import Scene

_FAILED = {
    "sweeps": "the exports hold no sweeps at several temperatures, or a column has the wrong unit",
    "master_curve": "the exports hold too few readings, or T_ref, their temperatures or their moduli are wrong",
}


@judgements.judging("readings", "sweeps", "master_curve", "published")
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
    checks += [poisson_ratio(settings), bulk_modulus(exports, settings), scale_of_moduli(settings)]
    for export, own in zip(exports, found, strict=True):
        checks += [
            whole_file(export),
            loss_factor(export),
            frequencies(export),
            stress_over_strain(export),
            size_of_modulus(export, settings),
            signs_of_moduli(export),
            mode_of_loading(export, settings),
            single_values(export, own),
            times_in_order(export),
            strayed_readings(export, settings),
            steady_temperature(export, settings),
            one_condition(export),
            slipped_specimen(export, own),
            causality(export, own),
            loss_of_each_sweep(export, own),
            rise_with_frequency(export, own),
            pasted_readings(export, own),
            temperature_sweep(export, own),
        ]
    isotherms = sorted((s for own in found for s in own), key=lambda s: s.temperature)
    checks += [
        *temperatures_of(exports, isotherms, settings),
        softening(isotherms),
        repeated_temperatures(isotherms),
        *files_of_one_specimen(exports, found),
        *temperatures_of_files(exports, found),
        order_of_shifts(master_curve),
        superposition(master_curve),
        published_shifts(published, master_curve),
    ]
    return Scene(checks)

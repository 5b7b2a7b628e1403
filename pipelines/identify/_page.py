"""The page of an identification: results first, then their evidence."""

from math import isfinite
from typing import Any, Literal

import numpy as np
import xarray as xr

from labpipe.identification import DETERMINED, Band as Prediction, moduli, predictive_bands
from labpipe.report import (
    SURE,
    Band,
    Block,
    Column,
    KeyValues,
    Level,
    LineChart,
    Notice,
    Paragraph,
    Section,
    Series,
    Table,
    quantity,
)
from labpipe.workflow.session import Session
from pipelines.experiments.shared.judgements import with_minus
from pipelines.experiments.shared.material_evidence import CONTACT_MODULUS
from pipelines.experiments.shared.pages import chart, session_document, spanned, synthetic_notice
from pipelines.identify._result import UNCHANGED, Identified, dataset

SHAPE = ("level", "change ")  # begin the names of the unknowns of a spectrum's shape
_DIGITS = 4  # of the ends of an interval
_NOTHING = 1e-4  # relative: a smaller discrepancy is in the table only
_NU_STEP = 0.01  # by which Poisson's ratio of a polymer is commonly uncertain, where nothing is stated
_LOUD = 2.5  # standard deviations by which a nuisance may leave its prior without a remark

_METHOD = (
    "Least squares in coordinates in which the prior is standard normal, from several "
    "starts; more expensive models (finite amplitude, a vibrating plate, finer steps) "
    "correct the fast ones until convergence. Intervals follow from Laplace's approximation. The long-time "
    "modulus is bounded by the modulus at the longest time of the data, and stated only where the data end in a "
    "plateau. Assumptions about the spectrum: its "
    "weight per decade of time is a random walk over the decades, in which a factor of ten per decade is two "
    "standard deviations; its slope has a correlation length of two decades (smooth) or of half a decade "
    "(uneven), each with a probability of one half before the data, and the curves are averages over "
    "both with their probabilities after the data. Fit and unknowns are those of the more probable one. "
    "Only E/(1 − ν²) is observed of a contact: Poisson's ratio is taken with the uncertainty that is stated of it."
)


def render(session: Session, found: Identified) -> str:
    """Return the page as HTML text."""
    made = dataset(found)
    storage, loss = _curves(found, made)
    first, *further = (f"{text[0].upper()}{text[1:]}." for text in statements(found, made))
    level: Level = "ok" if made["is_determined"].values.any() else "warning"
    answer: list[Block] = [Notice(level, first), *_against_stated(found, made), *synthetic_notice(session), storage]
    rows = [("experiments", ", ".join(e.name for e in found.known.fit.problem.evidence), "")]
    relaxed = Notice("ok" if found.relaxed.verdict == "identified" else "info", f"{relaxed_text(found)}.")
    sections = (
        Section("Answer", answer),
        Section("Loss factor and long times", (loss, relaxed)),
        Section("Limits of the result", (KeyValues(rows), *map(Paragraph, further))),
        Section("Fit and residuals", _fits(found)),
        Section("Unknowns", _unknowns(found, made)),
        Section("Method", (Paragraph(_METHOD, copyable=True),)),
    )
    return session_document(session, f"Identification: {found.material}", sections)


def relaxed_text(found: Identified) -> str:
    """State the limits of the long-time modulus and their reason."""
    said = found.relaxed
    end, high = quantity(said.end, "s"), quantity(said.high, "Pa", _DIGITS)
    if said.verdict == "not identifiable":
        return (
            f"E∞ is not identifiable from these experiments: the modulus at {end}, the longest time they "
            f"cover, is not known to within a factor of two"
        )
    # two digits, and never a power of ten
    fall, most = (f"{100 * s:.0f} %" if s >= 0.1 else f"{100 * s:.2g} %" for s in (said.fall, said.most_fall))
    fell = fall + (f" (at most {most})" if most != fall else "")
    if said.verdict == "identified":
        return (
            f"E∞ is {quantity(said.low, 'Pa', _DIGITS)} to {high} (95 %): at {end} there is a plateau, for over the "
            f"decade of time before it the modulus fell by {fell}; the lower end allows for as much in further decades"
        )
    return (
        f"E∞ is bounded from above only: it is below {high} (95 %), the modulus at {end}. There is no plateau: over "
        f"the last decade of time that these experiments cover the modulus fell by {fell}; of longer times they say "
        "nothing"
    )


def statements(found: Identified, made: xr.Dataset | None = None) -> list[str]:
    """Return the other findings, the undetermined quantities and the remarks, one sentence each.

    ``made`` is the result of :func:`dataset`, where it is known already.
    """
    known = found.known
    texts = [*_found(found, dataset(found) if made is None else made)]
    texts.append(
        "not found: modulus and loss at lower and higher frequencies; curves and bands there follow from the "
        "assumptions about polymers"
    )
    nuisances = [
        (p.name, sd, abs(float(away)))
        for p, sd, away in zip(known.fit.problem.parameters, known.sd.tolist(), known.fit.xi, strict=True)
        if p.is_nuisance
    ]
    better = [f"{name} by {100 * (1 - sd):.0f} %" for name, sd, _ in nuisances if DETERMINED <= sd < UNCHANGED]
    if better:
        texts.append(
            f"a little better known than stated: {', '.join(better)} of the uncertainty; the remaining uncertainty is "
            "part of every result"
        )
    if silent := [name for name, sd, _ in nuisances if sd >= UNCHANGED]:
        texts.append(
            f"nothing new about {', '.join(silent)}: the stated values were taken, and their uncertainty is part of "
            "every result"
        )
    texts += [
        f"{experiment}, {group}: the model misses by {100 * misfit.relative:.2g} % more than "
        "the stated uncertainties explain; the intervals allow for it"
        for (experiment, group), misfit in known.fit.misfits.items()
        if misfit.relative >= _NOTHING
    ]
    texts += [
        f"{name} lies {away:.1f} standard deviations from the stated value"
        for name, _, away in nuisances
        if away > _LOUD
    ]
    if not known.fit.is_converged:
        texts.append("the fit did not converge; use the intervals with care")
    return [*texts, *found.remarks]


def _found(found: Identified, made: xr.Dataset) -> list[str]:
    """State the range in which modulus and loss are known, their uncertainty, and its part from assumptions."""
    inside = made["is_determined"].values.astype(bool)
    if not inside.any():
        return ["modulus and loss are not determined at any frequency"]
    frequency = made["frequency"].values[inside]
    low, high = (quantity(float(f), "Hz") for f in (frequency.min(), frequency.max()))
    storage, loss = (made[name].values[inside] for name in ("storage", "loss_factor"))
    u, u_loss = (100.0 * made[f"u_ln_{n}"].values[inside] for n in ("storage", "loss_factor"))
    best = int(np.argmin(u**2 + u_loss**2))
    texts = [
        f"found: from {low} to {high} the storage modulus is known to {spanned(u, '.2g')} % and the loss factor to "
        f"{spanned(u_loss, '.2g')} % (standard uncertainties); best at {quantity(float(frequency[best]), 'Hz')}: "
        f"{quantity(float(storage[best]), 'Pa')} ± {u[best]:.2g} %, loss factor {loss[best]:.3g} ± {u_loss[best]:.2g} %"
    ]
    problem = found.known.fit.problem
    nu = float(problem.spectrum.nu)
    by_ratio = 2.0 * nu / (1.0 - nu**2)
    known = next((p for p in problem.nuisances if p.name == CONTACT_MODULUS), None)
    texts.append(
        f"contacts show moduli over 1 − ν²: Poisson's ratio was taken as exactly {nu:.3g}, and were it "
        f"{_NU_STEP:g} larger, every modulus would be {100 * by_ratio * _NU_STEP:.2g} % smaller, which no "
        "uncertainty here contains"
        if known is None
        else f"contacts show moduli over 1 − ν²: Poisson's ratio is stated as {nu:.3g} ± {known.sd / by_ratio:.2g}, "
        f"which makes {100 * known.sd:.2g} % of every modulus and is included in these uncertainties"
    )
    return texts


def _against_stated(found: Identified, made: xr.Dataset) -> tuple[Block, ...]:
    """Hold the storage modulus, where it is determined, against that of the material that the session names."""
    inside = made["is_determined"].values.astype(bool)
    if found.stated is None or found.prior is not None or not inside.any():
        return ()
    source, solid = found.stated
    frequency = made["frequency"].values[inside]
    expected = solid.complex_modulus(2.0 * np.pi * frequency).real
    apart = np.log(made["storage"].values[inside] / expected)
    deviations = np.abs(apart / made["u_ln_storage"].values[inside])
    low, high = (quantity(float(f), "Hz") for f in (frequency.min(), frequency.max()))
    text = (
        f"From {low} to {high} the storage modulus lies {spanned(100.0 * np.expm1(apart), '+.2g')} % from that of the "
        f"material that the session names ({source}): at most {deviations.max():.2g} standard uncertainties of the "
        "identification; those of the other are not counted."
    )
    return (Notice("ok" if deviations.max() < SURE else "info", with_minus(text)),)


def _curves(found: Identified, made: xr.Dataset) -> list[LineChart]:
    """Draw storage modulus and loss factor over frequency, against those that are known otherwise."""
    frequency = made["frequency"].values
    low, high = float(made["lowest_frequency"]), float(made["highest_frequency"])
    marks = (("data begin", low), ("data end", high))
    charts: list[LineChart] = []
    stated = None if found.stated is None else found.stated[1].complex_modulus(2.0 * np.pi * frequency)
    text = "Outside the two marks there are no data: curves and bands follow from the assumptions about polymers."
    for name, title, label in (
        ("storage", "Storage modulus", "storage modulus / MPa"),
        ("loss_factor", "Loss factor", "loss factor"),
    ):
        value, u = made[name].values, made[f"u_ln_{name}"].values
        wide = np.minimum(SURE * u, np.log(1e3))
        series: list[Series | Band] = [
            Band("95 % of the posterior", frequency, value * np.exp(-wide), value * np.exp(wide)),
            Series("most probable", frequency, value, role="model"),
        ]
        if found.prior is not None:
            values = moduli(found.prior, frequency)[name].values
            series.append(Series("rheometer alone", frequency, values, role="reference"))
        elif found.stated is not None and stated is not None:
            values = stated.real if name == "storage" else stated.imag / stated.real
            series.append(Series(found.stated[0], frequency, values, role="reference"))
        scales: dict[str, Any] = {"x_scale": "log", "y_scale": "log", "group": "frequency"}
        charts.append(chart(title, "frequency / Hz", label, series, vlines=marks, caption=text, **scales))
    return charts


def _fits(found: Identified) -> tuple[Block, ...]:
    made = predictive_bands(found.known)
    squares = [float(np.mean(((b.group.values - b.predicted) / b.group.u) ** 2)) for b in made]
    rows = [
        (b.evidence, b.group.name, b.predicted.size, square, 100 * b.misfit.relative, b.misfit.correlation)
        for b, square in zip(made, squares, strict=True)
    ]
    names, caption = map(Column, ("experiment", "quantity", "n")), "chi square with the stated uncertainties alone; "
    caption += "a discrepancy is added where it exceeds its 99 % quantile"
    misfits = (Column("chi square / n", digits=3), Column("discrepancy", "%", digits=2))
    table = Table((*names, *misfits, Column("correlation of neighbours", digits=2)), rows, caption=caption)
    charts = [chart for b in made for chart in _fit_charts(b)]
    return table, *charts


def _fit_charts(shown: Prediction) -> tuple[Block, ...]:
    group = shown.group
    if group.values.size < 2:
        return ()
    order = np.argsort(group.axis, kind="stable")
    axis = group.axis[order]
    scale: Literal["linear", "log"] = "log" if axis[0] > 0 and axis[-1] / axis[0] > 100 else "linear"
    values, u = group.values[order], group.u[order]
    predicted, wide = shown.predicted[order], SURE * shown.u_predicted[order]
    label = f"{group.axis_name} / {group.axis_units}" if group.axis_units != "1" else "impact"
    title = f"{shown.evidence}: {group.name}"
    curves = (
        Band("95 % of the prediction", axis, predicted - wide, predicted + wide),
        Series("predicted", axis, predicted, role="model"),
        Series("observed", axis, values, "points", "measured", u),
    )
    left = (Series("residual", axis, shown.residual[order], "points", "residual"),)
    labels = (f"{title}, residuals", label, "observed − predicted, in deviations")
    fit = LineChart(title, label, f"{group.name} / {group.units}", curves, group=title, x_scale=scale)
    return fit, LineChart(*labels, left, group=title, x_scale=scale, height_px=180)


def _unknowns(found: Identified, made: xr.Dataset) -> tuple[Block, ...]:
    rows: list[tuple[str, ...]] = []
    for i, parameter in enumerate(found.known.fit.problem.parameters):
        if parameter.name.startswith(SHAPE):
            continue
        ends = [float(made[n][i]) for n in ("low", "high", "prior_low", "prior_high")]
        shown = [quantity(e, parameter.unit, _DIGITS) if isfinite(e) else "none" for e in ends]
        value, verdict = quantity(float(made["value"][i]), parameter.unit, _DIGITS), str(made["verdict"].values[i])
        after, before = " to ".join(shown[:2]), " to ".join(shown[2:])
        rows.append((parameter.name, parameter.text, value, after, before, verdict))
    titles = ("unknown", "meaning", "most probable", "95 % posterior", "95 % prior", "verdict")
    table = Table(tuple(map(Column, titles)), rows, sortable=False)
    return (table,)

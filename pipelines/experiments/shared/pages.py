"""The page of an experiment, and parts of pages that several kinds share: columns, recordings, calibration."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from labpipe.arrays import Floats
from labpipe.installation import __version__
from labpipe.report import (
    Band,
    Block,
    Column,
    Details,
    Document,
    KeyValues,
    LineChart,
    Link,
    Listed,
    Notice,
    Paragraph,
    ScatterChart,
    Section,
    Series,
    Table,
    budget_table,
    quantity,
    value_with_uncertainty,
)
from labpipe.units import Quantity, unit
from labpipe.workflow.context import Context, Warned, settings_in_words
from labpipe.workflow.exclusions import exclusions
from labpipe.workflow.session import Session
from pipelines.experiments.shared.comparison_rows import IMPACTS

SYNTHETIC = "synthetic data"

SESSION_PAGE = "index.html"
"""The page of the whole session, next to the folder of the reports."""
LIMITS = "guide/limits.html"
"""The page of the models' limits, below the folder of the reports; the page of the session is written with it."""


def stated(given: Quantity) -> str:
    """Write a quantity of the configuration with its uncertainty."""
    return value_with_uncertainty(given.value, given.u, given.si)


def told(dataset: xr.Dataset, name: str, at: int | None = None) -> str:
    """Write a value of a result, or the one at a place, with its standard uncertainty where it has one."""
    numbers = [dataset[n].values if at is None else dataset[n].values[at] for n in (name, f"u_{name}") if n in dataset]
    value, u = map(float, (*numbers, 0.0)[:2])
    return value_with_uncertainty(value, u, str(dataset[name].attrs["units"]))


def known(result: xr.Dataset | None, titles: Mapping[str, tuple[str, str]], at: int = 0) -> list[tuple[str, str, str]]:
    """Return title, value and remark of the finite values, or those at a place, of those variables that there are."""
    found = {} if result is None else {name: result[name].values.ravel() for name in titles if name in result}
    finite = [name for name, values in found.items() if values.size > at and np.isfinite(values[at])]
    return [(titles[n][0], told(result, n, at if result[n].ndim else None), titles[n][1]) for n in finite if result]


def _factor(label: str) -> float:
    """Return the factor to SI of the unit in which a label ends: that of ``"time / ms"`` is 0.001."""
    return unit(label.partition(" / ")[2].partition(",")[0]).factor


def columns(
    results: xr.Dataset | Sequence[xr.Dataset] | None, titles: Mapping[str, str], *, has_u: bool = True, digits: int = 4
) -> Iterator[Listed]:
    """List those variables of a result, or numbers of the results of several recordings, of which a value is known.

    Their standard uncertainties are listed with them where there are any and they are wanted. A title may end in the
    unit in which the numbers are shown, ``"creep / %"``; else one is chosen.
    """
    each = [] if results is None else results if isinstance(results, Sequence) else [results]
    for name, title in titles.items() if each else ():
        names, factor = [name, f"u_{name}"][: 1 + has_u], _factor(title)
        found = [np.hstack([one[n].values for one in each]) / factor for n in names if n in each[0]]
        if found and np.isfinite(found[0]).any():
            units = "" if " / " in title else str(each[0][name].attrs["units"])
            yield Listed(title, found[0].tolist(), units, found[1].tolist() if found[1:] else None, digits)


def chart(
    title: str, x: str, y: str, series: Sequence[Series], kind: type[LineChart] = LineChart, **more: Any
) -> LineChart:
    """Draw curves in SI in the units in which the labels of the axes end; ``views`` and ``vlines`` along x likewise."""
    of_x, of_y = map(_factor, (x, y))
    for name in {"views", "vlines"} & more.keys():
        more[name] = [(text, *(float(at) / of_x for at in places)) for text, *places in more[name]]
    shown = [
        Series(
            *(one.name, np.divide(one.x, of_x), np.divide(one.y, of_y), one.style, one.role),
            *(None if one.u is None else np.divide(one.u, of_y), one.on_hover, one.level),
        )
        for one in series
    ]
    return kind(title, x, y, shown, **more)


def model_curves(x: ArrayLike, y_and_u: Iterable[ArrayLike], label: str = "model", **more: Any) -> list[Series]:
    """Draw a model with the uncertainty that the verdict uses."""
    y, u = map(np.asarray, y_and_u)
    wide = 2.0 * u
    curve = Series(label, x, y, role="model", **more)
    return [curve, Band(f"{label} ± 2 u", x, y - wide, y + wide, role="model", **more)]


def level(place: int, count: int) -> float | None:
    """Return the level of a curve of a family, by its place; that of a single one has the colour of its role."""
    return place / (count - 1) if count > 1 else None


def impact_views(touches: Floats, durations: Floats, margin: float = 0.3) -> list[tuple[str, float, float]]:
    """Return windows [s] that show one of the first impacts each, by a part of its contact longer than that.

    Contacts without a known duration are taken to last a millisecond.
    """
    lasts = np.where(durations > 0.0, durations, 1e-3)
    windows = enumerate(zip(touches - margin * lasts, touches + (1.0 + margin) * lasts, strict=True), 1)
    return [(f"impact {i}", *ends) for i, ends in windows if i <= IMPACTS and np.isfinite(ends[0])]


def counted(n: float, noun: str, plural: str | None = None) -> str:
    """Write a number with its noun, "1 recording" or "3 recordings"."""
    return f"{n} {noun if n == 1 else plural or f'{noun}s'}"


def spanned(values: ArrayLike, form: str) -> str:
    """Write the smallest and the largest of some numbers, "0.5 to 2", or the one that they are as written."""
    least, most = (format(float(find(values)), form) for find in (np.min, np.max))
    return least if least == most else f"{least} to {most}"


def remarks(context: Context) -> list[tuple[str, str, str]]:
    """Return operator and notes of an experiment; empty where there are none."""
    return [("operator", context.operator, ""), ("notes", context.notes, "")]


def document(
    context: Context,
    subtitle: str,
    sections: Sequence[Section],
    answer: Sequence[Block] = (),
    basis: Sequence[Block] = (),
) -> Document:
    """Assemble a page that answers first; sections without content are left out.

    The answer comes before all else, then the one chart that shows it, the first of the kind's sections; the basis of
    the answer follows the key numbers, and the sections of every page follow those of the kind.
    """
    chart = next((b for one in sections for b in one.blocks if isinstance(b, LineChart | ScatterChart)), None)
    own = [replace(one, blocks=[b for b in one.blocks if b is not chart]) for one in sections]
    opening = [*answer, *_notices(context), *([] if chart is None else [chart])]
    parts = [
        Section("Verdict" if answer else "Overview", opening),
        *own[:1],
        Section("What the verdict rests on", basis),
        *own[1:],
    ]
    heads = tuple(map(Column, ("experiment", "step", "work", "done", "skipped")))
    work = [(r.experiment, r.stage or "all steps", r.name.replace("_", " "), r.done, r.skipped) for r in context.ledger]
    shown = [row for row in work if row[-1] is not None or row[2].endswith("read")]
    caption = "What was read, and the work that was skipped because no result depends on it."
    counters = "\n".join(f"{name}/{step}: {what} {done}" for name, step, what, done, _ in work)
    steps = (Table(heads, shown, caption=caption), Details("All counters of the solvers", text=counters))
    found = dict(context.provenance)
    rows = [(f["name"], f["size"], f["sha256"]) for f in found.get("inputs", ())]
    heads = (Column("file"), Column("bytes", digits=12), Column("SHA-256"))
    files = Table(heads, rows, caption="Raw files used for this page; none was changed.")
    text = json.dumps(found, indent=2, ensure_ascii=False, sort_keys=True, default=str)
    parts += [
        _problems(context),
        folded("Processing steps", counted(len(work), "count"), steps),
        Section("Provenance", (files, Details("Versions, parameters and stages (JSON)", text=text))),
    ]
    return Document(
        title=context.experiment,
        subtitle=f"{subtitle} · {context.title}" if context.title else subtitle,
        badge=SYNTHETIC if context.synthetic else "",
        home=f"../{SESSION_PAGE}",
        sections=tuple(part for part in parts if part.blocks),
    )


def _notices(context: Context) -> Iterator[Block]:
    """Say in which settings a variant differs from its base, and an experiment from the laboratory's file.

    Say also that nothing was measured, and which results were made by earlier code, where that is so.
    """
    of_base, of_laboratory = map(settings_in_words, (context.changed, context.overrides))
    if context.base:
        same = f"Variant of {context.base}, with the same recordings and other settings"
        yield Notice("info", f"{same}: {of_base}.")
    if of_laboratory:
        yield Notice("info", f"Other values than in the laboratory's file: {of_laboratory}.")
    yield from synthetic_notice(context)
    if context.kept:
        text = "Results of earlier code were kept as they are; what follows from them may differ from what this "
        yield Notice("warning", f"{text}version of labpipe gives. `labpipe process` makes them again.")
        yield Details("Results of earlier code", text="\n".join(": ".join(one) for one in context.kept.items()))


def _problems(context: Context) -> Section:
    """Name every error and warning of the steps, so that a missing section is explained; also that there are none."""
    own = [f for f in context.failures if not f.is_consequence]
    blocks = [Notice("error", f"{f.stage}{f' [{f.recording}]' if f.recording else ''}: {f.message}") for f in own]
    if missing := ", ".join(dict.fromkeys(f.stage for f in context.failures if f.is_consequence)):
        blocks.append(Notice("info" if own else "error", f"Not made without what failed before: {missing}."))
    alike: dict[str, list[Warned]] = {}
    for warned in context.warnings:
        alike.setdefault(warned.text, []).append(warned)
    for text, group in alike.items():
        stages, names = (
            ", ".join(dict.fromkeys(filter(None, each)))
            for each in zip(*((w.stage, w.recording) for w in group), strict=True)
        )
        total = sum(w.count for w in group)
        times = f" ({total} times)" if total > len(group) else ""
        blocks.append(Notice("warning", f"{stages}{f' [{names}]' if names else ''}: {text}{times}"))
    return Section("Warnings and errors", tuple(blocks or [Notice("ok", "No warnings and no errors.")]))


def folded(title: str, summary: str, blocks: Iterable[Block]) -> Section:
    """Make a section that is folded away until it is asked for; empty without blocks."""
    inside = tuple(blocks)
    return Section(title, (Details(summary, blocks=inside),) if inside else ())


def session_document(session: Session, title: str, sections: Iterable[Section]) -> str:
    """Write a page next to the session's own; sections without content are left out."""
    return Document(
        title=title,
        subtitle=session.title,
        badge=SYNTHETIC if session.synthetic else "",
        home=SESSION_PAGE,
        sections=tuple(section for section in sections if section.blocks),
    ).render()


def synthetic_notice(shown: Context | Session) -> tuple[Block, ...]:
    """Say that nothing on the page was measured, where that is so."""
    if not shown.synthetic:
        return ()
    text = (
        "Synthetic data: recorded by labpipe's virtual rig, not by an instrument. They "
        "demonstrate the analysis and are no evidence about a real material."
    )
    return (Notice("warning", text),)


def calibration_rows(text: str) -> KeyValues:
    """Show the calibration record and its checks."""
    checked = json.loads(text)
    shown = {
        "id": "record", "instrument": "instrument", "serial": "serial number", "view": "view", "how": "method",
        "who": "calibrated by", "when": "on", "valid_from": "valid from", "valid_until": "valid until",
        "sensor_check": "sensor", "validity_check": "validity",
    }  # fmt: skip
    rows = [(title, str(checked[key]), "") for key, title in shown.items() if checked.get(key)]
    return KeyValues(rows, caption="Calibration record")


def camera_calibration(found: xr.Dataset, plane: str, rows: Sequence[tuple[str, str, str]] = ()) -> Section:
    """Show the calibration record of a camera, values from it, and the budget of its scale, folded away."""
    table = budget_table(json.loads(found.attrs["budget"]), "Budget of the image scale", "m/px")
    rows = [("length of one pixel", told(found, "pixel_size"), f"in the plane of the {plane}"), *rows]
    blocks = (calibration_rows(found.attrs["calibration"]), KeyValues(rows), *table)
    return folded("Calibration and its uncertainty", "Record and what follows from it", blocks)


def present(results: Sequence[xr.Dataset | None] | None) -> list[xr.Dataset]:
    """Return the results of the recordings that gave one; a step that failed left None."""
    return [result for result in results or () if result is not None]


def raw_headers(datasets: Iterable[xr.Dataset]) -> tuple[Details, ...]:
    """Show the instruments' own headers of files, each folded away, and several folded into one."""
    texts = ((one.attrs.get("source", "the file"), str(one.attrs.get("header", "")).strip()) for one in datasets)
    headers = tuple(Details(f"Raw header of {source}", text=text) for source, text in texts if text)
    return headers if len(headers) < 2 else (Details(f"Raw headers of {len(headers)} files", headers),)


def recordings(settings: Any, context: Context, readings: Any = None, displacement: Any = None) -> Section:
    """Show recordings by laser, the falling body, and the sensor's calibration, folded away.

    Results are those of one recording, or one for each of several.
    """
    files = settings.laser if hasattr(settings, "laser") else [name for drops in settings.drops for name in drops.laser]
    files, blocks, body = [files] if isinstance(files, str) else files, list[Block](), settings.sphere
    read, moved = (present(found if isinstance(found, Sequence) else [found]) for found in (readings, displacement))
    rows = [("recordings", str(len(files)), files[0] if len(files) == 1 else "")]
    if read:
        first = read[0].attrs
        every = float(first["sampling_interval"])
        rate = value_with_uncertainty(1 / every, 0.0, "Hz") if every < 1.0 else f"every {every:g} s"
        layout = "layout of the file assumed, as none is public" * (first.get("layout") == "assumed")
        model = ", ".join(filter(None, (str(first.get("model", "")), layout)))
        rows.append(("instrument", str(first.get("instrument", "")), model))
        rows.append(("sampling", rate, f"{read[0].sizes['time']} points"))
    if body is not None:
        rows.append(("sphere radius", stated(body.radius), ""))
        if hasattr(body, "mass"):
            rows.append(("moving mass", stated(body.mass), "sphere and holder"))
    blocks.append(KeyValues([row for row in (*rows, *remarks(context)) if row[1]]))
    if moved:
        attrs, remark = moved[0].attrs, "true displacement = reading / cos(inclination)"
        if getattr(getattr(settings, "analysis", None), "inclination_from_height", False):
            remark = f"fitted from the drop height, not taken from the record; {remark}"
        scale, noise = f"{float(attrs['u_systematic_relative']) * 100:.3f} %", quantity(float(attrs["noise"]), "m")
        common = "inclination and gain; the same for every sample and recording"
        known = [
            ("inclination used", told(moved[0], "inclination"), remark),
            ("relative uncertainty of the scale", scale, common),
            ("noise of a sample", noise, "at rest"),
        ]
        caption = "Budget for the largest displacement of the first recording"
        budget = budget_table(json.loads(attrs["budget"]), caption, "m")
        blocks += [calibration_rows(attrs["calibration"]), KeyValues(known), *budget]
    title = "What was measured, and its calibration"
    return folded(title, "Files, readings and calibration record", (*blocks, *raw_headers(read)))


def limits_of(model: xr.Dataset) -> tuple[Block, ...]:
    """Link to the limits of the models from a drop whose strain and pressure are known."""
    return (Link("Limits of the model", LIMITS),) if "linear_range" in model.attrs else ()


def methods(text: str, settings: Any) -> Section:
    """Offer a paragraph for a manuscript, with the exclusions and the version of labpipe."""
    if left_out := list(map(str, exclusions(settings))):
        text += f" Excluded were {'; '.join(left_out)}."
    text = f"{text.strip()} Evaluated with labpipe {__version__}; uncertainties follow JCGM 100:2008 (GUM)."
    return folded("Methods text, to paste", "A paragraph for a manuscript", (Paragraph(text, copyable=True),))

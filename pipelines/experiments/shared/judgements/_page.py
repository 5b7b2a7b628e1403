"""The verdict in words: the opening of a page, and the contents of a stored judgement."""

import json
import re
from collections.abc import Iterable, Sequence
from math import isfinite, isnan
from typing import Any

import xarray as xr

from labpipe.judging import DIFFERS, LIKELY, Check, Finding, Judgement, from_json, in_words
from labpipe.report import Block, Column, Details, Notice, Paragraph, Table, difference_unit, quantity, shown_source
from labpipe.units import ZERO_CELSIUS
from labpipe.workflow.document import counted
from labpipe.workflow.session import FILE_NAME
from pipelines.experiments.shared.comparison_rows import Row, told_freedom

MATTERS = 0.2
"""Relative error of an input that a comparison must be able to show before it can agree."""
TIED = "\N{NO-BREAK SPACE}"  # a number stays with its unit
_NEGATIVE = re.compile(r"(?:(?<=^)|(?<=[ (\N{NO-BREAK SPACE}]))-(?=\d+(?:\.\d+)?(?:[ ,;:)\N{NO-BREAK SPACE}]|$))")
_LEAST_P = 1e-4  # smaller probabilities say no more


def probability(p: float) -> str:
    """Write a probability; one too small to distinguish from none is never written as 0.

    Examples
    --------
    >>> probability(0.82), probability(1e-120)
    ('0.82', '< 0.0001')
    """
    return f"{p:.2g}" if p >= _LEAST_P else f"< {_LEAST_P:g}"


def chance(p: float) -> str:
    """Write a probability as an equation: "p = 0.82", "p < 0.0001"."""
    return f"p = {probability(p)}" if p >= _LEAST_P else f"p {probability(p)}"


def capitalised(text: str) -> str:
    """Begin a sentence; files and settings keep their spelling.

    Examples
    --------
    >>> capitalised("the radius is wrong"), capitalised("sphere.radius is wrong")
    ('The radius is wrong', 'sphere.radius is wrong')
    """
    first = text.partition(" ")[0].rstrip(".,:;")
    return text if any(c in first for c in "/._") else text[:1].upper() + text[1:]


def with_minus(text: str) -> str:
    """Write the signs of negative numbers as minus signs; hyphens within words, files and quotes stay.

    Examples
    --------
    >>> with_minus('from -40.0 to -0.5 °C in drop-1.csv, 2024-05-14, where "-3" stands')
    'from −40.0 to −0.5 °C in drop-1.csv, 2024-05-14, where "-3" stands'
    """
    return _NEGATIVE.sub("\N{MINUS SIGN}", text)


VERDICT = "verdict"
"""Anchor of the verdict on a page."""
_BESIDE = {
    "agrees": "The {} agrees all the same.",
    "differs": "The {} differs, which may follow from it.",
    "undecided": "Whether the {} agrees is undecided.",
    "none": "No model was compared.",
}
"""Sentence about the model where the record cannot be believed as it is."""


def sentence(result: xr.Dataset, rows: Iterable[Row] = ()) -> tuple[str, str]:
    """Say in one sentence whether the record can be believed and the model agrees; its colour comes first."""
    judged, model = believed(result), str(result.attrs["model"])
    rows = tuple(rows)
    known = [r for r in rows if r.deviation is not None and r.measured is not None]
    # A film is compared with the laser, no model.
    by = "model" if not known or any(r.against == "model" for r in known) else known[0].against
    checks = f"{judged.n_passed} of {judged.n_made} checks passed"
    if judged.believable in ("impossible", "doubtful"):
        likeliest = (judged.findings[0].cause if judged.findings else "") or next(iter(judged.causes), "")
        cause = f" {capitalised(likeliest)}." if likeliest else ""
        # numbers that a scale does not alter may agree where a curve that it does alter differs
        model = "differs" if model == "agrees" and any(r.p is not None and r.p < DIFFERS for r in rows) else model
        seen = judged.findings[0].message.rstrip(".")
        level = "error" if judged.believable == "impossible" else "warning"
        return level, f"{capitalised(judged.believable)}: {seen}.{cause} {_BESIDE[model].format(by)} {checks}."
    checks = checks if judged.n_made else "no check could be made"
    for stopped in (c for c in judged.checks if c.level is not None and not c.is_made):
        text = f"Not known: {stopped.name} was not completed: {stopped.message}; {checks}."
        return "warning", f"{text} {capitalised(stopped.cause)}."
    shown = ""
    if known:
        row = max(known, key=lambda row: abs(row.deviation or 0.0))
        which = f"The largest of {len(known)} deviations" if len(known) > 1 else "The deviation"
        where = ", ".join(filter(None, (row.material, row.condition)))
        where = f" ({where})" * (bool(where) and sum(other.quantity == row.quantity for other in known) > 1)
        measured, expected, _ = row.texts
        size = f"{abs(row.deviation or 0.0):.1f}{TIED}standard uncertainties, u"
        shown = f" {which}: {row.quantity}{where}: {measured} measured, {expected} expected (difference {size})."
    believable = "The record is believable" if judged.n_made else "Whether the record is believable is not known"
    if model == "agrees":
        return "ok", f"{believable}, and the {by} agrees with it; {checks}.{shown}"
    p, told = float(result["p"]), suspected(result)
    if model == "differs":
        explained = "".join(f" {capitalised(text)}." for text in told)
        largest = f"largest deviation of a single value {float(result['largest_deviation']):.1f} u"
        of_curves = min((row.p_alone for row in rows if row.p_alone is not None), default=1.0)
        differs = f"but the {by} differs from it ({chance(min(p, of_curves))}, {largest})"
        return "warning", f"{believable}, {differs}; {checks}.{shown}{explained}"
    if model == "undecided":
        reason = f"no error of {100 * MATTERS:.0f}{TIED}% in any input would have shown"
        if p < LIKELY:
            reason = f"so large differences are unlikely by chance ({chance(p)}), but no proof of another model"
        reason, shown = (told[0], "") if told else (reason, shown)
        return "info", f"{believable}; whether the {by} agrees is undecided; {checks}.{shown} {capitalised(reason)}."
    return "ok" if judged.n_made else "info", f"{believable}: {checks}. There is no model to compare with."


def verdict_blocks(result: xr.Dataset | None, rows: Iterable[Row] = ()) -> tuple[Block, ...]:
    """Return the opening of a page: the sentence; then the findings, the errors that would have shown, and the checks.

    The checks are a row each; folded away are their results for each recording and each stated value.
    """
    if result is None:
        return (Notice("warning", "There is no verdict: the checks gave no result.", VERDICT),)
    judged = believed(result)
    level, text = sentence(result, rows)
    blocks: list[Block] = [Notice(level, with_minus(text), VERDICT)]  # type: ignore[arg-type]
    if exact := json.loads(result.attrs.get("exact", "[]")):
        blocks.append(Paragraph(f"Counted as exact, since stated without ±: {', '.join(exact)}."))

    def table(heads: Sequence[str], cells: Iterable[tuple[str, ...]], caption: str = "") -> Table:
        return Table(tuple(map(Column, heads)), [tuple(map(with_minus, row)) for row in cells], caption)

    if judged.findings:
        cells = ((f.level, f.check, f.message, f.cause, written_place(f)) for f in judged.findings)
        blocks.append(table(("level", "check", "observation", "probable cause", "file and line"), cells))
    if result.sizes["input"]:
        blocks.append(Paragraph(noticed(result)))
    titled = [(capitalised(row.title), row) for row in judged.rows]
    checks = [(title, row.summary, _seen(row.worst), row.law) for title, row in titled]
    evaluations = [
        (
            title,
            one.name,
            one.level or ("passed" if one.is_made else "not made"),
            f"{one.margin:+z.1f} u" if isfinite(one.margin) else "",
            _seen(one),
        )
        for title, row in titled
        for one in row.evaluations
    ]
    blocks.append(table(("check", "result", "largest deviation", "principle"), checks, "Checks of the record."))
    whole = table(("check", "quantity", "result", "margin", "observation"), evaluations)
    return (*blocks, Details(f"Results of the {len(judged.checks)} evaluations", [whole]))


def _seen(check: Check) -> str:
    return check.message or f"requires {check.needs}"


def written_place(finding: Finding) -> str:
    """Write where to look as a stored page does, which knows settings but not their lines."""
    if finding.line is not None or (finding.file and not finding.setting):
        return finding.place
    return f"{finding.file or FILE_NAME}, {counted(finding.setting)}"


def noticed(result: xr.Dataset) -> str:
    """Say in one line which error of each input the comparison would have detected.

    Examples
    --------
    ``"Smallest error of each input that this comparison would have detected (95 %): height 0.4 % · modulus 2.1 %."``
    """
    units, between = json.loads(result.attrs["units"]), f"{TIED}· "
    values = (result[name].values.tolist() for name in ("detectable", "detectable_error", "input"))
    shown, none = [], []
    for relative, error, name, unit in sorted(zip(*values, units, strict=True), key=lambda one: (isnan(one[0]), one)):
        # an input that is 0, such as a position, has no share, nor has a temperature in °C
        size = quantity(error, difference_unit(unit)) if isnan(relative) else f"{in_words(100 * relative, 2)} %"
        is_possible = error < ZERO_CELSIUS if unit == "degC" else not relative >= 1.0  # K to the absolute zero
        if isfinite(error) and is_possible:
            shown.append(f"{shown_source(name)}{TIED}{size.replace(' ', TIED)}")
        else:
            none.append(shown_source(name))
    said = f"Smallest error of each input that this comparison would have detected (95{TIED}%): "
    said += f"{between.join(shown) or f'none below 100{TIED}%'}."
    return said + f" No realistic error would be detected of: {between.join(none)}." * bool(none and shown)


def believed(result: xr.Dataset) -> Judgement:
    """Return the checks and the verdict of a stored judgement."""
    return from_json(result.attrs["judgement"])


def suspected(result: xr.Dataset) -> list[str]:
    """Return explanations of a model that differs or cannot be compared with the record, the likeliest first."""
    return list(json.loads(result.attrs.get("suspects", "[]")))


def compared(result: xr.Dataset) -> dict[str, Any]:
    """Return the result of the comparison of one experiment, for JSON."""
    units = json.loads(result.attrs["units"])

    def finite(value: Any) -> float | None:
        return float(value) if isfinite(value) else None

    named = zip(result["input"].values.tolist(), result["detectable_error"].values.tolist(), units, strict=True)
    return {
        "model": str(result.attrs["model"]),
        "chi2": finite(result["chi_square"]),
        "degrees_of_freedom": told_freedom(float(result["degrees_of_freedom"])),
        "p": finite(result["p"]),
        "suspects": suspected(result),
        "detectable": {name: {"value": finite(error), "unit": difference_unit(unit)} for name, error, unit in named},
    }

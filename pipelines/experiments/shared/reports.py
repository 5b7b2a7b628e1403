"""The page of an experiment: its verdict, the sections that its kind lists, and those that every page has."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import xarray as xr

from labpipe.report import (
    Block,
    Column,
    Details,
    Document,
    KeyValues,
    LineChart,
    Notice,
    ScatterChart,
    Section,
    Table,
    quantity,
    value_with_uncertainty,
)
from labpipe.workflow.context import Context, Warned, settings_in_words
from pipelines.experiments._kind import JUDGEMENT
from pipelines.experiments.shared import budget_blocks
from pipelines.experiments.shared.budget_quantity import Quantity
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.experiments.shared.exclusions import exclusion_notice, notebook
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import verdict_blocks
from pipelines.experiments.shared.pages import SESSION_PAGE, SYNTHETIC, counted, folded, synthetic_notice


@dataclass(frozen=True)
class Report:
    """The page of a kind: called by its stage, it shows the results of the steps.

    ``subtitle`` may take the settings; ``shown`` names the inputs of the stage after the judgement, in its order; each
    of ``sections`` asks by name (:mod:`pipelines.experiments.shared.given`) and returns a section, several, or None: a
    step that failed leaves its section out and its error in; ``rows`` are those of the comparison; ``counts`` says by
    name whether a result is one at all.
    """

    subtitle: str | Callable[[Any], str]
    shown: tuple[str, ...]
    sections: Sequence[Callable[..., Section | Iterable[Section] | None]]
    rows: Callable[..., Iterable[Row]] | None = None
    counts: Mapping[str, Callable[[Any], bool]] = field(default_factory=dict)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs of the stage, in its order."""
        return (JUDGEMENT, *self.shown)

    def __call__(self, judgement: xr.Dataset | None, *results: Any, settings: Any, context: Context) -> str:
        """Write the page, which answers first.

        The verdict comes before all else, then the one chart that shows it, the first of the kind's sections; the basis
        of the verdict follows the key numbers, and the sections of every page follow those of the kind.
        """
        known = dict(zip(self.shown, results, strict=True))
        known |= {n: None for n, counts in self.counts.items() if known[n] is not None and not counts(known[n])}
        given = Given(**known, settings=settings, context=context)
        whole: list[Section] = given.each(self.sections)
        chart = next((b for one in whole for b in one.blocks if isinstance(b, LineChart | ScatterChart)), None)
        own = [replace(one, blocks=[b for b in one.blocks if b is not chart]) for one in whole]
        answer, *basis = verdict_blocks(judgement, given.each([self.rows] if self.rows else []))
        opening = [answer, *exclusion_notice(settings), *_notices(context), *([] if chart is None else [chart])]
        sections = [Section("Verdict", opening), *own[:1], Section("What the verdict rests on", basis), *own[1:]]
        sections += [notebook(settings), _problems(context), _ledger(context), _provenance(context)]
        subtitle = self.subtitle if isinstance(self.subtitle, str) else self.subtitle(settings)
        return Document(
            title=context.experiment,
            subtitle=f"{subtitle} · {context.title}" if context.title else subtitle,
            badge=SYNTHETIC if context.synthetic else "",
            home=f"../{SESSION_PAGE}",
            sections=tuple(section for section in sections if section.blocks),
        ).render()


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
        alike = dict.fromkeys(f"{kept.stage}: {kept.reason}" for kept in context.kept)
        yield Details("Results of earlier code", text="\n".join(alike))


def _problems(context: Context) -> Section:
    """Name every error and warning of the steps, so that a missing section is explained; also that there are none."""
    own = [f for f in context.failures if not f.is_consequence]
    blocks = [Notice("error", f"{f.stage}{f' [{f.recording}]' if f.recording else ''}: {f.text}") for f in own]
    if missing := ", ".join(dict.fromkeys(f.stage for f in context.failures if f.is_consequence)):
        blocks.append(Notice("info" if own else "error", f"Not made without what failed before: {missing}."))
    alike: dict[tuple[str, str], list[Warned]] = {}
    for warned in context.warnings:
        alike.setdefault((warned.stage, warned.text), []).append(warned)
    for (stage, text), group in alike.items():
        names, total = ", ".join(w.recording for w in group if w.recording), sum(w.count for w in group)
        times = f" ({total} times)" if total > len(group) else ""
        blocks.append(Notice("warning", f"{stage}{f' [{names}]' if names else ''}: {text}{times}"))
    return Section("Warnings and errors", tuple(blocks or [Notice("ok", "No warnings and no errors.")]))


def _ledger(context: Context) -> Section:
    """Show the work done and skipped for this page, and for other experiments behind it."""
    columns = tuple(map(Column, ("experiment", "step", "work", "done", "skipped")))
    rows = [(r.experiment, r.stage or "all steps", r.name.replace("_", " "), r.done, r.skipped) for r in context.ledger]
    table = Table(columns, rows, caption="Counts of work; the same for the same inputs on every machine.")
    return folded("Processing steps", counted(len(rows), "count"), (table,))


def _provenance(context: Context) -> Section:
    """Show inputs with their digests, versions, and the settings."""
    columns = (Column("file"), Column("bytes", digits=12), Column("SHA-256"))
    found = dict(context.provenance)
    rows = [(f["name"], f["size"], f["sha256"]) for f in found.get("inputs", ())]
    files = Table(columns, rows, caption="Raw files used for this page; none was changed.")
    text = json.dumps(found, indent=2, ensure_ascii=False, sort_keys=True, default=str)
    return Section("Provenance", (files, Details("Versions, parameters and stages (JSON)", text=text)))


def summary(
    rows: Callable[..., Iterable[Row]], details: Callable[..., Sequence[tuple[str, str, str]]] | None = None
) -> Callable[..., Section]:
    """Return the summary of a kind: its compared values, after ``details``, further values with a remark each."""

    def section(given: Given, context: Context) -> Section:
        blocks: list[Block] = []
        if details is not None and (told := given.ask(details)):
            blocks.append(KeyValues(told))
        if compared := given.each([rows]):
            table = _compared(compared)
            is_long = len(compared) > 12
            blocks.append(Details(f"All {len(compared)} compared values", [table]) if is_long else table)
        elif not context.failures:
            blocks.append(Notice("info", "There is nothing to compare with."))
        return Section("Summary", blocks)

    return section


def _compared(rows: Sequence[Row]) -> Table:
    def shown(value: float | None, u: float | None, unit: str) -> str | None:
        if value is None:
            return None
        return value_with_uncertainty(value, u, unit) if u else quantity(value, unit)

    cells = [
        (
            ", ".join(filter(None, (row.quantity, row.material, row.condition))),
            shown(row.measured, row.u_measured, row.unit),
            shown(row.model, row.u_model, row.unit),
            shown(row.difference, row.u_difference, row.unit),
            row.deviation,
            None if row.nrmse is None else 100 * row.nrmse,
            row.p,
        )
        for row in rows
    ]
    columns = (
        *map(Column, ("quantity", "measured", "expected", "difference")),
        *(Column("deviation", "u", digits=2), Column("nRMSE", "%", digits=3), Column("p", digits=2)),
    )
    caption = "Of a curve the difference is the mean one, and nRMSE is relative to the range of the model."
    return Table(columns, cells, caption=caption)


def budgets(quantities: Callable[..., Iterable[Quantity]]) -> Callable[..., Sequence[Section]]:
    """Return the section of the budgets that a kind has."""

    def section(given: Given, context: Context) -> Sequence[Section]:
        return budget_blocks.section(context.experiment, given.ask(quantities) or ())

    return section


def is_there(result: xr.Dataset) -> bool:
    """Return whether a step gave a result, or only the reason why it did not."""
    return "absent" not in result.attrs

"""The page of an experiment: its verdict, and the sections that its kind lists."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import xarray as xr

from labpipe.report import Block, Column, Details, KeyValues, Notice, Section, Table
from labpipe.workflow.context import Context
from pipelines.experiments.shared.budget_blocks import budgets
from pipelines.experiments.shared.budget_quantity import Quantity
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.experiments.shared.exclusions import exclusion_notice, notebook
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import verdict_blocks
from pipelines.experiments.shared.pages import document, methods


@dataclass(frozen=True, kw_only=True)
class Report:
    """The page of a kind: called by its stage, it shows the results of the steps.

    ``subtitle`` may take the settings; ``shown`` names the inputs of the stage after the judgement, in its order. All
    other functions ask for results by name (:mod:`pipelines.experiments.shared.given`): ``details`` gives key values
    with a remark each, ``rows`` the comparison, each of ``sections`` a section, several, or None, ``budget`` the main
    quantities with their inputs, ``methods`` a paragraph for a manuscript. A step that failed leaves its section out
    and its error in. ``counts`` says by name whether a result is one at all.
    """

    subtitle: str | Callable[[Any], str]
    shown: tuple[str, ...]
    sections: Sequence[Callable[..., Section | Iterable[Section] | None]]
    budget: Callable[..., Iterable[Quantity]]
    methods: Callable[..., str]
    rows: Callable[..., Iterable[Row]] | None = None
    details: Callable[..., Sequence[tuple[str, str, str]]] | None = None
    counts: Mapping[str, Callable[[Any], bool]] = field(default_factory=dict)

    def __call__(self, judgement: xr.Dataset | None, *results: Any, settings: Any, context: Context) -> str:
        """Write the page."""
        known = dict(zip(self.shown, results, strict=True))
        known |= {n: None for n, counts in self.counts.items() if known[n] is not None and not counts(known[n])}
        given = Given(**known, settings=settings, context=context)
        rows = given.each([self.rows] if self.rows else [])
        answer, *basis = verdict_blocks(judgement, rows)
        details: list[Block] = [KeyValues(told)] if self.details and (told := given.ask(self.details)) else []
        if self.rows and not rows and not context.failures:
            details.append(Notice("info", "There is nothing to compare with."))
        if rows:  # measurement and expectation of each quantity; of many folded away
            heads = (
                *map(Column, ("quantity", "measured", "expected", "difference")),
                *(Column("deviation", "u", digits=2), Column("nRMSE", "%", digits=3), Column("p", digits=2)),
            )
            cells = [
                (
                    ", ".join(filter(None, (row.quantity, row.material, row.condition))),
                    *(text and text.replace(" ", "\N{NO-BREAK SPACE}") for text in row.texts),
                    row.deviation,
                    None if row.nrmse is None else 100 * row.nrmse,
                    row.p,
                )
                for row in rows
            ]
            caption = "Of a curve the difference is the mean one, and nRMSE is relative to the range of the model."
            if any("restitution" in row.quantity and row.measured and row.model is None for row in rows):
                caption += " None is expected of an impact whose time is uncertain by over 0.25 rad of the plate's "
                caption += "vibration."
            table = Table(heads, cells, caption=caption)
            details.append(Details(f"All {len(cells)} compared values", [table]) if len(cells) > 12 else table)
        text = given.ask(self.methods)
        sections = [
            Section("Summary", details),
            *given.each(self.sections),
            budgets(given.ask(self.budget) or (), context.experiment),
            *([methods(text, settings)] if text else []),
            notebook(settings),
        ]
        subtitle = self.subtitle if isinstance(self.subtitle, str) else self.subtitle(settings)
        return document(context, subtitle, sections, (answer, *exclusion_notice(settings)), basis).render()


def is_there(result: xr.Dataset) -> bool:
    """Return whether a step gave a result, or only the reason why it did not."""
    return "absent" not in result.attrs

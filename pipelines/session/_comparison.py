"""What a comparison of measurement and model found, and how it shows itself."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labpipe.notebook import html_table, text_table
from pipelines.experiments.shared.comparison_rows import Row


@dataclass(frozen=True, slots=True)
class Comparison:
    """All rows of a session, and the experiments that failed or compare nothing, with reasons.

    ``page`` is the HTML file. ``experiments`` says of each that is judged as a whole how its chi
    square came out, and the smallest error of each input that it would have shown.
    """

    rows: tuple[Row, ...]
    failed: dict[str, str]
    absent: dict[str, str]
    page: Path
    experiments: tuple[dict[str, Any], ...] = ()

    def __repr__(self) -> str:
        return text_table(f"{len(self.rows)} comparisons, {self.page}", self._cells)

    def _repr_html_(self) -> str:
        titles = ("experiment", "condition", "quantity", "measured", "model", "agreement")
        return html_table(f"{len(self.rows)} comparisons, {self.page.name}", titles, self._cells)

    @property
    def _cells(self) -> list[tuple[str, ...]]:
        rows: list[tuple[str, ...]] = [
            (r.experiment, r.condition, r.quantity, *_pair(r), _agreement(r)) for r in self.rows
        ]
        others = (self.failed | self.absent).items()
        return rows + [(name, "", why, "", "", "") for name, why in others]


def _pair(row: Row) -> tuple[str, str]:
    if row.measured is None or row.model is None:
        return "", ""
    return f"{row.measured:.5g} {row.unit}", f"{row.model:.5g} {row.unit}"


def _agreement(row: Row) -> str:
    if row.nrmse is not None:
        return f"nRMSE {100 * row.nrmse:.2f} %"
    u = "" if row.u_difference is None else f" ± {row.u_difference:.1e}"
    return "" if row.difference is None else f"{row.difference:+.2e}{u} {row.unit}"

"""The verb sensitivity: budgets of the main quantities, and what to measure better."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labpipe import files
from labpipe.notebook import Shown, ShownAsTable
from pipelines.session._examined import Examined, examine
from pipelines.session._opening import reopen_session
from pipelines.session._sensitivity_page import advice, render


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivity(ShownAsTable):
    """The examined quantities of a session, and a page for each kind of experiment."""

    quantities: tuple[Examined, ...]
    pages: tuple[Path, ...]

    def __iter__(self) -> Iterator[Examined]:
        return iter(self.quantities)

    def _shown(self) -> Shown:
        caption = f"{len(self.quantities)} quantities; pages: {', '.join(map(str, self.pages))}"
        rows = [
            (row["experiment"], row["quantity"], f"{row['value']:.5g} ± {row['u']:.2g} {row['unit']}", row["to_halve"])
            for row in self.documents()
        ]
        return Shown(caption, ("experiment", "quantity", "value", "to halve the uncertainty"), rows)

    def documents(self) -> list[dict[str, Any]]:
        """Return plain values of every quantity, for JSON."""
        return [
            {
                "experiment": e.experiment, "quantity": e.quantity.name, "unit": e.quantity.unit,
                "value": e.budget.value, "u": e.budget.u, "expanded": e.budget.expanded(),
                "coverage_factor": e.coverage_factor, "monte_carlo_agrees": e.is_linear,
                "total_indices": {name: i.total for name, i in e.indices.items()},
                "to_halve": advice(e),
            }
            for e in self.quantities
        ]  # fmt: skip


def sensitivity(folder: str | Path, which: str | None = None) -> Sensitivity:
    """Show which inputs limit the uncertainty of the main quantities of a session.

    Parameters
    ----------
    folder : path-like
        The session folder; what is not processed yet is processed first.
    which : str, optional
        Only experiments of this kind, or of this name.

    Returns
    -------
    Sensitivity
        Linear budget, Monte Carlo and Sobol indices of every quantity, and the pages
        ``FOLDER/labpipe/sensitivity_KIND.html``.

    Raises
    ------
    UsageError
        There is no such kind or experiment with budgets.
    InputError
        A step before failed.

    Examples
    --------
    >>> sensitivity("my-session", "acrylic_7mm")  # doctest: +SKIP
    """
    found = examine(folder, which)
    session = reopen_session(folder)
    pages = []
    for kind in dict.fromkeys(session.experiments[e.experiment].kind for e in found):
        own = [e for e in found if session.experiments[e.experiment].kind == kind]
        pages.append(session.folder / f"sensitivity_{kind}.html")
        files.write_text(pages[-1], render(session, kind, own))
    return Sensitivity(tuple(found), tuple(pages))

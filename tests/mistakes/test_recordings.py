"""Mistakes of a laboratory with recorded experiments are noticed and named; clean sessions are believed."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from pipelines.session import Verdict
from tests.mistakes import dma_rows, drop_rows, mach1_rows, plate_rows, static_rows
from tests.mistakes.rows import Mistake, by_day, hold, judged


class Corpus(NamedTuple):
    """A clean session, its edits, and the stages that show them; by day one of ``every`` rows is tried."""

    write: Callable[[Path], Path]
    rows: tuple[Mistake, ...]
    targets: tuple[str, ...]
    otherwise: str = ""
    experiment: str = ""
    every: int = 6

    def judged(self, folder: Path) -> Verdict:
        return judged(folder, *self.targets, experiment=self.experiment)


CORPORA = {
    "drop": Corpus(drop_rows.write, drop_rows.ROWS, ("bounces",)),
    "oscillation": Corpus(mach1_rows.write_waves, mach1_rows.WAVE_ROWS, ("oscillations",), "comparison"),
    "relaxation": Corpus(mach1_rows.write_holds, mach1_rows.HOLD_ROWS, ("ramps",), "comparison", every=10),
    "rheometer": Corpus(dma_rows.write, dma_rows.ROWS, ("readings",), every=3),
    "temperatures": Corpus(dma_rows.write_temperatures, dma_rows.TEMPERATURE_ROWS, ("master_curve",), every=1),
    "plate": Corpus(plate_rows.write, plate_rows.ROWS, ("table",), "comparison", "plate", 12),
    "static": Corpus(static_rows.write, static_rows.ROWS, ("approach",), "comparison"),
}
ROWS = [
    pytest.param(name, *row.values, id=f"{name}: {row.id}", marks=row.marks)
    for name, corpus in CORPORA.items()
    for row in by_day(corpus.rows, corpus.every)
]


@pytest.fixture(scope="session")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return the clean session of a corpus, processed once."""
    known: dict[str, Path] = {}

    def of(name: str) -> Path:
        if name not in known:
            known[name] = CORPORA[name].write(tmp_path_factory.mktemp(name))
            CORPORA[name].judged(known[name])
        return known[name]

    return of


@pytest.mark.parametrize("name", CORPORA)
def test_clean_session_is_believed(clean: Callable[[str], Path], name: str) -> None:
    found = CORPORA[name].judged(clean(name))
    assert (found.believable, found.findings) == ("yes", ())
    assert 5 < found.checks <= 13


@pytest.mark.slow
@pytest.mark.parametrize("name", ["drop", "plate", "static", "relaxation"])
def test_clean_session_agrees_with_its_model(clean: Callable[[str], Path], name: str) -> None:
    assert judged(clean(name), "judgement", experiment=CORPORA[name].experiment).model == "agrees"


@pytest.mark.parametrize(("name", "mistake"), ROWS)
def test_mistake_is_noticed_and_named(
    clean: Callable[[str], Path], tmp_path: Path, name: str, mistake: Mistake
) -> None:
    corpus = CORPORA[name]
    hold(
        clean(name),
        tmp_path / "session",
        mistake,
        *corpus.targets,
        otherwise=corpus.otherwise,
        experiment=corpus.experiment,
    )

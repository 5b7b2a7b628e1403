"""The README's pictures and table show what labpipe makes now; figures and errors are compared where they are made."""

from pathlib import Path

import pytest

from tests.pipelines.readme import ADVICE, NAMES, digests, of_report, recorded, rows


def test_the_pictures_are_those_that_were_recorded() -> None:
    assert digests() == recorded()["pictures"], ADVICE
    assert {row[0] for row in rows()} == set(NAMES.values()), ADVICE


@pytest.mark.slow
def test_a_report_begins_with_the_words_of_the_picture(processed_session: Path) -> None:
    assert of_report(processed_session / "labpipe/reports/drop.html").split() == recorded()["report"].split(), ADVICE

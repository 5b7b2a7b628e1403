"""What a verdict must hold after a mistake."""

from pipelines.session import Verdict
from tests.mistakes.drop_rows import Mistake


def assert_said(mistake: Mistake, found: Verdict) -> None:
    """Hold level, words and place of a verdict against what a mistake must lead to."""
    said = " ".join(f"{f.message} {f.cause}" for f in found.findings).lower()
    assert found.believable == ("yes" if mistake.level == "note" else mistake.level), said
    assert any(f.level == mistake.level for f in found.findings), said
    assert [word for word in mistake.words if word.lower() not in said] == [], said
    if mistake.file:
        places = {(f.file, f.line if mistake.line else None) for f in found.findings}
        assert (mistake.file, mistake.line) in places, found.findings

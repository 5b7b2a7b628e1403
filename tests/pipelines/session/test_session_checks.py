"""What experiments state of one plate, or of one kind, is held against the others; two plates are no mistake."""

from pathlib import Path

import pytest

from labpipe import files
from pipelines.rig.samples import drop_section, laser_record, session_head
from pipelines.session import open_session
from pipelines.session._session_checks import session_findings, stated_as_exact


def findings(folder: Path, *frequencies: str, height: str = "1.5 ± 0.005 mm") -> list[tuple[str, str, str]]:
    """Return experiment, check and setting of what is found where plates of these frequencies are stated."""
    text = session_head("Plates (synthetic)")
    for number, frequency in enumerate(frequencies):
        plate = f'plate = {{ mass = "1450 ± 100 kg", frequency = "{frequency}", damping_ratio = "0.03" }}\n'
        files.write_text(folder / f"laser/{number}.csv", f"reading of drop {number}")
        text += drop_section(f"drop_{number}", [f"laser/{number}.csv"], 1.5e-3, "acrylic", plate)
    files.write_text(folder / "calibration/laser.toml", laser_record())
    # the last experiment states another height
    head, mark, last = text.rpartition('"1.5 ± 0.005 mm"')
    assert mark
    files.write_text(folder / "session.toml", f'{head}"{height}"{last}')
    found = session_findings(open_session(folder))
    return [(name, f.check, f.setting) for name, some in found.items() for f in some]


@pytest.mark.parametrize(
    "frequencies",
    [
        ("390 ± 20 Hz", "390 ± 20 Hz", "390 ± 20 Hz"),
        ("390 ± 20 Hz", "390 ± 20 Hz", "182 ± 5 Hz"),  # another plate
        ("390 ± 20 Hz", "39 ± 2 Hz"),  # nobody knows which
        ("390 ± 20 Hz", "120 ± 20 Hz", "39 ± 2 Hz"),  # none is usual
    ],
)
def test_plates_that_may_be_are_not_told(tmp_path: Path, frequencies: tuple[str, ...]) -> None:
    assert findings(tmp_path, *frequencies) == []


@pytest.mark.parametrize("slipped", ["39 ± 2 Hz", "930 ± 20 Hz"])
def test_a_slip_in_one_of_several_is_told(tmp_path: Path, slipped: str) -> None:
    told = findings(tmp_path, "390 ± 20 Hz", "390 ± 20 Hz", slipped)
    assert told == [("drop_2", "one plate, two values", "plate.frequency")]


def test_values_without_uncertainty_are_listed_with_the_experiments_that_state_them(tmp_path: Path) -> None:
    assert findings(tmp_path, "390 ± 20 Hz", "390 ± 20 Hz", height="1.5 mm") == []
    exact = stated_as_exact(open_session(tmp_path))
    assert exact == {"damping ratio": ["drop_0"], "height, damping ratio": ["drop_1"]}

"""Values that are stated without an uncertainty are listed; those of a clean session give no finding."""

from pathlib import Path

from labpipe import files
from pipelines.rig.session_text import drop_section, laser_record
from pipelines.session import open_session
from pipelines.session._session_checks import session_findings, stated_as_exact, unusual_values
from tests.pipelines.sessions import begun


def findings(folder: Path, height: str) -> list[tuple[str, str, str]]:
    """Return experiment, check and setting of what is found in two drops, of which the second states a height."""
    text = ""
    for number in range(2):
        plate = 'plate = { mass = "1450 ± 100 kg", frequency = "390 ± 20 Hz", damping_ratio = "0.03" }\n'
        files.write_text(folder / f"laser/{number}.csv", f"reading of drop {number}")
        text += drop_section(f"drop_{number}", [f"laser/{number}.csv"], 1.5e-3, "acrylic", plate)
    head, _, last = text.rpartition('"1.5 ± 0.005 mm"')
    found = session_findings(open_session(begun(folder, f'{head}"{height}"{last}', laser=laser_record())))
    return [(name, f.check, f.setting) for name, some in found.items() for f in some]


def test_values_without_uncertainty_are_listed_with_the_experiments_that_state_them(tmp_path: Path) -> None:
    assert findings(tmp_path, "1.5 mm") == []
    exact = stated_as_exact(open_session(tmp_path))
    assert exact == {"damping ratio": ["drop_0"], "height, damping ratio": ["drop_1"]}


def test_a_default_is_no_value_that_an_experiment_states_otherwise(tmp_path: Path) -> None:
    findings(tmp_path, "1.5 mm")
    toml = tmp_path / "session.toml"
    other = '\n[experiments.drop_0.model]\ngravity = "9.8300 ± 0.0001 m/s2"\n'
    toml.write_text(toml.read_text("utf-8").replace("505.0", "305.0", 1) + other, "utf-8")
    first, second = (unusual_values(open_session(tmp_path), name) for name in ("drop_0", "drop_1"))
    assert [text.partition(" (")[0] for text in first] == ["sphere.mass is 305.0 g here"]
    assert [text.partition(" (")[0] for text in second] == ["sphere.mass is 505.0 g here"]

"""A data package: complete, readable without labpipe, verified from its raw files, and without names when asked."""

import hashlib
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import labpipe as lp
from labpipe import files
from labpipe.errors import ConfigError, StoreError
from tests.pipelines.command import run

CREATOR = '\n[[creators]]\nname = "Josiah Carberry"\norcid = "0000-0002-1825-0097"\naffiliation = "Brown University"\n'
ROOT = Path(lp.__file__).parents[1]


def state(folder: Path, creators: str = CREATOR) -> Path:
    """Let a session state its licence and creators."""
    path = folder / "session.toml"
    text = path.read_text("utf-8").replace("[session]\n", '[session]\nlicence = "CC-BY-4.0"\n')
    path.write_text(text + creators, "utf-8")
    return folder


@pytest.fixture(scope="module")
def package(pristine_session: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small session, published; the package is not changed by a test."""
    pytest.importorskip("rocrate", reason="the extra publish is not installed")
    folder = tmp_path_factory.mktemp("package")
    session = state(Path(shutil.copytree(pristine_session, folder / "session")))
    assert not lp.publish(session, folder / "package", jobs=0).left_out
    return folder / "package"


@pytest.fixture
def copied(package: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(package, tmp_path / "copied"))


def test_what_is_not_stated_is_asked_for_with_the_line_to_copy(session_copy: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as asked:
        lp.publish(session_copy, tmp_path / "package")
    (first, second) = asked.value.problems
    assert re.match(r"session.toml:1: no creators are stated; .*\n\[\[creators\]\]\nname = ", first)
    assert re.match(r'session.toml:\d: session: no licence .* the line: licence = "CC-BY-4.0"$', second)
    assert not (tmp_path / "package").exists()
    state(session_copy, '\n[[creators]]\nname = "A"\n')
    with pytest.raises(ConfigError, match=r"creators no. 1: A has no ORCID; add the line: orcid = "):
        lp.publish(session_copy, tmp_path / "package")
    with (session_copy / "session.toml").open("a", encoding="utf-8") as stream:
        stream.write('orcid = "0000-0002-1825-0096"\n')
    with pytest.raises(ConfigError, match=r'creators no. 1: "0000-0002-1825-0096" is no ORCID'):
        lp.plan(session_copy)


def test_the_crate_reads_back_with_every_file_its_creators_and_its_licence(package: Path) -> None:
    from rocrate.rocrate import ROCrate

    crate = ROCrate(package)
    assert crate.license.id == "https://spdx.org/licenses/CC-BY-4.0"
    assert crate.root_dataset["creator"].id == "https://orcid.org/0000-0002-1825-0097"
    sums = dict(reversed(line.split("  ", 1)) for line in (package / "SHA256SUMS").read_text("utf-8").splitlines())
    held = {path.relative_to(package).as_posix() for path in files.files_below(package)}
    assert set(sums) == held - {"SHA256SUMS"}
    described = {entity.id: entity["sha256"] for entity in crate.data_entities}
    assert set(described) == set(sums) - {"ro-crate-metadata.json"}
    assert all(sums[name] == digest for name, digest in described.items())
    assert {"methods.md", "references.bib", "data/session.toml", "data/laser/drop_1.csv", "pages/index.html",
            "pages/reports/drop.html", "pages/reports/guide/limits.html", "results/quantities.csv"} <= held  # fmt: skip
    raw = (package / "data/laser/drop_1.csv").read_bytes()
    assert hashlib.sha256(raw).hexdigest() == sums["data/laser/drop_1.csv"]
    assert f"numpy=={np.__version__}\n" in (package / "requirements.txt").read_text("utf-8")
    assert "A sphere of radius" in (package / "methods.md").read_text("utf-8")
    assert 'href="guide/limits.html"' in (package / "pages/reports/drop.html").read_text("utf-8")


def test_a_changed_file_and_a_changed_number_are_found(
    copied: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path, sums = copied / "results/drop.repeats.nc", copied / "SHA256SUMS"
    before, data = files.digest(path), files.read_dataset(path)
    data["restitution"].values[0] *= 1.0 + 1e-3
    files.write_dataset(path, data)
    (copied / "methods.md").unlink()
    with pytest.raises(StoreError, match=r"methods.md is missing; results/drop.repeats.nc was changed"):
        lp.verify(copied)
    kept = [line for line in sums.read_text("utf-8").splitlines() if not line.endswith("  methods.md")]
    sums.write_text("\n".join(kept).replace(before, files.digest(path)) + "\n", "utf-8")
    code, out, _ = run(capsys, "verify", str(copied), "--jobs", "0", "--json")
    assert code == 1
    rows = {row["name"]: row for row in json.loads(out)["results"]}
    assert rows["drop.repeats.nc"]["differs"] == ["restitution"]
    assert rows["drop.repeats.nc"]["deviation"] == pytest.approx(1e-3, rel=0.2)
    # all others come out again from the raw files
    assert len(rows) == len(list((copied / "results").glob("*.nc"))) > 10
    assert {(row["deviation"], *row["differs"]) for row in rows.values() if row["name"] != "drop.repeats.nc"} == {
        (0.0,)
    }


@pytest.mark.slow
def test_an_anonymous_package_holds_no_name(session_copy: Path, tmp_path: Path) -> None:
    pytest.importorskip("rocrate", reason="the extra publish is not installed")
    state(session_copy)
    path = session_copy / "session.toml"
    path.write_text(path.read_text("utf-8").replace("Brown University", "Mach-1 Motion") + "# by Josiah Carberry\n")
    done = lp.publish(session_copy, tmp_path / "package", anonymous=True, jobs=0)
    assert set(done.struck) == {"data/calibration/laser.toml", "data/mach1/nbr.txt"}
    names = [b"Carberry", b"0000-0002-1825-0097", b"Mach-1 Motion", b"the virtual rig", str(session_copy).encode()]
    for file in files.files_below(tmp_path / "package"):
        assert [name for name in names if name in file.read_bytes()] == [], file.name
    assert b"Mach-1 Motion" in (session_copy / "mach1/nbr.txt").read_bytes()
    path.write_text(path.read_text("utf-8").replace("Mach-1 Motion", "drop_1"))
    with pytest.raises(ConfigError, match=r'data/laser/drop_1.csv has "drop_1" in its name; rename it in a copy'):
        lp.publish(session_copy, tmp_path / "other", anonymous=True, jobs=0)
    assert not (tmp_path / "other").exists()


def test_results_follow_the_cf_conventions_and_open_without_labpipe(package: Path) -> None:
    for path in sorted((package / "results").glob("*.nc")):
        with xr.open_dataset(path) as found:
            assert found.attrs["Conventions"] == "CF-1.11"
            assert {"title", "source"} <= set(found.attrs)
            for name, variable in found.variables.items():
                assert re.fullmatch(r"[A-Za-z]\w*", str(name)), (path.name, name)
                assert variable.attrs["long_name"], (path.name, name)
                assert "px" not in variable.attrs.get("units", ""), (path.name, name)
                assert variable.dtype.kind in "UOT" or "units" in variable.attrs or "flag_values" in variable.attrs
                assert variable.dtype.kind not in "mM"
    table = pd.read_csv(package / "results/quantities.csv", comment="#")
    assert {"experiment", "quantity", "value"} <= set(table.columns)


def test_citations_are_of_this_version_and_of_the_kinds_of_the_session(pristine_session: Path) -> None:
    def keys(text: str) -> set[str]:
        assert text.count("{") == text.count("}")
        return set(re.findall(r"^@\w+\{([\w-]+),$", text, re.M))

    assert keys(lp.cite()) == {"labpipe", "GUM", "GUM-S1"}
    of_session = keys(lp.cite(pristine_session))
    assert {"labpipe", "GUM", "thesis", "Ting1966", "Westergaard1939"} <= of_session
    assert "WLF1955" not in of_session
    assert f"version = {{{lp.__version__}}}" in lp.cite()
    assert f"version: {lp.__version__}\n" in (ROOT / ".github/CITATION.cff").read_text("utf-8")
    assert f"## {lp.__version__} " in (ROOT / "labpipe/documentation/changelog.md").read_text("utf-8")

"""From a pile of files to a first session.toml."""

import json
import os
import shutil
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest

from labpipe.errors import ConfigError, UsageError
from pipelines.experiments import KINDS
from pipelines.rig.dma import Protocol, write_dma
from pipelines.rig.solids import SOLIDS
from pipelines.session import init, open_session, survey


@pytest.fixture
def pile(small_session: Path, tmp_path: Path) -> Path:
    for source, name in (
        ("laser/drop_1.csv", "acrylic 7mm rep1.csv"),
        ("laser/drop_2.csv", "acrylic 7mm rep2.csv"),
        ("mach1/nbr.txt", "punch on nbr.txt"),
        ("calibration/laser.toml", "laser.toml"),
    ):
        shutil.copy(small_session / source, tmp_path / name)
    (tmp_path / "notes.txt").write_text("nothing of an instrument")
    return tmp_path


def test_instruments_are_recognised_and_repeats_grouped(pile: Path) -> None:
    found = init(pile)
    text = found.path.read_text("utf-8")
    assert found.experiments == ["acrylic_7mm", "punch_on_nbr"]
    assert '"acrylic 7mm rep1.csv",\n  "acrylic 7mm rep2.csv"' in text
    assert 'height = "7 mm"' in text
    assert 'material = "acrylic"' in text
    assert 'calibration = "laser.toml"' in text


def test_every_gap_is_listed_and_its_experiment_waits_until_it_is_filled(pile: Path) -> None:
    found = init(pile)
    assert len(found.gaps) == 2  # radius and mass
    session = open_session(pile)
    assert list(session.experiments) == ["punch_on_nbr"]
    assert [line.split(":")[2] for line in session.waiting["acrylic_7mm"]] == [
        " experiments.acrylic_7mm.sphere.radius",
        " experiments.acrylic_7mm.sphere.mass",
    ]
    text = found.path.read_text("utf-8")
    filled = text.replace('"FILL mm"', '"9.525 mm"').replace('"FILL g"', '"505 g"')
    found.path.write_text(filled, "utf-8")
    assert set(open_session(pile).experiments) == {"acrylic_7mm", "punch_on_nbr"}


def test_repeats_are_grouped_by_names_without_marks_and_their_fall_is_a_remark(tmp_path: Path) -> None:
    sample = Path(__file__).parents[3] / "sample_data"
    for source, name in (
        ("core/laser/acrylic_10mm_1.csv", "messung #1.csv"),
        ("core/laser/acrylic_10mm_2.csv", "Kopie (2) von messung_2 neu.csv"),
        ("thesis-small/laser/nylon_1p5mm_1.csv", "probe_3.csv"),
        ("thesis-small/laser/ptfe_static.csv", "ptfe weights.csv"),
    ):
        shutil.copy(sample / source, tmp_path / name)
    (tmp_path / "cut.csv").write_bytes((tmp_path / "probe_3.csv").read_bytes()[:20_000])
    text = init(tmp_path).path.read_text("utf-8")
    tables = tomllib.loads(text)["experiments"]
    drops = {tuple(table["laser"]) for table in tables.values() if table["kind"] == "ball_drop"}
    assert drops == {("Kopie (2) von messung_2 neu.csv", "messung #1.csv"), ("probe_3.csv",), ("cut.csv",)}
    assert "the record shows about 1.5 mm along the line of sight" in text


def test_a_template_waits_for_its_values_and_makes_no_mistake(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no such folder"):
        init(tmp_path / "tomorrow")
    found = init(tmp_path / "tomorrow", template=sorted(KINDS))  # the folder is made
    with pytest.raises(UsageError, match="--force"):
        init(tmp_path / "tomorrow")
    assert found.experiments == sorted(KINDS)
    with pytest.raises(ConfigError) as caught:  # every experiment waits
        open_session(tmp_path / "tomorrow")
    assert caught.value.problems
    assert all("to be filled in" in problem for problem in caught.value.problems)
    assert len(found.gaps) == len(caught.value.problems)


def test_a_relaxation_is_proposed_and_what_no_experiment_takes_is_named(pile: Path) -> None:
    text = (pile / "punch on nbr.txt").read_text("latin-1").replace("Sinusoid", "Stress Relaxation")
    (pile / "hold.txt").write_text(text, "latin-1")
    rows = "1\t50\t62589\t1.25E+05\r\n\t2\t31.5\t50000\t9.9E+04"
    sweep = (
        "Project:\tP\r\n\r\nTest:\tT\r\n\r\nResult:\tR\r\n\r\nInterval and data points:\t1\t2\r\n"
        "Interval data:\tPoint No.\tShear Rate\tShear Stress\tViscosity\r\n"
        f"\t\t\t\t\r\n\t\t[1/s]\t[Pa]\t[Pa·s]\r\n\t{rows}\r\n"
    )
    (pile / "sweep.csv").write_bytes(sweep.encode("utf-16"))
    found = init(pile)
    assert "hold" in found.experiments
    assert 'kind = "relaxation"\nmach1 = ["hold.txt"]' in found.path.read_text("utf-8")
    assert found.unused == [
        "sweep.csv (rheometer export): it holds no moduli over frequency; add it by hand",
        "notes.txt: no instrument recognises the content",
    ]


def test_copies_are_named_and_the_recordings_keep_their_names(pile: Path) -> None:
    (pile / "Laser (Kopie)").mkdir()
    shutil.copy(pile / "acrylic 7mm rep1.csv", pile / "Laser (Kopie)/acrylic 7mm 1.csv")
    (pile / "photos").mkdir()
    for name in ("a.jpg", "b.JPG"):
        (pile / "photos" / name).write_bytes(b"\xff\xd8\xff\xe0 a picture")
    found = init(pile)
    assert found.experiments == ["acrylic_7mm", "punch_on_nbr"]
    assert '"acrylic 7mm rep1.csv",\n  "acrylic 7mm rep2.csv"' in found.path.read_text("utf-8")
    (copy,) = (line for line in found.unused if line.startswith("Laser"))
    assert copy.endswith(': a copy of "acrylic 7mm rep1.csv"')
    (pictures,) = (line for line in found.unused if line.startswith("photos/"))
    assert "photos/a.jpg and 1 more beside it: a picture" in pictures


@pytest.mark.skipif(os.name == "nt", reason="Windows makes no such names")
@pytest.mark.parametrize("name", [b"two\nlines.csv", b"\xff\xfe.csv", b"CON.csv", "\u202ecsv.a".encode()])
def test_a_name_that_no_session_may_hold_is_told_and_left_alone(pile: Path, name: bytes) -> None:
    shutil.move(pile / "acrylic 7mm rep1.csv", os.fsencode(pile) + b"/" + name)
    found = init(pile)
    (told,) = (line for line in found.unused if line.endswith("; rename it"))
    told.encode("utf-8")
    assert told.isprintable()
    assert "acrylic_7mm" in open_session(pile).waiting
    json.dumps([entry._asdict() for entry in survey(pile)], ensure_ascii=False).encode("utf-8")


def test_a_material_comes_from_its_dma_export_where_one_lies_in_the_folder(pile: Path) -> None:
    write_dma(pile, "acrylic_dma", SOLIDS["acrylic"], Protocol(temperatures=(20.0, 40.0), ramp=(0.0, 10.0)), 3)
    text = init(pile).path.read_text("utf-8")
    assert 'material_from = "acrylic_dma"' in text
    assert "[experiments.acrylic_dma]" in text
    assert '# material = "nbr"' in text  # of the punch: there is no export of rubber
    # two exports of one material: the choice is the user's
    write_dma(pile, "pmma_again", SOLIDS["acrylic"], Protocol(temperatures=(20.0, 40.0), ramp=(0.0, 10.0)), 4)
    assert "material_from" not in init(pile, replace=True).path.read_text("utf-8")


def test_one_odd_file_never_stops_a_scan_and_keeps_its_advice(pile: Path) -> None:
    (pile / "~$gel.xlsx").write_bytes(b"\x05user" + bytes(160))
    (pile / "Thumbs.db").write_bytes(b"\xd0\xcf\x11\xe0" + bytes(99))
    np.savez(pile / "a.npz", x=np.zeros(3))
    (pile / "short.cine").write_bytes(b"CI\x2c\x00")
    (pile / "x.cih").write_text("#Camera Information Header\n")
    for number in range(4):
        cv2.imwrite(str(pile / f"img_{number}.png"), np.zeros((8, 8), np.uint8))
    found = init(pile)
    assert {"acrylic_7mm", "punch_on_nbr"} <= set(found.experiments)
    unused = "\n".join(found.unused)
    assert "~$" not in unused
    assert "Thumbs" not in unused
    assert "a.npz: no instrument recognises the content. It is a NumPy archive (.npz) of the arrays x" in unused
    assert "img_0.png and 3 more beside it: images of a film directly in the session folder: move them" in unused
    names = {row.name for row in survey(pile)}
    assert "img_0.png" in names
    assert "~$gel.xlsx" not in names

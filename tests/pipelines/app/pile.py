"""A stick of 51 files as somebody brings it: recordings of two years, copies, photographs, notes."""

import os
import shutil
from datetime import UTC, datetime
from pathlib import Path

import cv2

from pipelines.rig.calibration_images import holder_image
from pipelines.rig.dma import Protocol, write_dma
from pipelines.rig.drops import write_drops
from pipelines.rig.fall import DropRig
from pipelines.rig.indentations import Harmonic, Specimen, write_harmonic
from pipelines.rig.mach1_tester import Tester
from pipelines.rig.solids import SOLIDS, specimen_of

FILES = 51
HEIGHTS = {"1p5mm": 1.5e-3, "5mm": 5e-3, "7mm": 7e-3, "10mm": 10e-3}
_REPEATS = 3
_FIRST, _SECOND = datetime(2022, 5, 14, 9, 30, tzinfo=UTC), datetime(2024, 5, 14, 9, 30, tzinfo=UTC)


def write_pile(folder: Path) -> Path:
    """Write the files of three instruments, their copies, and what lay beside them."""
    made = folder.parent / f"{folder.name}-made"
    rig = DropRig(duration=0.15)
    drops = [*(("acrylic", key, height, _FIRST) for key, height in HEIGHTS.items()), ("ptfe", "1p5mm", 1.5e-3, _SECOND)]
    for seed, (material, key, height, when) in enumerate(drops):
        write_drops(
            made, f"{material}_{key}", rig, specimen_of(material), height, _REPEATS, seed, when.replace(tzinfo=None)
        )
    specimen = Specimen(specimen_of("nbr"))
    protocol = Harmonic(hold=5.0, frequencies=(1.0, 2.0), cycles=7)
    write_harmonic(made, "nbr_harmonic", specimen, protocol, Tester(), 5, _SECOND.replace(tzinfo=None))
    for seed, material in enumerate(("acrylic", "ptfe", "nbr")):
        write_dma(made, f"{material}_dma", SOLIDS[material], Protocol(), 20 + seed)
    folder.mkdir(parents=True)
    for path in sorted(made.rglob("*.csv")) + sorted(made.rglob("*.txt")):
        place = {"laser": "Laser", "mach1": "Mach1", "dma": "Rheometer"}[path.parent.name]
        target = folder / place / path.name
        target.parent.mkdir(exist_ok=True)
        shutil.copyfile(path, target)
        when = (_FIRST if path.name.startswith("acrylic") else _SECOND).timestamp()
        os.utime(target, (when, when))
    shutil.copytree(folder / "Laser", folder / "Laser (Kopie)")
    shutil.copytree(folder / "Rheometer", folder / "Rheometer/alt")
    shutil.rmtree(made)
    _beside(folder)
    return folder


def _beside(folder: Path) -> None:
    """Write photographs and notes until the stick is full."""
    (folder / "Notizen.txt").write_text("Acryl am 14. Mai, Halter 505 g\nPTFE zwei Jahre danach\n", "utf-8")
    (folder / "Thumbs.db").write_bytes(b"\xd0\xcf\x11\xe0" + bytes(200))
    (folder / "Protokoll.docx").write_bytes(b"PK\x03\x04" + bytes(200))
    place = folder / "Fotos"
    place.mkdir()
    n_files = sum(1 for p in folder.rglob("*") if p.is_file())
    for number in range(FILES - n_files):
        picture = holder_image(240, 640, -0.006, number)
        cv2.imwrite(str(place / f"IMG_{4711 + number}.jpg"), picture)

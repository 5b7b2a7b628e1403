"""Whether a harmonic indentation is believed: a clean one, tapping, and a cell of another name."""

import re
from datetime import datetime
from pathlib import Path
from typing import Any

import xarray as xr

from labpipe import materials
from labpipe.judging import Judgement
from labpipe.workflow.context import Context
from labpipe.workflow.results import Results
from pipelines.experiments.harmonic import checks, measured
from pipelines.experiments.shared import judgements, mach1_readings
from pipelines.rig.indentations import TESTER, Harmonic, Specimen, write_harmonic
from pipelines.session import opened

START = datetime(2024, 5, 14, 9, 30)


def judged(*parts: xr.Dataset | None, settings: Any) -> Judgement:
    context = Context("nbr", "harmonic", "", "", "", True)
    return judgements.believed(checks.judgement(*parts, settings=settings, context=context))


def test_a_clean_test_is_believed_and_its_stiffness_confirms_the_model(processed_session: Path) -> None:
    results: Results = opened(processed_session)
    made = results.result("nbr", "judgement")
    found = judgements.believed(made)
    assert (found.believable, found.findings) == ("yes", ())
    # without a record of the cell the delay of its filter leaves the work uncertain by a tenth, not the stiffness
    assert made.attrs["model"] == "agrees"
    assert 6 < found.n_made <= 12
    assert float(made["detectable"].sel(input="modulus of the rubber")) < 0.1
    page = (processed_session / "labpipe/reports/nbr.html").read_text("utf-8")
    assert "The record is believable, and the model agrees with it; " in page
    assert re.search(r"The largest of \d+ deviations: [\w ]+ \([\d.]+ Hz\): \S+", page)
    assert "Smallest error of each input that this comparison would have detected" in page


def test_an_amplitude_near_the_mean_depth_is_no_mistake(processed_session: Path, tmp_path: Path) -> None:
    settings = opened(processed_session).experiments["nbr"].settings
    protocol = Harmonic(hold=5.0, frequencies=(1.0,), cycles=7, mean=30e-6, amplitude=40e-6)
    write_harmonic(tmp_path, "nbr", Specimen(materials.load("nbr")), protocol, TESTER, 32, START)
    readings = mach1_readings.readings(tmp_path / settings.mach1)
    loads = mach1_readings.loads(readings, None, settings=settings)
    waves = measured.oscillations(loads, settings=settings)
    found = judged(readings, loads, waves, None, None, settings=settings)
    assert found.believable == "yes", found.findings

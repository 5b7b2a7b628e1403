"""The end of linear viscoelasticity in an impact: yield under the contact, and the strains of the rheometer."""

import json
from math import isfinite
from pathlib import Path
from typing import Any

import xarray as xr

from labpipe import materials
from labpipe.report import quantity, value_with_uncertainty
from pipelines.experiments.shared.proposals import material_word
from pipelines.experiments.shared.settings import Sphere

_ONSET = 1.6
"""Peak pressure over yield stress at which yield begins under a Hertzian contact (K. L. Johnson, Contact Mechanics,
1985, section 6.1, doi:10.1017/CBO9781139171731)."""
_MEAN_STRAIN = 0.2  # of a contact over a/R (the same, section 6.2)


def linear_range(
    made: xr.Dataset, sphere: Sphere, height: float, file: Path | None, fitted: xr.Dataset | None
) -> dict[str, Any]:
    """Return pressure and strain of the first impact of a simulated drop, and up to where linearity is known.

    ``strain`` and, of the rheometer's sweeps, ``sweeps`` (None where their files state none); ``pressure`` [Pa], that
    of Hertz for the largest force and radius. Where the yield stress of the material is known, at the mean strain rate
    of the contact, ``rate`` [1/s]: ``onset``, ``u_onset`` [Pa], ``beyond``, the number of impacts whose pressure
    exceeds it, and ``fall`` [m], from which the first one does (the pressure goes with the fifth root of the height).
    """
    if not made.sizes["impact"]:
        return {}
    pressure, duration = float(made["peak_pressure"][0]), float(made["contact_duration"][0])
    strain = _MEAN_STRAIN * float(made["peak_contact_radius"][0]) / sphere.radius.value
    found = {"pressure": pressure, "strain": strain, "sweeps": None if fitted is None else fitted.attrs.get("strain")}
    named = file or material_word(sphere.source)
    stress = None if named is None else materials.describe(named).yield_stress
    if stress is None or not isfinite(duration):
        return found
    rate = 2.0 * strain / duration
    onset, u_onset = (_ONSET * each for each in stress.at(rate)[:2])
    found |= {"material": sphere.source if file else named, "fall": height * (onset / pressure) ** 5}
    beyond = int((made["peak_pressure"].values > onset).sum())
    return found | {"rate": rate, "onset": onset, "u_onset": u_onset, "beyond": beyond}


def linear_range_rows(model: xr.Dataset) -> list[tuple[str, str, str]]:
    """Return pressure and strain of the first impact for a page, and whether linear viscoelasticity holds there."""
    known = json.loads(model.attrs.get("linear_range", "{}"))
    if not known:
        return []
    remark = "no yield stress of this material is known"
    if "onset" in known:
        limit, fall = value_with_uncertainty(known["onset"], known["u_onset"], "Pa"), quantity(known["fall"], "m", 2)
        remark = f"{known['material']} begins to yield at 1.6 Y = {limit} (at {known['rate']:.2g} 1/s), from a fall of "
        remark += f"some {fall} on: "
        likely = "probably " if abs(known["pressure"] - known["onset"]) < 2.0 * known["u_onset"] else ""
        if count := known["beyond"]:
            which = "the first impact" if count == 1 else f"the first {count} impacts"
            remark += f"linear viscoelasticity {likely}ends in {which}, and the model leaves out the losses by yield"
        else:
            remark += f"linear viscoelasticity {likely}holds"
    of_sweeps = "the strain of the sweeps is not known"
    if (sweeps := known["sweeps"]) is not None:
        beyond = "; that the moduli are linear beyond is assumed" if sweeps < known["strain"] else ""
        of_sweeps = f"the sweeps went up to {100.0 * sweeps:.2g} %{beyond}"
    pressure, strain = quantity(known["pressure"], "Pa", 3), f"{100.0 * known['strain']:.2g} %"
    return [("largest pressure", pressure, remark), ("mean strain, 0.2 a/R", strain, of_sweeps)]

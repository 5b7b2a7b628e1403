"""The kind ``dma``: its settings, stages and results."""

from functools import partial

from labpipe.schema import Schema
from pipelines.experiments._kind import KeyNumber, Kind, Picture, derived, judged, proposal, reported, stage
from pipelines.experiments.dma.settings import MODES, Dma
from pipelines.experiments.shared.schemas import over

_SWEPT = over("temperature", {"temperature": "degC"}, has_u=False) | over("frequency", {"frequency": "Hz"}, has_u=False)
_SWEEPS = Schema("sweeps", over("temperature frequency", {"storage": "Pa", "loss": "Pa"}, has_u=False) | _SWEPT)
_TERMS = {"E": "Pa", "rho": "s", "extrapolated": "1"}
_MASTER_CURVE = Schema(
    "master_curve",
    over("", {"E_relaxed": "Pa", "nu": "1"}, has_u=False)
    | over("", {"relaxed_modulus": "Pa"})
    | over("term", _TERMS, has_u=False)
    | over("temperature", {"log10_aT": "1"}),
)

_each = partial(stage, per="recording", over="rheometer")
_TABLE, _TENSION = "export temperature temperatures exclude", "mode nu scale specimen"

_STAGES = (
    _each("dma.measured:readings", "file:rheometer", _TABLE, "read the rheometer export"),
    stage("dma.measured:sweeps", "readings", f"{_TENSION} sweeps", "collect isothermal sweeps", schema="sweeps"),
    stage("dma.model:master_curve", "sweeps", "T_ref nu fit", "fit all shifts and one spectrum", schema="master_curve"),
    stage("dma.measured:temperature_sweep", "readings", _TENSION, "find the glass transition"),
    judged("dma", "readings sweeps master_curve", "is it believable?"),
    reported("dma", "readings sweeps master_curve temperature_sweep"),
)

KIND = Kind(
    name="dma",
    title="DMA",
    summary="sweeps of a rheometer to a master curve and its material",
    settings=Dma,
    stages=_STAGES,
    schemas=(_SWEEPS, _MASTER_CURVE),
    key_numbers=(KeyNumber("relaxed modulus", "Pa", "master_curve", "relaxed_modulus", absent="no plateau"),),
    picture=Picture("master_curve", "reduced_frequency", "master_storage", "log"),
    rows=derived("dma.comparison:rows", "master_curve"),
    budget=derived("dma.budget:quantities", "sweeps master_curve"),
    prior=derived("dma.evidence:prior", "sweeps master_curve"),
    material=derived("dma.model:deck", "master_curve"),
    proposal=proposal("sweep", "dma.proposal:proposed", answers={"mode": MODES}),
)

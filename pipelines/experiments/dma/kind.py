"""The kind ``dma``: its settings, stages and results."""

from labpipe.schema import Schema, Variable
from pipelines.experiments._kind import KeyNumber, Kind, Picture, derived, judged, proposal, reported, stage
from pipelines.experiments.dma.settings import MODES, Dma

_SWEEPS = Schema(
    "sweeps",
    {
        "storage": Variable(("temperature", "frequency"), "Pa"),
        "loss": Variable(("temperature", "frequency"), "Pa"),
        "temperature": Variable(("temperature",), "degC"),
        "frequency": Variable(("frequency",), "Hz"),
    },
)

_MASTER_CURVE = Schema(
    "master_curve",
    {
        "E_relaxed": Variable((), "Pa"),
        "relaxed_modulus": Variable((), "Pa"),
        "u_relaxed_modulus": Variable((), "Pa"),
        "nu": Variable((), "1"),
        "E": Variable(("term",), "Pa"),
        "rho": Variable(("term",), "s"),
        "extrapolated": Variable(("term",), "1"),
        "log10_aT": Variable(("temperature",), "1"),
        "u_log10_aT": Variable(("temperature",), "1"),
    },
)

_STAGES = (
    stage(
        "dma.measured:readings",
        "file:rheometer",
        "export temperature temperatures exclude",
        "read the rheometer export",
        per="recording",
        over="rheometer",
    ),
    stage(
        "dma.measured:gathered",
        "readings",
        "mode nu scale specimen sweeps",
        "collect isothermal sweeps, converted to tension",
        schema="sweeps",
        name="sweeps",
    ),
    stage("dma.model:master_curve", "sweeps", "T_ref nu fit", "fit all shifts and one spectrum", schema="master_curve"),
    stage("dma.measured:temperature_sweep", "readings", "mode nu scale specimen", "find the glass transition"),
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

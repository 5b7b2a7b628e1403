"""The whole graph on one screen: which steps each kind of experiment takes, and what each needs.

A stage names its function as text, so that planning imports no numerical library. ``version`` is
raised when a stage's answer changes; ``parameters`` are the settings on which the answer depends.
"""

from dataclasses import dataclass

import msgspec

from labpipe.workflow.graph import Stage
from pipelines.settings.ball_drop import BallDrop
from pipelines.settings.contact_area import ContactArea
from pipelines.settings.dic_validation import DicValidation
from pipelines.settings.dma import Dma
from pipelines.settings.harmonic import Harmonic
from pipelines.settings.plate_vibration import PlateVibration
from pipelines.settings.relaxation import Relaxation
from pipelines.settings.static_loading import StaticLoading

BALL_DROP = (
    Stage(
        "readings", "pipelines.experiments.ball_drop:readings", 1,
        ("file:laser",), ("keyence",), per="recording", over="laser",
        summary="read the laser export",
    ),
    Stage(
        "displacement", "pipelines.experiments.ball_drop:displacement", 1,
        ("readings", "file:calibration"),
        ("sensor", "measured_on", "analysis.inclination_from_height", "analysis.contact", "height"),
        per="recording", over="laser", schema="displacement",
        summary="correct the inclination, with uncertainty",
    ),
    Stage(
        "bounces", "pipelines.experiments.ball_drop:bounces", 2,
        ("displacement",), ("analysis.contact",), per="recording", over="laser", schema="bounces",
        summary="find release, contacts, bounces and rest",
    ),
    Stage(
        "velocity", "pipelines.experiments.ball_drop:velocity", 1,
        ("displacement", "bounces"), ("analysis.velocity", "analysis.window"),
        per="recording", over="laser", schema="velocity",
        summary="differentiate, not blunting the impacts",
    ),
    Stage(
        "repeats", "pipelines.experiments.ball_drop:repeats", 2,
        ("displacement", "velocity", "bounces"), (), schema="repeats",
        summary="align at first contact: mean, band, outliers",
    ),
    Stage(
        "model", "pipelines.experiments.ball_drop:model", 5,
        ("repeats", "file:sphere.material_file", "other:sphere.material_from/master_curve",
         "other:plate_from/plate"),
        ("height", "sphere", "model", "plate"), schema="drop",
        shortcuts=True,
        imports=("labpipe.contact.impact._simulate",),
        summary="simulate the drop",
    ),
    Stage(
        "comparison", "pipelines.experiments.ball_drop:comparison", 1,
        ("repeats", "model"), (),
        summary="measurement against model",
    ),
    Stage(
        "report", "pipelines.experiments.ball_drop_page:page", 8,
        ("readings", "displacement", "velocity", "bounces", "repeats", "model", "comparison"),
        ("*",), output="page", context=True,
        summary="write the page",
    ),
)  # fmt: skip

HARMONIC = (
    Stage(
        "readings", "pipelines.experiments.harmonic:readings", 1, ("file:mach1",),
        summary="read the Mach-1 file",
    ),
    Stage(
        "loads", "pipelines.experiments.harmonic:loads", 2,
        ("readings", "file:load_cell.record"), ("load_cell",),
        summary="compression-positive force, tared, with uncertainty",
    ),
    Stage(
        "hold", "pipelines.experiments.harmonic:hold", 6, ("loads",), ("contact", "plateau"),
        summary="peak and plateau of the relaxation before the oscillations",
    ),
    Stage(
        "oscillations", "pipelines.experiments.harmonic:oscillations", 5,
        ("loads",), ("cycles", "load_cell.correct_filter_lag"), schema="oscillations",
        summary="fit frequency, amplitude, phase; work and stiffness per cycle",
    ),
    Stage(
        "loops", "pipelines.experiments.harmonic:loops", 2, ("loads", "oscillations"), ("cycles",),
        summary="mean hysteresis loop per frequency; is contact lost?",
    ),
    Stage(
        "model", "pipelines.experiments.harmonic:model", 6,
        ("loads", "oscillations", "file:substrate.material_file",
         "other:substrate.material_from/master_curve"),
        ("punch", "substrate", "contact", "model", "cycles"),
        summary="simulate with the measured displacement",
    ),
    Stage(
        "theory", "pipelines.experiments.harmonic:theory", 1,
        ("oscillations", "loops", "model", "file:substrate.material_file",
         "other:substrate.material_from/master_curve"),
        ("punch", "substrate", "characteristic_time"),
        summary="work by eq. (2.31), tapping front, dimensionless numbers",
    ),
    Stage(
        "comparison", "pipelines.experiments.harmonic:comparison", 3,
        ("loads", "oscillations", "model"), (),
        summary="measurement against model",
    ),
    Stage(
        "report", "pipelines.experiments.harmonic_page:page", 5,
        ("readings", "loads", "hold", "oscillations", "loops", "model", "theory", "comparison"),
        ("*",),
        output="page", context=True,
        summary="write the page",
    ),
)  # fmt: skip

RELAXATION = (
    Stage(
        "readings", "pipelines.experiments.relaxation:readings", 1, ("file:mach1",),
        per="recording", over="mach1",
        summary="read the Mach-1 file",
    ),
    Stage(
        "loads", "pipelines.experiments.relaxation:loads", 2,
        ("readings", "file:load_cell.record"), ("load_cell.tare",), per="recording", over="mach1",
        summary="compression-positive force, tared, with uncertainty",
    ),
    Stage(
        "ramps", "pipelines.experiments.relaxation:ramps", 6,
        ("loads",), ("contact", "hold.plateau"), per="recording", over="mach1", schema="ramps",
        summary="find touch, ramps and holds: peak and plateau",
    ),
    Stage(
        "curves", "pipelines.experiments.relaxation:curves", 6,
        ("loads", "ramps", "file:substrate.material_file",
         "other:substrate.material_from/master_curve"),
        ("punch", "substrate", "model"), per="recording", over="mach1",
        summary="relaxation curve, and moduli from the force",
    ),
    Stage(
        "model", "pipelines.experiments.relaxation:model", 2,
        ("loads", "ramps", "file:substrate.material_file",
         "other:substrate.material_from/master_curve"),
        ("punch", "substrate", "model"), per="recording", over="mach1",
        summary="simulate with the measured displacement",
    ),
    Stage(
        "comparison", "pipelines.experiments.relaxation:comparison", 4,
        ("loads", "ramps", "model"), ("hold",), per="recording", over="mach1",
        summary="measurement against model: ramp, early, late",
    ),
    Stage(
        "tests", "pipelines.experiments.relaxation:tests", 1,
        ("ramps", "curves", "comparison"), ("mach1",), schema="relaxations",
        summary="gather the tests, average the modulus",
    ),
    Stage(
        "report", "pipelines.experiments.relaxation_page:page", 6,
        ("readings", "loads", "ramps", "curves", "model", "comparison", "tests"), ("*",),
        output="page", context=True,
        summary="write the page",
    ),
)  # fmt: skip

STATIC_LOADING = (
    Stage(
        "readings", "pipelines.experiments.static_loading:readings", 1, ("file:laser",),
        ("keyence",),
        summary="read the laser export",
    ),
    Stage(
        "displacement", "pipelines.experiments.static_loading:displacement", 1,
        ("readings", "file:calibration"),
        ("sensor", "measured_on", "zero", "loads", "steps.window"),
        summary="correct the inclination, with uncertainty",
    ),
    Stage(
        "steps", "pipelines.experiments.static_steps:steps", 4, ("displacement",),
        ("loads", "sphere.radius", "zero", "steps", "model.gravity"), schema="steps",
        summary="find the loads' times and first touch; creep compliance",
    ),
    Stage(
        "approach", "pipelines.experiments.static_loading:approach", 1,
        ("displacement", "steps"), ("sphere.radius", "steps"),
        summary="approach, contact radius and creep under each load",
    ),
    Stage(
        "model", "pipelines.experiments.static_loading:model", 2,
        ("displacement", "steps", "file:sphere.material_file",
         "other:sphere.material_from/master_curve"),
        ("sphere", "model"),
        summary="simulate the creeping contact; Hertz's steps",
    ),
    Stage(
        "comparison", "pipelines.experiments.static_loading:comparison", 1,
        ("approach", "steps", "model"), ("loads", "steps"),
        summary="measurement against model and Hertz",
    ),
    Stage(
        "report", "pipelines.experiments.static_loading_page:page", 4,
        ("readings", "displacement", "steps", "approach", "model", "comparison"), ("*",),
        output="page", context=True,
        summary="write the page",
    ),
)  # fmt: skip

DMA = (
    Stage(
        "readings", "pipelines.experiments.dma:readings", 1, ("file:rheometer",), ("export",),
        per="recording", over="rheometer",
        summary="read the rheometer export",
    ),
    Stage(
        "sweeps", "pipelines.experiments.dma:gathered", 1,
        ("readings",), ("mode", "nu", "sweeps"), schema="sweeps",
        summary="gather isothermal sweeps, in tension",
    ),
    Stage(
        "master_curve", "pipelines.experiments.dma:master_curve", 5,
        ("sweeps",), ("T_ref", "nu", "fit"), schema="master_curve",
        summary="fit all shifts and one spectrum",
    ),
    Stage(
        "published", "pipelines.experiments.dma_published:compared", 1,
        ("sweeps", "master_curve", "file:published.shifts"), ("nu", "fit", "export", "published"),
        summary="compare the shifts with a published table",
    ),
    Stage(
        "temperature_sweep", "pipelines.experiments.dma:temperature_sweep", 1,
        ("readings",), ("mode", "nu"),
        summary="find the glass transition",
    ),
    Stage(
        "report", "pipelines.experiments.dma_page:page", 6,
        ("readings", "sweeps", "master_curve", "published", "temperature_sweep"), ("*",),
        output="page", context=True,
        summary="write the page",
    ),
)  # fmt: skip

DIC_VALIDATION = (
    Stage(
        "track", "pipelines.experiments.dic_validation:track", 1, ("file:film",),
        ("tracking", "frame_rate"),
        shortcuts=True,
        imports=("labpipe.imaging.dic._tracker",),
        summary="follow the holder through the film",
    ),
    Stage(
        "motion", "pipelines.experiments.dic_validation:motion", 1,
        ("track", "file:camera"), ("view", "measured_on"), schema="film_motion",
        summary="pixels to metres, with uncertainty",
    ),
    Stage(
        "bounces", "pipelines.experiments.dic_validation:bounces", 2, ("motion",),
        schema="bounces",
        summary="find release, contacts, bounces and rest",
    ),
    Stage(
        "velocity", "pipelines.experiments.dic_validation:velocity", 1, ("motion", "bounces"),
        schema="velocity",
        summary="differentiate, not blunting the impacts",
    ),
    Stage(
        "keys", "pipelines.experiments.dic_validation:keys", 2,
        ("file:film", "track", "bounces"), ("frame_rate",),
        summary="copy key frames for the page",
    ),
    Stage(
        "comparison", "pipelines.experiments.dic_validation:comparison", 1,
        ("motion", "bounces", "other:laser_experiment/repeats"),
        summary="film against laser",
    ),
    Stage(
        "report", "pipelines.experiments.dic_validation_page:page", 5,
        ("track", "motion", "bounces", "velocity", "keys", "comparison",
         "other:laser_experiment/repeats"), ("*",),
        output="page", context=True,
        summary="write the page",
    ),
)  # fmt: skip

CONTACT_AREA = (
    Stage(
        "radius", "pipelines.experiments.contact_area:radius", 2, ("file:film", "file:camera"),
        ("view", "measured_on", "sphere.radius", "wavelength", "exposure", "frame_rate"),
        shortcuts=True,
        imports=("labpipe.imaging.fringes._every_frame",),
        summary="fit the fringes around the contact",
    ),
    Stage(
        "impacts", "pipelines.experiments.contact_area:impacts", 4, ("radius",),
        summary="find the largest radius of each impact, and that at rest",
    ),
    Stage(
        "model", "pipelines.experiments.contact_area:model", 3,
        ("radius", "impacts", "file:sphere.material_file",
         "other:sphere.material_from/master_curve", "other:plate_from/plate"),
        ("height", "sphere", "model", "plate"), schema="drop",
        shortcuts=True,
        imports=("labpipe.contact.impact._simulate",),
        summary="simulate the drop",
    ),
    Stage(
        "comparison", "pipelines.experiments.contact_area:comparison", 3,
        ("radius", "impacts", "model"),
        summary="measurement against model",
    ),
    Stage(
        "keys", "pipelines.experiments.contact_area:keys", 3,
        ("file:film", "radius", "impacts"), ("frame_rate",),
        summary="copy key frames for the page",
    ),
    Stage(
        "report", "pipelines.experiments.contact_area_page:page", 6,
        ("radius", "impacts", "model", "comparison", "keys"), ("*",),
        output="page", context=True,
        summary="write the page",
    ),
)  # fmt: skip


PLATE_VIBRATION = (
    Stage(
        "readings", "pipelines.experiments.plate_vibration:readings", 1,
        ("file:drops.laser",), ("keyence",), per="recording", over="drops.laser",
        summary="read the laser export",
    ),
    Stage(
        "displacement", "pipelines.experiments.plate_vibration:displacement", 1,
        ("readings", "file:calibration"), ("sensor", "measured_on"),
        per="recording", over="drops.laser", schema="displacement",
        summary="correct the inclination, with uncertainty",
    ),
    Stage(
        "ringing", "pipelines.experiments.plate_vibration:ringing", 2, ("displacement",),
        ("blow",), per="recording", over="drops.laser", schema="ringing",
        summary="fit the free ringing after the first blow",
    ),
    Stage(
        "table", "pipelines.experiments.plate_vibration:table", 2, ("ringing",), ("drops",),
        summary="frequency, damping and amplitude by material and height",
    ),
    Stage(
        "plate", "pipelines.experiments.plate_vibration:plate", 1, ("table",),
        ("drops", "sphere", "model"), schema="plate",
        summary="find the modal mass from amplitude and momentum",
    ),
    Stage(
        "model", "pipelines.experiments.plate_vibration:model", 1, ("table", "plate"),
        ("drops", "sphere", "model"),
        shortcuts=True,
        imports=("labpipe.contact.impact._simulate",),
        summary="simulate the drops on the plate",
    ),
    Stage(
        "comparison", "pipelines.experiments.plate_vibration:comparison", 1,
        ("displacement", "ringing", "table", "model"),
        summary="measurement against model",
    ),
    Stage(
        "report", "pipelines.experiments.plate_vibration_page:page", 5,
        ("readings", "displacement", "ringing", "table", "plate", "comparison"), ("*",),
        output="page", context=True,
        summary="write the page",
    ),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of experiment: what its table in session.toml holds, and its stages."""

    settings: type[msgspec.Struct]
    stages: tuple[Stage, ...]
    summary: str


KINDS: dict[str, Kind] = {
    "dma": Kind(Dma, DMA, "sweeps of a rheometer to a master curve and its material"),
    "ball_drop": Kind(BallDrop, BALL_DROP, "drops of a sphere, seen by the laser"),
    "contact_area": Kind(ContactArea, CONTACT_AREA, "a film of the contact through the disc"),
    "dic_validation": Kind(
        DicValidation, DIC_VALIDATION, "a film of the holder against the laser of other drops"
    ),
    "relaxation": Kind(Relaxation, RELAXATION, "relaxation of rubber under a periodic punch"),
    "plate_vibration": Kind(
        PlateVibration, PLATE_VIBRATION, "the plate ringing under drops, seen by the laser"
    ),
    "static_loading": Kind(
        StaticLoading, STATIC_LOADING, "a sphere under growing loads, seen by the laser"
    ),
    "harmonic": Kind(Harmonic, HARMONIC, "harmonic indentation by a periodic punch"),
}

"""The list of the thesis's figures: number, title, function that draws it, and what it needs of a session."""

from dataclasses import dataclass

_HOME = "pipelines.figures"


@dataclass(frozen=True, slots=True)
class Need:
    """What a figure reads of the results of a session.

    ``kind`` is that of the experiments, as in session.toml; ``stages`` are those whose results are read. Only
    experiments on this ``material`` count. ``is_optional``: the figure is drawn without them too, and then says so.
    ``heated``: only experiments at room temperature (False), only heated ones (True), or both (None).
    """

    kind: str
    stages: tuple[str, ...]
    material: str | None = None
    is_optional: bool = False
    heated: bool | None = False

    def __str__(self) -> str:
        """Say it in words, for example ``ball_drop of acrylic``."""
        return self.kind if self.material is None else f"{self.kind} of {self.material}"


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure or table of the thesis.

    ``id`` is its number, for example ``2.6``; ``title`` what it shows; ``function`` the ``module:function`` that draws
    it, "" when none does; ``need`` what it needs of a session, None when it is computed, and ``also`` what it needs
    beside that; ``reason`` why it cannot be regenerated, "" for one that this version does not draw.
    """

    id: str
    title: str
    function: str = ""
    need: Need | None = None
    reason: str = ""
    also: tuple[Need, ...] = ()

    @property
    def needs(self) -> tuple[Need, ...]:
        """All that it needs of a session."""
        return self.also if self.need is None else (self.need, *self.also)


_PHOTOGRAPH = "a photograph or drawing of the apparatus; no computation makes it"

_DROP = ("repeats", "model", "comparison")
_FILM = ("radius", "impacts", "model", "comparison")
_ACRYLIC_FILM = Need("contact_area", _FILM, "acrylic")


def _dma(material: str) -> Need:
    """Return the need of the solid that the session's own DMA measured; without one it is the library's."""
    return Need("dma", ("master_curve",), material, is_optional=True)


def _c1(name: str) -> str:
    return f"{_HOME}.chapter1:{name}"


FIGURES: tuple[Figure, ...] = (
    Figure("1.1", "Stress and strain under harmonic loading", _c1("harmonic_loading")),
    Figure("1.2", "Complex modulus with one relaxation time", _c1("one_relaxation_time")),
    Figure("1.3", "Relaxation processes of a polymer", _c1("relaxation_processes")),
    Figure("1.4", "Four classes of polymers", _c1("polymer_classes")),
    Figure("1.5", "Glass transition by volume and molecules", f"{_HOME}.apparatus:glass_transition"),
    Figure("1.6", "Maxwell element", f"{_HOME}.schematics:maxwell_element"),
    Figure("1.7", "Maxwell model", _c1("maxwell")),
    Figure("1.8", "Springs and dashpot of the linear solid", f"{_HOME}.schematics:standard_linear_solid"),
    Figure("1.9", "Standard linear solid", _c1("standard_linear_solid")),
    Figure("1.10", "Generalised Maxwell model", f"{_HOME}.schematics:generalised_maxwell"),
    Figure("2.1", "Dynamic mechanical analyser", reason=_PHOTOGRAPH),
    Figure("2.2", "Indentation set-up", reason=_PHOTOGRAPH),
    Figure("2.3", "Master curve of NBR", f"{_HOME}.sweeps:nbr", Need("dma", ("master_curve",), "nbr")),
    Figure(
        "2.4",
        "Relaxation at three depths",
        f"{_HOME}.relaxations:relaxation",
        Need("relaxation", ("loads", "ramps", "curves", "comparison"), "nbr", is_optional=True),
    ),
    Figure(
        "2.5",
        "Harmonic indentation: force and loops",
        f"{_HOME}.oscillations:loops",
        Need("harmonic", ("loads", "oscillations", "loops", "model", "comparison")),
    ),
    Figure("2.6", "Dissipated work and the tapping front", f"{_HOME}.chapter2:dissipation_map", _dma("nbr")),
    Figure("2.7", "Pressure and surface of a large oscillation", f"{_HOME}.chapter2:tapping_cycle", _dma("nbr")),
    Figure(
        "2.8",
        "Dissipated work over frequency",
        f"{_HOME}.oscillations:dissipated_work",
        Need("harmonic", ("oscillations", "model")),
    ),
    Figure("3.1", "Ball-drop set-up", reason=_PHOTOGRAPH),
    Figure("3.2", "Heated sphere and its thermal image", reason=_PHOTOGRAPH),
    Figure("3.3", "Reduced gap and quantities of an impact", f"{_HOME}.chapter3:reduced_gap", _dma("acrylic")),
    Figure("3.4", "Master curve of PEEK", f"{_HOME}.sweeps:peek", Need("dma", ("master_curve",), "peek")),
    Figure("3.5", "Master curve of nylon", f"{_HOME}.sweeps:nylon", Need("dma", ("master_curve",), "nylon")),
    Figure("3.6", "Master curve of acrylic", f"{_HOME}.sweeps:acrylic", Need("dma", ("master_curve",), "acrylic")),
    Figure("3.7", "Master curve of PTFE", f"{_HOME}.sweeps:ptfe", Need("dma", ("master_curve",), "ptfe")),
    Figure(
        "3.8",
        "Line of subsets on the falling holder",
        f"{_HOME}.subsets:falling_line",
        Need("dic_validation", ("track", "motion", "bounces", "keys")),
    ),
    Figure(
        "3.9",
        "Laser against image correlation",
        f"{_HOME}.films:laser_and_film",
        Need("dic_validation", ("bounces", "velocity", "comparison")),
    ),
    Figure("3.10", "Acrylic sphere from four heights", f"{_HOME}.drops:acrylic", Need("ball_drop", _DROP, "acrylic")),
    Figure("3.11", "Nylon sphere from four heights", f"{_HOME}.drops:nylon", Need("ball_drop", _DROP, "nylon")),
    Figure("3.12", "PEEK sphere from four heights", f"{_HOME}.drops:peek", Need("ball_drop", _DROP, "peek")),
    Figure(
        "3.13",
        "Bouncing, vibration and rest",
        f"{_HOME}.contacts:phases",
        Need("ball_drop", ("displacement", "bounces", "repeats"), "acrylic"),
        also=(_ACRYLIC_FILM,),
    ),
    Figure(
        "3.14",
        "Contact spots and simulated circles",
        f"{_HOME}.contacts:spots",
        Need("contact_area", (*_FILM, "keys"), "acrylic"),
    ),
    Figure(
        "3.15",
        "Contact radius of the first impacts",
        f"{_HOME}.films:contact_radius",
        Need("contact_area", ("comparison", "model"), "acrylic"),
    ),
    Figure(
        "3.16",
        "Heated sphere against room temperature",
        f"{_HOME}.contacts:heated",
        Need("contact_area", (*_FILM, "keys"), "acrylic"),
        also=(Need("contact_area", (*_FILM, "keys"), "acrylic", heated=True),),
    ),
    Figure(
        "3.17",
        "Sphere under stepwise load",
        f"{_HOME}.relaxations:stepwise_load",
        Need("static_loading", ("approach", "steps", "model", "comparison"), "ptfe", is_optional=True),
    ),
    Figure(
        "A.1",
        "Collision model of appendix A",
        f"{_HOME}.appendix:collision_model",
        Need("ball_drop", ("repeats",), "acrylic", is_optional=True),
    ),
    Figure("B.1a", "Laser on the plate", reason=_PHOTOGRAPH),
    Figure("B.1b", "Vibration of the plate, qualitatively", f"{_HOME}.schematics:ringing_plate"),
    Figure(
        "B.2",
        "Vibration of the plate",
        f"{_HOME}.vibration:plate_vibration",
        Need("plate_vibration", ("table", "plate", "comparison"), is_optional=True),
    ),
    Figure(
        "C.1",
        "Displacement and contact radius at four heights",
        f"{_HOME}.contacts:four_heights",
        Need("ball_drop", ("repeats",), "acrylic"),
        also=(_ACRYLIC_FILM,),
    ),
    Figure(
        "D.1",
        "Subsets on the reference frame",
        f"{_HOME}.subsets:reference_frame",
        Need("dic_validation", ("track", "keys")),
    ),
    Figure("D.2", "Ruler on the disc", f"{_HOME}.apparatus:ruler_on_disc"),
    Figure("table-D.1", "Pixel sizes of both cameras", f"{_HOME}.appendix:camera_table"),
)  # fmt: skip

"""The list of the thesis's figures: number, title, function that draws it, and its needs of a session."""

from dataclasses import dataclass
from typing import Any

_HOME = "pipelines.figures"


@dataclass(frozen=True, slots=True)
class Need:
    """Results of a session that a figure reads.

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

    ``id`` is its number, for example ``2.6``; ``title`` its subject; ``function`` the ``module:function`` that draws
    it, "" when none does, called with the inputs and with ``arguments``; ``need`` the results that it needs of a
    session, None when it is computed, and ``also`` further ones; ``reason`` why it cannot be regenerated, "" for one
    that this version does not draw.
    """

    id: str
    title: str
    function: str = ""
    need: Need | None = None
    reason: str = ""
    also: tuple[Need, ...] = ()
    arguments: tuple[str | float | bool, ...] = ()

    @property
    def needs(self) -> tuple[Need, ...]:
        """All that it needs of a session."""
        return self.also if self.need is None else (self.need, *self.also)


_PHOTOGRAPH = "a photograph or drawing of the apparatus; no computation makes it"

_DROP = ("repeats", "model", "comparison")
_FILM = ("radius", "impacts", "model", "comparison")
_ACRYLIC_FILM = Need("contact_area", _FILM, "acrylic")
_LOAD = ("approach", "steps", "model", "comparison")


def _drawn(
    number: str, title: str, function: str, need: Need | None = None, *also: Need, arguments: tuple[Any, ...] = ()
) -> Figure:
    """Return a figure that a function of this package draws, such as ``chapter1:polymer_classes``."""
    return Figure(number, title, f"{_HOME}.{function}", need, also=also, arguments=arguments)


def _springs(number: str, title: str, *shown: str) -> Figure:
    return _drawn(number, title, "schematics:springs_and_dashpots", arguments=shown)


def _photograph(number: str, title: str) -> Figure:
    return Figure(number, title, reason=_PHOTOGRAPH)


def _dma(material: str, *, is_optional: bool = True) -> Need:
    """Return the need of the solid that the session's own DMA measured; where it is optional, the library's serves."""
    return Need("dma", ("master_curve",), material, is_optional)


def _swept(number: str, material: str, word: str, *arguments: str | float | bool) -> Figure:
    """Return a figure of a master curve; its arguments begin with the printed reference temperature [degC]."""
    need = _dma(material, is_optional=False)
    return _drawn(number, f"Master curve of {word}", "sweeps:master_curve", need, arguments=arguments)


def _dropped(number: str, material: str, word: str) -> Figure:
    title, need = f"{word[:1].upper()}{word[1:]} sphere from four heights", Need("ball_drop", _DROP, material)
    return _drawn(number, title, "drops:heights", need, arguments=(word,))


FIGURES: tuple[Figure, ...] = (
    _drawn("1.1", "Stress and strain under harmonic loading", "chapter1:harmonic_loading"),
    _drawn("1.2", "Complex modulus with one relaxation time", "chapter1:one_relaxation_time"),
    _drawn("1.3", "Relaxation processes of a polymer", "chapter1:relaxation_processes"),
    _drawn("1.4", "Four classes of polymers", "chapter1:polymer_classes"),
    _drawn("1.5", "Glass transition by volume and molecules", "schematics:glass_transition"),
    _springs("1.6", "Maxwell element", "Maxwell element: spring E and dashpot mu in series, tau = mu/E.", " "),
    _drawn("1.7", "Maxwell model", "chapter1:three_panels", arguments=("Maxwell",)),
    _springs("1.8", "Springs and dashpot of the linear solid",
             "Standard linear solid: spring E_0 in parallel with a Maxwell element E_1, mu_1.", "E_0", "_1"),
    _drawn("1.9", "Standard linear solid", "chapter1:three_panels", arguments=("standard",)),
    _springs("1.10", "Generalised Maxwell model",
             "Generalised Maxwell (Wiechert) model: spring E_0 in parallel with n Maxwell elements, tau_j = mu_j/E_j.",
             "E_0", "_1", "_2", "", "_n"),
    _photograph("2.1", "Dynamic mechanical analyser"),
    _photograph("2.2", "Indentation set-up"),
    _swept("2.3", "nbr", "NBR", 20.0, "", True),
    _drawn("2.4", "Relaxation at three depths", "relaxations:relaxation",
           Need("relaxation", ("loads", "ramps", "curves", "comparison"), "nbr")),
    _drawn("2.5", "Harmonic indentation: force and loops", "oscillations:loops",
           Need("harmonic", ("loads", "oscillations", "loops", "model", "comparison"))),
    _drawn("2.6", "Dissipated work and the tapping front", "chapter2:dissipation_map", _dma("nbr")),
    _drawn("2.7", "Pressure and surface of a large oscillation", "chapter2:tapping_cycle", _dma("nbr")),
    _drawn("2.8", "Dissipated work over frequency", "oscillations:dissipated_work",
           Need("harmonic", ("oscillations", "model"))),
    _photograph("3.1", "Ball-drop set-up"),
    _photograph("3.2", "Heated sphere and its thermal image"),
    _drawn("3.3", "Reduced gap and quantities of an impact", "chapter3:reduced_gap", _dma("acrylic")),
    _swept("3.4", "peek", "PEEK", 129.93, "T_0 = 129.93 degC lies outside the stated sweeps (-40 to 120 degC)"),
    _swept("3.5", "nylon", "nylon", 20.16),
    _swept("3.6", "acrylic", "acrylic", 20.042),
    _swept("3.7", "ptfe", "PTFE", 20.031),
    _drawn("3.8", "Line of subsets on the falling holder", "subsets:falling_line",
           Need("dic_validation", ("track", "motion", "bounces", "keys"))),
    _drawn("3.9", "Laser against image correlation", "subsets:laser_and_film",
           Need("dic_validation", ("bounces", "velocity", "comparison"))),
    _dropped("3.10", "acrylic", "acrylic"),
    _dropped("3.11", "nylon", "nylon"),
    _dropped("3.12", "peek", "PEEK"),
    _drawn("3.13", "Bouncing, vibration and rest", "contacts:phases",
           Need("ball_drop", ("displacement", "bounces", "repeats"), "acrylic"), _ACRYLIC_FILM),
    _drawn("3.14", "Contact spots and simulated circles", "contacts:spots",
           Need("contact_area", (*_FILM, "keys"), "acrylic")),
    _drawn("3.15", "Contact radius of the first impacts", "contacts:contact_radius",
           Need("contact_area", ("comparison", "model"), "acrylic")),
    _drawn("3.16", "Heated sphere against room temperature", "contacts:heated",
           Need("contact_area", (*_FILM, "keys"), "acrylic"),
           Need("contact_area", (*_FILM, "keys"), "acrylic", heated=True)),
    _drawn("3.17", "Sphere under stepwise load", "relaxations:stepwise_load",
           Need("static_loading", _LOAD, "ptfe")),
    _drawn("A.1", "Collision model of appendix A", "appendix:collision_model",
           Need("ball_drop", ("repeats",), "acrylic", is_optional=True)),
    _photograph("B.1a", "Laser on the plate"),
    _drawn("B.1b", "Vibration of the plate, qualitatively", "schematics:ringing_plate"),
    _drawn("B.2", "Vibration of the plate", "drops:plate_vibration",
           Need("plate_vibration", ("table", "plate", "comparison"))),
    _drawn("C.1", "Displacement and contact radius at four heights", "contacts:four_heights",
           Need("ball_drop", ("repeats",), "acrylic"), _ACRYLIC_FILM),
    _drawn("D.1", "Subsets on the reference frame", "subsets:reference_frame",
           Need("dic_validation", ("track", "keys"))),
    _drawn("D.2", "Ruler on the disc", "schematics:ruler_on_disc"),
    _drawn("table-D.1", "Pixel sizes of both cameras", "appendix:camera_table"),
)  # fmt: skip

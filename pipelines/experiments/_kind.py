"""Description of a kind of experiment: one object that holds all that the commands need of it.

Whatever computes is named as text, ``"module:function"``, and imported where it runs: a plan and
``--help`` import nothing numerical. Inputs are written in the language of
:class:`labpipe.workflow.graph.Stage`: ``"bounces"`` (a stage of the experiment, the list of all
recordings for one that runs per recording), ``"file:sphere.material_file"``,
``"other:plate_from/plate"``.
"""

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from labpipe.schema import Schema
from labpipe.workflow.graph import FILE, OTHER, Stage

if TYPE_CHECKING:
    import xarray as xr

JUDGEMENT = "judgement"
"""Name of the stage that judges an experiment, in every kind that has one."""


@dataclass(frozen=True, slots=True)
class Derived:
    """A function of results that is no stage: rows of a comparison, a budget.

    ``"module:function"`` takes ``inputs``, in the language of a stage's, and those keywords that it asks for.
    """

    function: str
    inputs: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class KeyNumber:
    """A column of the session's page and of the catalogue; kinds that give the same title share it.

    It is the first finite value of ``variable`` in the result of ``stage``, in the SI ``unit``. The value of the
    variable ``at`` there belongs to its title: stiffnesses at two frequencies are two quantities. Where the result
    holds no value, the table says why: ``absent``.
    """

    title: str
    unit: str
    stage: str
    variable: str
    at: str = ""
    absent: str = "not found"

    def within(self, result: "xr.Dataset") -> tuple[str, float, float | None] | None:
        """Return title, number and, if known, standard uncertainty of the number that a result holds."""
        values, us = (
            [] if name not in result else result[name].values.ravel().tolist()
            for name in (self.variable, f"u_{self.variable}")
        )
        i = next((i for i, value in enumerate(values) if isfinite(value)), None)
        if i is None:
            return None
        title, at = self.title, result[self.at] if self.at else None
        title += "" if at is None else f" at {at.values.ravel()[i]:.2g} {at.attrs['units']}"
        return title, float(values[i]), float(us[i]) if len(us) == len(values) and isfinite(us[i]) else None


@dataclass(frozen=True, slots=True)
class Picture:
    """The small picture on the session's page: one variable of a result, of the first recording, over another.

    ``scale`` of both axes is "linear" or "log"; with ``is_first`` only the first stretch without a gap is drawn.
    """

    stage: str
    x: str
    y: str
    scale: str = "linear"
    is_first: bool = False


@dataclass(frozen=True, slots=True)
class Found:
    """Files that a scan recognised in a folder, relative to it.

    ``names`` holds them by instrument (``"keyence"``) and content (``"displacement"``), and calibration records by
    their kind (``"record:laser"``), those that will be written too, with their ``texts``. ``owners`` are instrument and
    reason why no experiment may begin from a file, ``unknown`` files of no instrument, and ``copies`` the owned files
    that equal another one, with its name.
    """

    folder: Path
    names: Mapping[str, list[str]]
    owners: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    texts: Mapping[str, str] = field(default_factory=dict)
    unknown: tuple[str, ...] = ()
    copies: Mapping[str, str] = field(default_factory=dict)

    def of(self, sort: str) -> list[str]:
        """Return the names of one sort; empty when there is none."""
        return self.names.get(sort, [])

    def path(self, name: str) -> Path:
        """Return where a file is."""
        return self.folder / name


@dataclass(frozen=True, slots=True)
class Proposed:
    """An experiment that a kind would make of some ``files``, which are offered to no other kind then.

    ``stem``, common to their names, gives it its name and place; ``text`` takes the name and returns its tables of
    session.toml, with gaps (:data:`labpipe.workflow.fields.GAP`) for values that are in no file.
    """

    stem: str
    files: tuple[str, ...]
    text: Callable[[str], str]


@dataclass(frozen=True, slots=True)
class Proposal:
    """How ``init`` finds the experiments of a kind among files of some contents (:data:`instruments.CONTENTS`).

    ``function`` takes the :class:`Found` and the names of one instrument's files that no kind has taken yet, and yields
    :class:`Proposed`; ``answers`` are fields that a person is asked for, with those that are accepted.
    """

    contents: tuple[str, ...]
    function: str
    answers: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """One kind of experiment.

    Attributes
    ----------
    name, title, summary : str
        As session.toml writes it; a heading; one line.
    settings, body : type, str
        Its table in session.toml, and the table therein that names a material, such as ``"sphere"``.
    stages, schemas : tuple of Stage, of Schema
        From the files to the report, and the shapes of results that they name.
    key_numbers, picture : tuple of KeyNumber, Picture
        Of the session's page.
    rows, budget : Derived, optional
        Yield :class:`pipelines.experiments.shared.comparison_rows.Row` for ``compare``, and
        :class:`pipelines.experiments.shared.budget_quantity.Quantity` for ``sensitivity``.
    evidence, prior : Derived, optional
        Evidence of ``identify`` on the material, and knowledge before it: a
        :class:`pipelines.experiments.shared.material_evidence.MaterialEvidence`, or a text that says why there is none.
        Both may take ``name``, one ``impacts`` (how many count), the other ``temperature`` (degC or None).
    film : str
        ``"module:function"`` from a film's path, results by stage (or None) and ``settings`` to a
        :class:`pipelines.experiments.shared.film_frames.DrawnFilm`.
    material : Derived, optional
        From ``name`` and ``bulk`` to a :class:`labpipe.materials.Deck`, the material as input of simulation codes.
    proposal : Proposal, optional
        Without one a person writes the experiment into session.toml.
    """

    name: str
    title: str
    summary: str
    settings: type[msgspec.Struct]
    stages: tuple[Stage, ...]
    schemas: tuple[Schema, ...] = ()
    key_numbers: tuple[KeyNumber, ...] = ()
    picture: Picture | None = None
    rows: Derived | None = None
    budget: Derived | None = None
    body: str = ""
    evidence: Derived | None = None
    prior: Derived | None = None
    film: str = ""
    material: Derived | None = None
    proposal: Proposal | None = None


_ROOMS = "pipelines.experiments."


def stage(function: str, inputs: str, parameters: str = "", summary: str = "", *, name: str = "", **more: Any) -> Stage:
    """Return a stage of the built-in kinds, called as its function unless it has another name.

    ``function`` is that below ``pipelines.experiments``, such as ``"ball_drop.measured:bounces"``; inputs, parameters
    and what it may lack or import are separated by spaces; other attributes are given by name.
    """
    more |= {key: tuple(more[key].split()) for key in more.keys() & {"may_lack", "imports"}}
    name, function = name or function.rpartition(":")[2], f"{_ROOMS}{function}"
    return Stage(name, function, tuple(inputs.split()), tuple(parameters.split()), summary=summary, **more)


def solid_of(body: str) -> str:
    """Return the inputs that define the solid of a body, the table of the settings that names a material."""
    return f"{FILE}{body}.material_file {OTHER}{body}.material_from/master_curve"


def derived(function: str, inputs: str) -> Derived:
    """Return a function of results that is no stage, named as :func:`stage` names it."""
    return Derived(f"{_ROOMS}{function}", tuple(inputs.split()))


def proposal(content: str, function: str, **more: Any) -> Proposal:
    """Return how ``init`` finds experiments among files of one content; a function as :func:`stage` names it."""
    return Proposal((content,), f"{_ROOMS}{function}", **more)


def judged(
    room: str, inputs: str, asked: str = "is it believable, does the model agree?", *, rests_on: str = ""
) -> Stage:
    """Return the stage that judges an experiment, as every kind has it in its room.

    ``rests_on`` are the settings that name experiments whose results it uses: their judgements
    follow the other inputs.
    """
    inputs = " ".join([inputs, *(f"{OTHER}{field}/{JUDGEMENT}" for field in rests_on.split())])
    return stage(f"{room}.checks:{JUDGEMENT}", inputs, "*", asked, context=True)


def reported(room: str, inputs: str) -> Stage:
    """Return the stage that writes the page, of the judgement and other results."""
    shown = f"{JUDGEMENT} {inputs}"
    return stage(f"{room}.page:page", shown, "*", "write the page", name="report", output="page", context=True)


def function(text: str) -> Callable[..., Any]:
    """Import a function by its name, ``"module:function"``."""
    module, _, name = text.partition(":")
    return getattr(importlib.import_module(module), name)

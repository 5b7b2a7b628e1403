"""Inputs of a figure: the experiments of a session, and the keys of their results."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from labpipe.workflow.results import Results
from labpipe.workflow.session import Experiment, Session
from pipelines.figures._list import Need

if TYPE_CHECKING:
    import xarray as xr

    from labpipe.materials import Prony
    from labpipe.workflow.plan import Plan


@dataclass(frozen=True, slots=True)
class Inputs:
    """Settings of experiments by name, and a way to read their results; ``plan`` was made after the results were."""

    plan: "Plan"
    experiments: Mapping[str, Any]
    _read: "dict[tuple[str, str, str | None], xr.Dataset]" = field(default_factory=dict, repr=False)

    def result(self, experiment: str, stage: str, recording: str | None = None) -> "xr.Dataset":
        """Return one stored result, of a stage per recording that of one file; it is read once.

        Raises
        ------
        InputError
            It is missing or out of date.
        """
        asked = experiment, stage, recording
        if asked not in self._read:
            self._read[asked] = Results(self.plan).result(*asked)
        return self._read[asked]

    def solid_of(self, body: Any) -> "Prony":
        """Return the solid that a sphere or a substrate of session.toml names, at its temperature."""
        from pipelines.experiments.shared.material_choice import resolve

        file = None if body.material_file is None else self.plan.session.files / body.material_file
        fitted = None
        if body.material_from is not None:
            fitted = self.result(referred(body.material_from), "master_curve")
        return resolve(body, file, fitted)

    def of_kind(self, kind: str, most: int | None = None) -> dict[str, Any]:
        """Return the experiments of one kind, from the lowest height, at most so many."""
        found = {n: s for n, s in self.experiments.items() if s.kind == kind}
        return dict(sorted(found.items(), key=lambda item: item[1].height.value)[:most])

    @property
    def origin(self) -> str:
        """The word for the data: ``synthetic`` or ``measured``."""
        return "synthetic" if self.plan.session.synthetic else "measured"

    def data_note(self, text: str) -> dict[str, str]:
        """Return ``text`` as the caption's entry that fits the data's origin."""
        return {self.origin: text}


def with_u(table: "xr.Dataset", name: str, scale: float = 1e6, digits: int = 1, **at: int) -> str:
    """Return ``value ± standard uncertainty`` of a variable, by default in µm."""
    value, u = (float(table[f"{prefix}{name}"].isel(at)) * scale for prefix in ("", "u_"))
    return f"{value:.{digits}f} ± {u:.{digits}f}"


def solid_or_library(inputs: Inputs | None, polymer: str) -> "tuple[Prony, str, dict[str, str]]":
    """Return the solid of the figure's DMA experiment at its reference temperature, without one the library's.

    With it come words for its origin, and the caption's entry on the sweeps.
    """
    if inputs is None:
        from labpipe import materials

        return materials.load(polymer), f"the library's {polymer}", {}
    from pipelines.experiments.shared.material_choice import fitted_at

    name = next(n for n, s in inputs.experiments.items() if s.kind == "dma")
    curve = inputs.result(name, "master_curve")
    words = f"the DMA experiment {name} at {float(curve['T_ref']):g} degC"
    return fitted_at(curve, None), words, inputs.data_note("the sweeps that the material follows from.")


def referred(text: str) -> str:
    """Return the name behind a reference of session.toml, ``experiment:NAME``.

    Examples
    --------
    >>> referred("experiment:ptfe_7mm")
    'ptfe_7mm'
    """
    return text.removeprefix("experiment:")


def matching(session: Session | None, need: Need) -> dict[str, Experiment]:
    """Return the experiments of a session that fit, in the session's order; without a material their name counts."""
    found: dict[str, Experiment] = {}
    for name, one in ({} if session is None else session.without_variants().experiments).items():
        settings = one.settings
        holders = (settings, *(getattr(settings, body, None) for body in ("sphere", "substrate", "sample", "specimen")))
        said = [getattr(h, key, None) for h in holders for key in ("material", "material_from", "material_file")]
        words = re.split(r"[^a-z]+", (" ".join(text for text in said if isinstance(text, str)) or name).lower())
        if one.kind == need.kind and is_heated(settings) == need.heated and need.material in (None, *words):
            found[name] = one
    return found


def temperature_of(settings: Any) -> float | None:
    """Return the temperature [degC] that an experiment states of its sphere."""
    stated = getattr(getattr(settings, "sphere", None), "temperature", None)
    return None if stated is None else float(stated.value)


def is_heated(settings: Any) -> bool:
    """Say whether the sphere was warmer than a room, 30 °C."""
    return (temperature_of(settings) or 0.0) > 30.0


def result_keys(plan: "Plan", session: Session | None, needs: Iterable[Need]) -> dict[str, str | None]:
    """Return the content key of every result that a figure reads; None where a file is missing."""
    return {
        str(task): key.value
        for need in needs
        for names in (matching(session, need),)
        for task, key in plan.keys.items()
        if task.experiment in names and task.stage in need.stages
    }

"""Measurement against model over all experiments of a session, as one table.

What an experiment compares stands in its own result ``comparison``; here it is only collected.
A curve gives its normalised root-mean-square error and bias, an event (a restitution, a largest
radius, the work of a cycle) its two values and their difference with its uncertainty.
"""

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from labpipe import signals
from pipelines import process

if TYPE_CHECKING:
    import xarray as xr

    from labpipe.workflow.runner import Event
    from labpipe.workflow.session import Experiment, Session

_IMPACTS = 3  # the thesis compares the first three


@dataclass(frozen=True, slots=True)
class Row:
    """One comparison.

    Attributes
    ----------
    experiment, kind, material, condition : str
        Which experiment, of what, and under which height, temperature or load.
    quantity, unit : str
        What is compared; SI.
    n : int
        Repeats behind the measurement, or points of a single curve.
    against : str
        ``model``, or what else the measurement is laid against.
    measured, u_measured, model, u_model, difference, u_difference : float or None
        Values of an event with standard uncertainties; the difference is measured minus model.
        Of a curve only the difference is given: the bias, and its uncertainty where one is stated.
    nrmse : float or None
        Of a curve, relative to the range of the measurement.
    """

    experiment: str
    kind: str
    material: str
    condition: str
    quantity: str
    unit: str
    n: int
    against: str = "model"
    measured: float | None = None
    u_measured: float | None = None
    model: float | None = None
    u_model: float | None = None
    difference: float | None = None
    u_difference: float | None = None
    nrmse: float | None = None

    @property
    def is_curve(self) -> bool:
        """Whether a whole curve is compared."""
        return self.nrmse is not None

    @property
    def deviation(self) -> float | None:
        """Difference in units of its standard uncertainty."""
        if self.is_curve or self.difference is None or not self.u_difference:
            return None
        return self.difference / self.u_difference

    def document(self) -> dict[str, Any]:
        """Return the row for JSON."""
        return asdict(self) | {"deviation": self.deviation}


@dataclass(frozen=True, slots=True)
class Comparison:
    """All rows of a session, and the experiments that failed or compare nothing, with reasons."""

    rows: tuple[Row, ...]
    failed: dict[str, str]
    absent: dict[str, str]


@dataclass(frozen=True, slots=True)
class _Source:
    """One experiment and a way to its results."""

    session: "Session"
    experiment: "Experiment"

    def result(self, stage: str) -> "xr.Dataset":
        return process.result(self.session.root, self.experiment.name, stage)

    def row(self, quantity: str, unit: str, n: int, **values: Any) -> Row:
        settings = self.experiment.settings
        values = {k: _plain(v) if k != "against" else v for k, v in values.items()}
        labels = {"material": _material(settings), "condition": _condition(settings)}
        own = {k: values.pop(k) for k in ("material", "condition") if values.get(k)}
        return Row(self.experiment.name, self.experiment.kind, quantity=quantity, unit=unit, n=n,
                   **(labels | own), **values)  # fmt: skip


def compare(
    folder: str | Path, *, jobs: int = 1, progress: "Callable[[Event], None] | None" = None
) -> Comparison:
    """Compare measurement and model of every experiment; what is missing is processed first.

    Parameters
    ----------
    folder : path-like
        The session folder.
    jobs : int
        Experiments processed side by side.
    progress : callable, optional
        Called with every event of the processing.

    Returns
    -------
    Comparison
    """
    session = process.reopen_session(folder)
    wanted = [
        f"{name}/{stage}"
        for name, experiment in session.experiments.items()
        if experiment.kind in COLLECTORS
        for stage in COLLECTORS[experiment.kind][0]
    ]
    names = [n for n, e in session.experiments.items() if e.kind in COLLECTORS]
    failed: dict[str, str] = {}
    if wanted:
        run = process.process(folder, wanted, names, jobs=jobs, progress=progress)
        for outcome in run.failures:
            failed.setdefault(outcome.task.experiment, f"{outcome.task}: {outcome.message}")
    rows: list[Row] = []
    absent: dict[str, str] = {}
    for name, experiment in session.experiments.items():
        if name in failed:
            continue
        if experiment.kind not in COLLECTORS:
            absent[name] = f"the kind {experiment.kind} holds no comparison with a model"
            continue
        found = list(COLLECTORS[experiment.kind][1](_Source(session, experiment)))
        rows += found
        if not found:
            absent[name] = "no model belongs to it: session.toml names nothing to simulate"
    return Comparison(tuple(rows), failed, absent)


def _plain(value: Any) -> Any:
    if isinstance(value, str) or value is None:
        return value
    number = float(value)
    return number if np.isfinite(number) else None


def _material(settings: Any) -> str:
    for holder in (getattr(settings, name, None) for name in ("sphere", "substrate")):
        for name in ("material", "material_from", "material_file"):
            text = getattr(holder, name, None)
            if isinstance(text, str):
                return text
    return ""


def _condition(settings: Any) -> str:
    parts = []
    height = getattr(settings, "height", None)
    if height is not None:
        parts.append(f"{height.value * 1e3:g} mm")
    temperature = getattr(getattr(settings, "sphere", None), "temperature", None)
    if temperature is not None:
        parts.append(f"{temperature.value:g} °C")
    return ", ".join(parts)


def _ball_drop(source: _Source) -> Iterator[Row]:
    made, repeats = source.result("comparison"), source.result("repeats")
    model = source.result("model")
    n = int(repeats.sizes["repeat"])
    relative = float(repeats.attrs["u_systematic_relative"])
    mean_size = float(np.abs(repeats["displacement_mean"]).mean())
    yield source.row("displacement", "m", n, nrmse=made["nrmse"], difference=made["bias"],
                     u_difference=relative * mean_size)  # fmt: skip
    for i in range(min(_IMPACTS, made.sizes["impact"])):
        yield source.row(
            f"restitution, impact {i + 1}", "1", int(repeats["n_repeats"][i]),
            measured=made["restitution_measured"][i], u_measured=repeats["u_restitution"][i],
            model=made["restitution_model"][i], u_model=model["u_restitution"][i],
            difference=made["restitution_difference"][i],
            u_difference=made["u_restitution_difference"][i],
        )  # fmt: skip


def _contact_area(source: _Source) -> Iterator[Row]:
    made, impacts = source.result("comparison"), source.result("impacts")
    model = source.result("model")
    counts = made["impact_number"].values
    for i in range(min(_IMPACTS, made.sizes["impact"])):
        inside = counts == i + 1
        gap = (made["film"] - made["model"]).values[inside]
        yield source.row(f"contact radius, impact {i + 1}", "m", int(inside.sum()),
                         nrmse=made["nrmse"][i], difference=gap.mean())  # fmt: skip
        yield source.row(
            f"largest radius, impact {i + 1}", "m", 1,
            measured=made["peak_radius_film"][i], u_measured=impacts["u_peak_radius"][i],
            model=made["peak_radius_model"][i], u_model=model["u_peak_contact_radius"][i],
            difference=made["peak_radius_difference"][i],
            u_difference=made["u_peak_radius_difference"][i],
        )  # fmt: skip


def _dic_validation(source: _Source) -> Iterator[Row]:
    made = source.result("comparison")
    if "bias" not in made:
        return
    yield source.row("displacement", "m", int(made["n_compared"]), against="laser",
                     nrmse=made["nrmse"], difference=made["bias"],
                     u_difference=made["u_bias"])  # fmt: skip
    for i in range(min(_IMPACTS, made.sizes["impact"])):
        yield source.row(
            f"restitution, impact {i + 1}", "1", 1, against="laser",
            measured=made["restitution_film"][i], model=made["restitution_laser"][i],
            difference=made["restitution_difference"][i],
            u_difference=made["u_restitution_difference"][i],
        )  # fmt: skip


def _harmonic(source: _Source) -> Iterator[Row]:
    made, waves = source.result("comparison"), source.result("oscillations")
    if "nrmse" not in made:
        return
    model = source.result("model")
    for i in range(waves.sizes["oscillation"]):
        condition = f"{float(waves['frequency'][i]):.3g} Hz"
        yield source.row("force", "N", 1, condition=condition, nrmse=made["nrmse"][i],
                         difference=made["bias"][i])  # fmt: skip
        yield source.row(
            "dissipated work per cycle", "J", 1, condition=condition,
            measured=waves["work_per_cycle"][i], u_measured=waves["u_work_per_cycle"][i],
            model=model["work_per_cycle"][i], u_model=model["u_work_per_cycle"][i],
            difference=made["work_per_cycle_difference"][i],
            u_difference=made["u_work_per_cycle_difference"][i],
        )  # fmt: skip


def _relaxation(source: _Source) -> Iterator[Row]:
    made = source.result("tests")
    if "nrmse_all" not in made:
        return
    for i in range(made.sizes["test"]):
        condition = f"{float(made['depth'][i]) * 1e3:.2g} mm"
        for part in ("ramp", "early", "late"):
            yield source.row(f"force, {part}", "N", 1, condition=condition,
                             nrmse=made[f"nrmse_{part}"][i],
                             difference=made[f"bias_{part}"][i])  # fmt: skip
        yield source.row(
            "plateau force", "N", 1, condition=condition,
            measured=made["plateau_force"][i], u_measured=made["u_plateau_force"][i],
            model=made["plateau_force_model"][i], difference=made["plateau_force_difference"][i],
            u_difference=made["u_plateau_force_difference"][i],
        )  # fmt: skip


def _static_loading(source: _Source) -> Iterator[Row]:
    made, steps = source.result("comparison"), source.experiment.settings
    yield source.row("contact radius", "m", int(made["time"].size),
                     nrmse=made["nrmse_contact_radius_model"],
                     difference=made["bias_contact_radius_model"])  # fmt: skip
    for i, load in enumerate(steps.loads):  # type: ignore[attr-defined]
        value, difference = made["radius_model"][i], made["radius_difference"][i]
        yield source.row(
            "contact radius", "m", 1, condition=f"{load.mass.value:g} kg",
            measured=float(value) + float(difference), model=value, difference=difference,
            u_difference=made["u_radius_difference"][i],
        )  # fmt: skip


def _plate_vibration(source: _Source) -> Iterator[Row]:
    made, table = source.result("comparison"), source.result("table")
    plate = source.result("plate")
    for i in range(table.sizes["series"]):
        where = {
            "material": str(table["material"].values[i]),
            "condition": f"{float(table['height'][i]) * 1e3:g} mm",
        }
        n = int(table["n"][i])
        yield source.row("plate's displacement", "m", n, nrmse=made["nrmse"][i],
                         difference=made["bias"][i], **where)  # fmt: skip
        scale = float(plate["modal_mass"][i]) / float(plate["mass"])
        measured = float(table["amplitude"][i])
        own = float(plate["u_modal_mass"][i]) / float(plate["modal_mass"][i])
        yield source.row(
            "amplitude at the blow", "m", n, measured=measured,
            u_measured=table["u_amplitude"][i], model=measured * scale,
            difference=measured * (1 - scale), u_difference=measured * own, **where,
        )  # fmt: skip


def _dma(source: _Source) -> Iterator[Row]:
    made = source.result("master_curve")
    parts = ("storage", "loss")
    measured = np.concatenate([made[f"{part}_reduced"].values.ravel() for part in parts])
    ratio = 1 + np.concatenate([made[f"{part}_residual"].values.ravel() for part in parts])
    known = (measured > 0) & (ratio > 0)
    # As they are drawn: a modulus spans decades, and both parts belong to one curve.
    ours = np.log10(measured[known])
    theirs = ours + np.log10(ratio[known])
    yield source.row(
        "storage and loss modulus, log10", "1", int(known.sum()), against="fit",
        nrmse=signals.nrmse(ours, theirs), difference=np.mean(ours - theirs),
        condition=f"{float(made['T_ref']):g} °C",
    )  # fmt: skip


COLLECTORS: dict[str, tuple[tuple[str, ...], Callable[[_Source], Iterator[Row]]]] = {
    "ball_drop": (("comparison", "repeats", "model"), _ball_drop),
    "contact_area": (("comparison", "impacts", "model"), _contact_area),
    "dic_validation": (("comparison",), _dic_validation),
    "plate_vibration": (("comparison", "table", "plate"), _plate_vibration),
    "static_loading": (("comparison",), _static_loading),
    "relaxation": (("tests",), _relaxation),
    "harmonic": (("comparison", "oscillations", "model"), _harmonic),
    "dma": (("master_curve",), _dma),
}
"""What of each kind is read, and how it becomes rows."""

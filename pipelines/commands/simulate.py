"""Commands that run the bundled simulator alone: simulate drop and simulate indent."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pipelines.commands.options import echo, echo_json, json_option

if TYPE_CHECKING:
    import xarray as xr

    from labpipe.materials import Prony


class Quantity(click.ParamType):  # type: ignore[type-arg]  # generic only since click 8.2
    """A number with a unit, such as ``9.525 mm``."""

    def __init__(self, si: str, example: str) -> None:
        self.name, self._si, self._example = example, si, example

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the value in SI."""
        from labpipe.errors import InputError
        from labpipe.units import quantity

        if isinstance(value, float):
            return value
        try:
            found = quantity(str(value))
        except InputError as error:
            self.fail(str(error), param, ctx)
        if found.si != self._si:
            self.fail(f'"{value}" is in {found.si or "no unit"}; expected for example '
                      f'"{self._example}"', param, ctx)  # fmt: skip
        return found.value


LENGTH, TIME = Quantity("m", "9.525 mm"), Quantity("s", "0.5 s")
MASS, FREQUENCY = Quantity("kg", "505 g"), Quantity("Hz", "2 Hz")
RATIO = Quantity("1", "0.03")
_OUT = click.option("--out", type=click.Path(dir_okay=False, path_type=Path),
                    help="netCDF file to write.")  # fmt: skip
_PICTURE = click.option("--picture", type=click.Path(dir_okay=False, path_type=Path),
                        help="Picture to draw (.png, .svg or .pdf).")  # fmt: skip


@click.group()
def simulate() -> None:
    r"""Run the bundled viscoelastic simulator.

    \b
    Example:
      labpipe simulate drop --height "1.5 mm" --picture drop.png
    """


def _material(text: str) -> "Prony":
    from labpipe import materials

    return materials.load_file(text) if text.endswith(".toml") else materials.load(text)


@simulate.command()
@click.option("--material", default="acrylic", show_default=True, help="Library name or TOML file.")
@click.option("--radius", type=LENGTH, default="9.525 mm", show_default=True)
@click.option("--mass", type=MASS, default="505 g", show_default=True, help="All that moves.")
@click.option("--height", type=LENGTH, default="1.5 mm", show_default=True, help="Fall to touch.")
@click.option("--duration", type=TIME, default="0.5 s", show_default=True, help="From release.")
@click.option("--solver", type=click.Choice(["mdr", "rings", "thesis"]), default="mdr",
              show_default=True, help="'thesis': the thesis's own scheme.")  # fmt: skip
@click.option("--profile", type=click.Choice(["parabola", "sphere"]), default="parabola",
              show_default=True)  # fmt: skip
@click.option(
    "--rtol", type=float, default=1e-4, show_default=True, help="Relative error aimed at."
)
@click.option(
    "--plate-mass", type=MASS, help="Let the substrate ring: its mass, with the two below."
)
@click.option("--plate-frequency", type=FREQUENCY)
@click.option("--plate-damping", type=RATIO, help="Damping ratio.")
@_OUT
@_PICTURE
@json_option
def drop(
    material: str,
    radius: float,
    mass: float,
    height: float,
    duration: float,
    solver: Any,
    profile: Any,
    rtol: float,
    plate_mass: float | None,
    plate_frequency: float | None,
    plate_damping: float | None,
    out: Path | None,
    picture: Path | None,
    as_json: bool,
) -> None:
    r"""Drop a viscoelastic sphere on a rigid flat (or on a plate that rings).

    \b
    Example:
      labpipe simulate drop --material ptfe --height "7 mm" --out drop.nc
    """
    from labpipe import contact

    parts = (plate_mass, plate_frequency, plate_damping)
    if any(p is not None for p in parts) and any(p is None for p in parts):
        raise click.UsageError(
            "a plate needs --plate-mass, --plate-frequency and --plate-damping together"
        )
    plate = None
    if plate_mass is not None and plate_frequency is not None and plate_damping is not None:
        plate = contact.Plate(plate_mass, plate_frequency, plate_damping)
    with _progress(as_json) as shown:
        found = contact.drop(
            _material(material), radius, mass, height, duration, solver, profile, rtol,
            plate=plate, progress=shown,
        )  # fmt: skip
    _deliver(found, out, picture, as_json, _drop_summary, _drop_panels)


@simulate.command()
@click.option("--material", default="nbr", show_default=True, help="Library name or TOML file.")
@click.option("--tip-radius", type=LENGTH, default="2 mm", show_default=True)
@click.option("--period", type=LENGTH, default="8 mm", show_default=True)
@click.option("--depth", type=LENGTH, default="18 mm", show_default=True,
              help="Contact length summed over the tips.")  # fmt: skip
@click.option("--mean", type=LENGTH, default="0.1 mm", show_default=True, help="Mean indentation.")
@click.option("--amplitude", type=LENGTH, default="0.01 mm", show_default=True)
@click.option("--frequency", type=FREQUENCY, default="1 Hz", show_default=True)
@click.option("--cycles", type=click.IntRange(min=0), default=5, show_default=True,
              help="0 only presses and holds.")  # fmt: skip
@click.option("--hold", type=TIME, default="600 s", show_default=True, help="Before the cycles.")
@click.option("--ramp", type=Quantity("m/s", "1 mm/s"), default="1 mm/s", show_default=True)
@click.option("--thickness", type=LENGTH, help="Of a bonded layer; without it a half-plane.")
@click.option("--profile", type=click.Choice(["parabola", "circle", "cosine"]), default="circle",
              show_default=True)  # fmt: skip
@click.option("--elements", type=click.IntRange(min=64), default=1024, show_default=True)
@_OUT
@_PICTURE
@json_option
def indent(
    material: str,
    tip_radius: float,
    period: float,
    depth: float,
    mean: float,
    amplitude: float,
    frequency: float,
    cycles: int,
    hold: float,
    ramp: float,
    thickness: float | None,
    profile: str,
    elements: int,
    out: Path | None,
    picture: Path | None,
    as_json: bool,
) -> None:
    r"""Press a periodic punch into a surface: ramp, hold, then oscillate.

    \b
    Example:
      labpipe simulate indent --frequency "2 Hz" --picture loops.png
    """
    import numpy as np

    from labpipe import contact

    pressed = np.linspace(0.0, mean / ramp, 41)
    held = pressed[-1] + np.geomspace(1e-3, max(hold, 2e-3), 120)
    swing = held[-1] + np.linspace(0, cycles / frequency, 100 * cycles + 1)[1:]
    time = np.concatenate([pressed, held, swing])
    moved = np.concatenate(
        [
            pressed * ramp,
            np.full(held.size, mean),
            mean + amplitude * np.sin(2 * np.pi * frequency * (swing - held[-1])),
        ]
    )
    found = contact.indent(
        _material(material), tip_radius, period, depth, time, moved, profile=profile,
        thickness=np.inf if thickness is None else thickness, elements=elements,
        outputs=("energy",),
    )  # fmt: skip
    _deliver(found, out, picture, as_json, _indent_summary, _indent_panels)


def _progress(quiet: bool) -> Any:
    import sys
    from contextlib import nullcontext

    if quiet or not sys.stderr.isatty():
        return nullcontext(None)
    from pipelines.commands.progress import fraction

    return fraction("simulating")


def _deliver(
    found: "xr.Dataset",
    out: Path | None,
    picture: Path | None,
    as_json: bool,
    summary: "Callable[[xr.Dataset], dict[str, Any]]",
    panels: "Callable[[xr.Dataset], list[tuple[Any, Any, str, str]]]",
) -> None:
    """Write, draw and say what was asked for."""
    from labpipe import files

    document = summary(found)
    if out is not None:
        files.write_dataset(out, found)
        document["netcdf"] = str(out)
    if picture is not None:
        files.write_bytes(picture, _draw(panels(found), picture.suffix.lstrip(".") or "png"))
        document["picture"] = str(picture)
    if as_json:
        echo_json(document)
        return
    for key, value in document.items():
        echo(f"{key:28}{value:.6g}" if isinstance(value, float) else f"{key:28}{value}")


def _draw(panels: list[tuple[Any, Any, str, str]], file_format: str) -> bytes:
    from matplotlib.figure import Figure

    from labpipe.report import figure_style, line_arguments
    from labpipe.report.style import figure_bytes

    with figure_style(columns=1):
        figure = Figure(figsize=(3.35, 1.7 * len(panels)), layout="constrained")
        for row, (x, y, x_label, y_label) in enumerate(panels):
            axes = figure.add_subplot(len(panels), 1, row + 1)
            axes.plot(x, y, **line_arguments("model"))
            axes.set(xlabel=x_label, ylabel=y_label)
        return figure_bytes(figure, file_format)


def _work(found: "xr.Dataset") -> dict[str, Any]:
    return {"work": json.loads(found.attrs["work"])}


def _drop_summary(found: "xr.Dataset") -> dict[str, Any]:
    count = found.sizes["impact"]
    document: dict[str, Any] = {"impacts": count}
    if count:
        for name in ("restitution", "peak_force", "peak_contact_radius", "contact_duration"):
            document[f"first {name.replace('_', ' ')}"] = float(found[name][0])
        document["impact times"] = [round(float(t), 9) for t in found["impact_time"].values]
        document["restitutions"] = [round(float(e), 6) for e in found["restitution"].values]
    last = found.isel(time=-1)
    for name in ("kinetic_energy", "potential_energy", "stored_energy", "dissipated_energy"):
        document[f"{name.replace('_', ' ')} at the end"] = float(last[name])
    return document | _work(found)


def _drop_panels(found: "xr.Dataset") -> list[tuple[Any, Any, str, str]]:
    ms = found["time"].values * 1e3
    return [
        (ms, found["displacement"].values * 1e3, "time / ms", "displacement / mm"),
        (ms, found["force"].values, "time / ms", "force / N"),
        (ms, found["contact_radius"].values * 1e3, "time / ms", "contact radius / mm"),
    ]


def _indent_summary(found: "xr.Dataset") -> dict[str, Any]:
    return {
        "peak force": float(found["force"].max()),
        "final force": float(found["force"][-1]),
        "largest contact half-width": float(found["contact_half_width"].max()),
        "dissipated energy": float(found["dissipated_energy"][-1]),
        "solver": str(found.attrs["solver"]),
        "solver reason": str(found.attrs["solver_reason"]),
        "datum": str(found.attrs["datum"]),
    } | _work(found)


def _indent_panels(found: "xr.Dataset") -> list[tuple[Any, Any, str, str]]:
    um = found["displacement"].values * 1e6
    return [
        (found["time"].values, found["force"].values, "time / s", "force / N"),
        (um, found["force"].values, "displacement / µm", "force / N"),
    ]

"""Commands that run the bundled simulator alone: simulate drop, indent, and others."""

from pathlib import Path
from typing import Any

import click

from pipelines.commands import quantities
from pipelines.commands.options import json_option
from pipelines.commands.simulate_beyond import adhesion
from pipelines.commands.simulation_output import (
    adhesion_rows,
    deliver,
    drop_panels,
    drop_summary,
    heating_rows,
    indent_panels,
    indent_summary,
)


@click.group()
def simulate() -> None:
    r"""Run the bundled viscoelastic simulator.

    \b
    Example:
      labpipe simulate drop --height "1.5 mm" --picture drop.png
    """


@simulate.command()
@quantities.material_options("acrylic")
@click.option("--radius", type=quantities.LENGTH, default="9.525 mm", help="Of the sphere.")
@click.option("--mass", type=quantities.MASS, default="505 g", help="Total moving mass.")
@click.option("--height", type=quantities.LENGTH, default="1.5 mm", help="Drop height, from release to first touch.")
@click.option("--duration", type=quantities.TIME, default="0.5 s", help="From release.")
@click.option(
    "--solver",
    type=click.Choice(["mdr", "rings", "thesis"]),
    default="mdr",
    help="'thesis' is the thesis's own scheme.",
)
@click.option("--profile", type=click.Choice(["parabola", "sphere"]), default="parabola", help="Shape of the gap.")
@click.option("--rtol", type=float, default=1e-4, help="Target relative error.")
@click.option(
    "--plate-mass", type=quantities.MASS, help="Modal mass of a vibrating substrate; needs the next two options."
)
@click.option("--plate-frequency", type=quantities.FREQUENCY, help="Natural frequency.")
@click.option("--plate-damping", type=quantities.RATIO, help="Damping ratio.")
@click.option(
    "--adhesion",
    "work_of_adhesion",
    type=quantities.WORK,
    help='Estimate whether adhesion matters: work of adhesion, "50 mJ/m2" when clean.',
)
@click.option("--heating", is_flag=True, help="Estimate self-heating.")
@click.option("--heat-capacity", type=quantities.HEAT_CAPACITY, help="For --heating; default: from the library.")
@click.option("--conductivity", type=quantities.CONDUCTIVITY, help="For --heating; default: from the library.")
@quantities.result_options
@json_option
def drop(
    material: str,
    temperature: float | None,
    vertical_shift: float,
    plate_mass: float | None,
    plate_frequency: float | None,
    plate_damping: float | None,
    work_of_adhesion: float | None,
    heating: bool,
    heat_capacity: float | None,
    conductivity: float | None,
    out: Path | None,
    picture: Path | None,
    as_json: bool,
    **fall: Any,
) -> None:
    r"""Drop a viscoelastic sphere on a rigid flat (or on a vibrating plate).

    \b
    Example:
      labpipe simulate drop --material ptfe --height "7 mm" --out drop.nc
    """
    from labpipe import contact
    from labpipe.materials import describe
    from pipelines.simulator_inputs import material as load, thermal_of

    parts = (plate_mass, plate_frequency, plate_damping)
    if any(p is not None for p in parts) and any(p is None for p in parts):
        raise click.UsageError("a plate needs --plate-mass, --plate-frequency and --plate-damping together")
    plate = None
    if plate_mass is not None and plate_frequency is not None and plate_damping is not None:
        plate = contact.Plate(plate_mass, plate_frequency, plate_damping)
    solid = load(material, temperature, vertical_shift)
    with _progress(as_json) as shown:
        found = contact.drop(solid, **fall, plate=plate, progress=shown)
    extra: dict[str, Any] = {}
    if work_of_adhesion is not None:
        extra |= adhesion_rows(found, solid, work_of_adhesion)
    if heating:
        thermal = thermal_of(material, heat_capacity, conductivity)
        extra |= heating_rows(found, describe(material), thermal, temperature)
    deliver(found, out, picture, as_json, lambda d: drop_summary(d, extra), drop_panels)


@simulate.command()
@quantities.material_options("nbr")
@quantities.punch_options
@click.option("--amplitude", type=quantities.LENGTH, default="0.01 mm", help="Of the oscillation.")
@click.option("--frequency", type=quantities.FREQUENCY, default="1 Hz", help="Of the oscillation.")
@click.option("--cycles", type=click.IntRange(min=0), default=5, help="Number of cycles; 0 for press and hold only.")
@click.option("--hold", type=quantities.TIME, default="600 s", help="Duration of the hold before the cycles.")
@click.option("--ramp", type=quantities.SPEED, default="1 mm/s", help="Speed of the ramp.")
@click.option("--thickness", type=quantities.LENGTH, help="Thickness of a bonded layer; default: half-plane.")
@click.option(
    "--profile", type=click.Choice(["parabola", "circle", "cosine"]), default="circle", help="Shape of a tip."
)
@click.option("--elements", type=click.IntRange(min=64), default=1024, help="Strips per period.")
@click.option("--maps", is_flag=True, help="Store pressure and surface at every sample.")
@quantities.result_options
@json_option
def indent(
    material: str,
    temperature: float | None,
    vertical_shift: float,
    mean: float,
    amplitude: float,
    frequency: float,
    cycles: int,
    hold: float,
    ramp: float,
    thickness: float | None,
    maps: bool,
    out: Path | None,
    picture: Path | None,
    as_json: bool,
    **punch: Any,
) -> None:
    r"""Press a periodic punch into a surface: ramp, hold, then oscillate.

    \b
    Example:
      labpipe simulate indent --frequency "2 Hz" --picture loops.png
    """
    import numpy as np

    from labpipe import contact
    from pipelines.simulator_inputs import material as load, ramp_hold_oscillation

    _require_positive(mean=mean, frequency=frequency, ramp=ramp)
    time, moved = ramp_hold_oscillation(mean, amplitude, frequency, cycles, hold=hold, ramp=ramp, per_cycle=100)
    with _progress(as_json) as shown:
        found = contact.indent(
            load(material, temperature, vertical_shift),
            time=time,
            displacement=moved,
            thickness=np.inf if thickness is None else thickness,
            **punch,
            outputs=("energy", "pressure", "surface") if maps else ("energy",),
            progress=shown,
        )
    deliver(found, out, picture, as_json, indent_summary, indent_panels)


simulate.add_command(adhesion)


def _require_positive(**values: float) -> None:
    for name, value in values.items():
        if not value > 0.0:
            raise click.UsageError(f"--{name} is {value:g} in SI units; expected more than 0")


def _progress(quiet: bool) -> Any:
    import sys
    from contextlib import nullcontext

    if quiet or not sys.stderr.isatty():
        return nullcontext(None)
    from pipelines.commands.progress import fraction

    return fraction("simulating")

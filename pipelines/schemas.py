"""The shape of every result that one stage hands to another."""

from labpipe.schema import Schema, Variable

_TIME = ("time",)
_IMPACT = ("impact",)


def _over_impact(*names: tuple[str, str]) -> dict[str, Variable]:
    """Return variables over ``impact``, each with its uncertainty."""
    table = {name: Variable(_IMPACT, units) for name, units in names}
    return table | {f"u_{name}": Variable(_IMPACT, units) for name, units in names}


SCHEMAS: dict[str, Schema] = {
    schema.name: schema
    for schema in (
        Schema("displacement", {
            "displacement": Variable(_TIME, "m"),
            "u_displacement": Variable(_TIME, "m"),
            "displacement_raw": Variable(_TIME, "m"),
            "inclination": Variable((), "rad"),
            "u_inclination": Variable((), "rad"),
        }),
        Schema("velocity", {
            "velocity": Variable(_TIME, "m/s"),
            "u_velocity": Variable(_TIME, "m/s"),
        }),
        Schema("bounces", _over_impact(
            ("touch_time", "s"), ("liftoff_time", "s"), ("incoming_speed", "m/s"),
            ("outgoing_speed", "m/s"), ("restitution", "1"),
        )),
        Schema("repeats", {
            "displacement": Variable(("repeat", "time"), "m"),
            "displacement_mean": Variable(_TIME, "m"),
            "displacement_sd": Variable(_TIME, "m"),
            "velocity": Variable(("repeat", "time"), "m/s"),
        }),
        Schema("drop", {
            "displacement": Variable(_TIME, "m"),
            "velocity": Variable(_TIME, "m/s"),
            "force": Variable(_TIME, "N"),
            "contact_radius": Variable(_TIME, "m"),
            "restitution": Variable(_IMPACT, "1"),
            "impact_time": Variable(_IMPACT, "s"),
        }),
        Schema("sweeps", {
            "storage": Variable(("temperature", "frequency"), "Pa"),
            "loss": Variable(("temperature", "frequency"), "Pa"),
            "temperature": Variable(("temperature",), "degC"),
            "frequency": Variable(("frequency",), "Hz"),
        }),
        Schema("master_curve", {
            "E_relaxed": Variable((), "Pa"),
            "nu": Variable((), "1"),
            "E": Variable(("term",), "Pa"),
            "rho": Variable(("term",), "s"),
            "extrapolated": Variable(("term",), "1"),
            "log10_aT": Variable(("temperature",), "1"),
            "u_log10_aT": Variable(("temperature",), "1"),
        }),
        Schema("film_motion", {
            "displacement": Variable(_TIME, "m"),
            "u_displacement": Variable(_TIME, "m"),
            "rotation": Variable(_TIME, "rad"),
            "pixel_size": Variable((), "m/px"),
        }),
        Schema("ramps", {
            name: Variable(("ramp",), units)
            for name, units in (
                ("depth", "m"), ("u_depth", "m"), ("peak_force", "N"), ("u_peak_force", "N"),
                ("plateau_force", "N"), ("u_plateau_force", "N"), ("ratio", "1"),
            )
        }),
        Schema("relaxations", {
            "depth": Variable(("test",), "m"),
            "peak_force": Variable(("test",), "N"),
            "plateau_force": Variable(("test",), "N"),
        }),
        Schema("ringing", {
            "natural_frequency": Variable((), "Hz"),
            "damping_ratio": Variable((), "1"),
            "amplitude": Variable((), "m"),
            "blow_time": Variable((), "s"),
        }),
        Schema("plate", {
            "frequency": Variable((), "Hz"),
            "damping_ratio": Variable((), "1"),
            "mass": Variable((), "kg"),
            "u_mass": Variable((), "kg"),
        }),
        Schema("steps", {
            "begin": Variable(("load",), "s"),
            "end": Variable(("load",), "s"),
            "force": Variable(("load",), "N"),
            "touch": Variable((), "m"),
            "u_touch": Variable((), "m"),
            "compliance": Variable(("elapsed",), "1/Pa"),
        }),
        Schema("oscillations", {
            "frequency": Variable(("oscillation",), "Hz"),
            "storage_stiffness": Variable(("oscillation",), "N/m"),
            "loss_stiffness": Variable(("oscillation",), "N/m"),
            "work_per_cycle": Variable(("oscillation",), "J"),
        }),
    )
}  # fmt: skip

"""Simulators beyond the thesis: adhesion, self-heating, amplitude-dependent modulus."""

from collections.abc import Mapping

from pipelines.simulator_inputs import thermal_of
from pipelines.sweeps.parameters import FALL, OSCILLATION, RUBBER, Outputs, Parameter, Simulator, Value, numbers, solid


def adhesion(point: Mapping[str, Value]) -> Outputs:
    """Pull-off of a sphere after Maugis, with the relaxed modulus."""
    from labpipe import contact
    from labpipe.contact.beyond import cohesive_stress, lost_energy, maugis_parameter

    number, material = numbers(point), solid(point)
    modulus = material.factor("contact") * material.E_relaxed
    sphere = (number["radius"], modulus, number["work"])
    stress = cohesive_stress(number["work"], number["distance"])
    return {
        "pull_off": contact.pull_off(*sphere, "maugis", stress),
        "pull_off_jkr": contact.pull_off(*sphere),
        "radius_at_no_load": float(contact.jkr_at_force(0.0, *sphere).contact_radius),
        "tabor": contact.tabor(*sphere, number["distance"]),
        "transition": maugis_parameter(*sphere, stress),
        "lost_energy": lost_energy(*sphere),
    }


def heating(point: Mapping[str, Value]) -> Outputs:
    """Self-heating of a train of bounces."""
    from labpipe import contact
    from labpipe.materials import describe

    number, material = numbers(point), describe(str(point["material"]))
    radius, mass, height, duration = (number[name] for name in ("radius", "mass", "height", "duration"))
    rtol, gravity = number["rtol"], number["gravity"]
    drop = contact.drop(solid(point), radius, mass, height, duration, rtol=rtol, gravity=gravity)
    thermal = thermal_of(str(point["material"]), number.get("heat_capacity"), number.get("conductivity"))
    found = contact.self_heating(drop, material, thermal, number.get("temperature"))
    return {
        "impacts": float(drop.sizes["impact"]),
        "bulk_rise": float(found.dataset["bulk_rise"][0]),
        "train_rise": found.train,
        "train_rise_adiabatic": found.train_adiabatic,
        "modulus_change": found.modulus_change,
    }


def amplitude(point: Mapping[str, Value]) -> Outputs:
    """Harmonic indentation of a material that softens with the amplitude (Kraus)."""
    from labpipe import contact
    from labpipe.materials import Kraus

    number = numbers(point)
    softening = ("critical_strain", "storage_floor", "loss_peak", "loss_floor", "exponent")
    kraus = Kraus(*(number[name] for name in softening))
    loading = ("frequency", "amplitude", "mean", "tip_radius", "period", "depth")
    found = contact.amplitude_sweep(solid(point), kraus, *(number[name] for name in loading))
    names = ("strain", "storage_stiffness", "loss_stiffness", "phase", "work_per_cycle", "lifts_off")
    return {name: float(found[name][0]) for name in names}


BEYOND = {
    "adhesion": Simulator(
        adhesion,
        {
            **RUBBER,
            "radius": Parameter("m", 9.525e-3, "of the sphere"),
            "work": Parameter("J/m2", 0.05, "of adhesion"),
            "distance": Parameter("m", 0.3e-9, "equilibrium distance of the surfaces"),
        },
        {
            "pull_off": ("N", "Pull-off force after Maugis"),
            "pull_off_jkr": ("N", "Pull-off force after JKR"),
            "radius_at_no_load": ("m", "Contact radius without load"),
            "tabor": ("1", "Tabor's parameter"),
            "transition": ("1", "Maugis's transition parameter"),
            "lost_energy": ("J", "Energy lost, closing and opening"),
        },
    ),
    "heating": Simulator(
        heating,
        {
            **FALL,
            "duration": Parameter("s", 0.5, "from the release"),
            "heat_capacity": Parameter("J/kg/K", None, "without it, the library's"),
            "conductivity": Parameter("W/m/K", None, "without it, the library's"),
            "rtol": Parameter("1", 1e-3, "relative error aimed at"),
        },
        {
            "impacts": ("1", "Impacts"),
            "bulk_rise": ("K", "Rise of the contact by the first impact"),
            "train_rise": ("K", "Largest rise, with conduction"),
            "train_rise_adiabatic": ("K", "Largest rise, without conduction"),
            "modulus_change": ("1", "Relative change of the modulus"),
        },
    ),
    "amplitude": Simulator(
        amplitude,
        {
            **OSCILLATION,
            "critical_strain": Parameter("1", 0.01, "shear strain at half of the decrease"),
            "storage_floor": Parameter("1", 0.5, "storage modulus left at large strain"),
            "loss_peak": Parameter("1", 1.0, "loss modulus at the critical strain"),
            "loss_floor": Parameter("1", 1.0, "loss modulus left at large strain"),
            "exponent": Parameter("1", 0.6, "of the strain"),
        },
        {
            "strain": ("1", "Amplitude of the representative shear strain"),
            "storage_stiffness": ("N/m", "Storage stiffness"),
            "loss_stiffness": ("N/m", "Loss stiffness"),
            "phase": ("rad", "Phase lead of the force"),
            "work_per_cycle": ("J", "Work dissipated in a cycle"),
            "lifts_off": ("1", "1 where the punch loses contact: the theory is not valid there"),
        },
    ),
}
"""Keys as ``labpipe sweep`` names them."""

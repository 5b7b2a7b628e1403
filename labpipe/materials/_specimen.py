"""Form factors of the specimens of a rheometer: modulus over stiffness, by mode of loading and dimensions."""

from math import inf, pi, tanh

from labpipe.errors import InputError

_TERMS = 20  # of the series for torsion; the last changes it by 1e-8


def form_factor(
    mode: str, length: float, width: float | None = None, thickness: float | None = None, diameter: float | None = None
) -> float:
    """Return the modulus over the stiffness of a bar: E over force per displacement, G over torque per angle.

    Parameters
    ----------
    mode : {"tension", "bending", "torsion"}
        Bending is between supports, ``length`` apart, by a force in the middle.
    length, width, thickness, diameter : float [m]
        Between the clamps; of a rectangular bar, bent along its thickness, or of a round one.

    Returns
    -------
    float
        In 1/m for tension and bending, 1/m³ for torsion.

    Raises
    ------
    InputError
        Shear of a plate, or neither diameter nor width and thickness.

    Notes
    -----
    Torsion of a bar by Saint-Venant's series (Timoshenko & Goodier, Theory of Elasticity, sect. 109).

    Examples
    --------
    >>> round(form_factor("tension", 40e-3, 5e-3, 5e-3))
    1600
    >>> round(form_factor("torsion", 20e-3, 3e-3, 3e-3) * 0.1406 * 3e-3**4 / 20e-3, 3)
    1.0
    """
    if mode not in ("tension", "bending", "torsion"):
        raise InputError(f'form factors are known for tension, bending and torsion, not for "{mode}"')
    if diameter is not None:
        area, second, polar = pi / 4 * diameter**2, pi / 64 * diameter**4, pi / 32 * diameter**4
    elif width is not None and thickness is not None:
        area, second = width * thickness, width * thickness**3 / 12
        wide, thin = max(width, thickness), min(width, thickness)
        odd = range(1, 2 * _TERMS, 2)
        series = sum(tanh(0.5 * n * pi * wide / thin) / n**5 for n in odd)
        polar = wide * thin**3 / 3 * (1 - 192 / pi**5 * thin / wide * series)
    else:
        area = second = polar = -inf
    if min(length, area) <= 0.0:
        raise InputError("a specimen needs length, and either diameter or width and thickness, all above 0")
    return {"tension": length / area, "bending": length**3 / (48 * second), "torsion": length / polar}[mode]

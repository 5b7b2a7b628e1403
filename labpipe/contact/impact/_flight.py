"""Free flight between two contacts: one step, however long.

The sphere is ballistic while its dent recovers, so it touches again on the residual dent, not where
the undeformed surface would be.
"""

from labpipe.arrays import Floats
from labpipe.contact.impact._bounce_steps import Fall, time_of_flight
from labpipe.contact.impact._plate import Plate, PlateState, modal
from labpipe.errors import LabpipeError


def time_to_touch(
    velocity: float,
    gravity: float,
    dent: Floats,
    rate: Floats,
    plate: Plate | None = None,
    state: PlateState | None = None,
) -> float:
    """Time in s until the sphere meets its recovering dent again; 0 when it does not part from it.

    Parameters
    ----------
    velocity : float [m/s]
        At lift-off, downwards positive, so negative when the sphere rises.
    gravity : float [m/s2]
    dent : array (element,) [m]
        Displacements of the central spring's elements at lift-off.
    rate : array (element,) [1/s]
        Their rates of recovery.
    plate : Plate, optional
        That rings; the first touch is found, of those that last longer than a small part of its
        period.
    state : PlateState, optional
        Of the plate, at lift-off.

    Raises
    ------
    LabpipeError
        The sphere does not come back: a defect of the program.

    Notes
    -----
    The distance is a parabola minus a sum of decaying exponentials: its second derivative
    increases, so that it has exactly one zero after lift-off. The dent only recovers, therefore the
    zero lies before the sphere falls back to where it lifted off. Above a plate that rings the
    surface is looked at while the sphere is within reach of the plate's swing, and only then.
    """
    u, w, _ = state or PlateState()
    time = time_of_flight(Fall(1.0, gravity, 1.0, False, *modal(plate), 0.0, 0.0, 0.0), velocity, dent, rate, u, w)
    if time < 0.0:
        message = "the sphere does not come back to the plate"
        raise LabpipeError(message)
    return float(time)

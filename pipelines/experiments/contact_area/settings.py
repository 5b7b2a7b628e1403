"""Settings of a contact area: a film through the transparent disc, lit by one wavelength."""

from typing import Annotated, ClassVar, Literal

from labpipe.workflow.fields import POSITIVE, Adhesion, ExperimentName, Length, Range, Time
from pipelines.experiments.shared.settings import DropModel, Flat, OfCamera, Plate, Sphere

Pixel = Annotated[float, Range(at_least=0, at_most=1e5)]
Corner = tuple[Pixel, Pixel]


class ContactArea(OfCamera, frozen=True, kw_only=True):
    """A film of the contact between sphere and disc during one drop.

    ``camera`` is the calibration record of the film's ``view``. ``wavelength`` is that of the
    light; without it (white light) only the edge of the dark spot can be measured, which is
        several micrometres worse. ``counter_body`` is the disc. ``exposure`` replaces that in the film's file.
        ``region`` are two opposite corners, in px (x right, y down), of the part of the frames in which
    the contact is looked for: without it all of each frame, in which a second sphere, a scratch or
    a label may be taken for it. ``work_of_adhesion`` of the surfaces determines the distance of the edge
    of a contact from the Hertz-equivalent radius that fringes show (0: they do not stick); without it anywhere
    up to where that of a clean smooth polymer puts it.
    """

    alternatives: ClassVar = (("plate", "plate_from"),)
    kind: Literal["contact_area"]
    view: str = "under"  #: the record's view
    height: Annotated[Length, POSITIVE]  #: fall from release to first touch
    sphere: Sphere  #: the falling body
    counter_body: Flat = "sapphire"  #: the disc
    wavelength: Annotated[Length, Range(at_least=1e-7, at_most=2e-5)] | None = None  #: of the light
    exposure: Annotated[Time, POSITIVE] | None = None  #: replaces that in the film
    region: tuple[Corner, Corner] | None = None  #: two corners of the part that is searched, px
    work_of_adhesion: Annotated[Adhesion, Range(at_least=0.0)] | None = None  #: of the surfaces
    model: DropModel = DropModel()  #: the simulation
    plate: Plate | None = None  #: the plate under the sphere, if it vibrates
    plate_from: ExperimentName | None = None  #: plate vibration that measured the plate

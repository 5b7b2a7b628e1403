"""Pictures of the guide to films: a contact that is measured, and frames that are not."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from labpipe import files
from labpipe.arrays import Floats
from labpipe.imaging import contact_radius, hertz_gap

_PIXEL, _SPHERE, _WAVELENGTH = 4.34e-6, 9.525e-3, 633e-9
_SHAPE, _CENTRE = (200, 280), (140.3, 99.6)
_ENLARGED, _GREEN, _RED = 2, (60, 200, 60), (60, 60, 230)


def write(folder: Path) -> None:
    """Draw ``contact-measured.webp`` and ``contact-refused.webp`` into a folder."""
    rng = np.random.default_rng(1)
    contact = [_frame(_rings(a, 0.0), rng) for a in (180e-6, 220e-6, 250e-6)]
    hovering = [_frame(_rings(0.0, gap), rng) for gap in (0.16e-6, 1.3e-6)]
    disc = _frame(np.asarray(120.0 - 90.0 * (_distance() < 200e-6), float), rng)
    _write(folder / "contact-measured.webp", contact)
    _write(folder / "contact-refused.webp", [*hovering, disc])


def _distance() -> Floats:
    y, x = np.mgrid[: _SHAPE[0], : _SHAPE[1]]
    return np.asarray(_PIXEL * np.hypot(x - _CENTRE[0], y - _CENTRE[1]))


def _rings(radius: float, hover: float) -> Floats:
    gap = hertz_gap(_distance(), radius, _SPHERE) + hover
    return np.asarray(120.0 * (1.0 - 0.8 * np.cos(4.0 * np.pi * gap / _WAVELENGTH)))


def _frame(light: Floats, rng: np.random.Generator) -> NDArray[np.uint8]:
    return np.clip(np.rint(light + 2.0 * rng.standard_normal(_SHAPE)), 0, 255).astype(np.uint8)


def _write(path: Path, frames: list[NDArray[np.uint8]]) -> None:
    """Draw frames side by side, with the circle that was fitted, or a sentence where there is none."""
    panels = []
    for image in frames:
        found = contact_radius(image[None], _PIXEL, _SPHERE, _WAVELENGTH)
        panel = cv2.cvtColor(cv2.resize(image, None, fx=_ENLARGED, fy=_ENLARGED), cv2.COLOR_GRAY2BGR)
        text, colour = "no contact", _RED
        if bool(found.in_contact[0]):
            radius, u = 1e6 * float(found.radius[0]), 1e9 * float(found.u_radius[0])
            text, colour = f"{radius:.3f} um, u {u:.0f} nm", _GREEN
            centre = [round(_ENLARGED * float(found[name][0])) for name in ("centre_x", "centre_y")]
            cv2.circle(panel, centre, round(_ENLARGED * radius * 1e-6 / _PIXEL), colour, 2, cv2.LINE_AA)
        cv2.putText(panel, text, (12, 28), cv2.FONT_HERSHEY_SIMPLEX, 0.8, colour, 2, cv2.LINE_AA)
        panels.append(panel)
    written, encoded = cv2.imencode(path.suffix, np.hstack(panels), [cv2.IMWRITE_WEBP_QUALITY, 40])
    if not written:
        raise OSError(f"the picture {path} could not be encoded")
    files.write_bytes(path, encoded.tobytes())

"""Tell a sphere that touches or hovers from a small contact, by all rings around a point."""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from labpipe.arrays import Floats
from labpipe.imaging.fringes._interference import Optics
from labpipe.imaging.fringes._radial_scan import Window, left_by_edge, left_by_sphere, radial_profile

#: A sphere is told from its rings down to this spacing (px), so many at most and so many at least, with one of
#: these blurs (px), when it leaves less than this share of the squares.
_COARSE_SPACING, _MANY_RINGS, _FEW_RINGS, _BLURS, _SPHERE_LEAVES = 6.0, 8.0, 2.0, (0.0, 1.5, 3.0, 6.0), 0.01
#: A sphere leaves less than this share of what a plain edge does, 0.05 out of focus: a speck of dust that is blurred
#: looks like a sphere out of focus whose rings are gone, and left 0.18 and more.
_RINGS_SHOW = 0.1
#: Radii of small contacts that are compared with a sphere, in Newton spots, and the multiple of the squares that the
#: best of them leaves which a sphere must leave to count as a contact.
_SMALL_RADII, _CONTACT_SURE = np.arange(0.4, 1.05, 0.02), 1.5
#: A contact of so many Newton spots adds such a share to the squares that a sphere leaves, and that goes with its
#: radius to this power.
_TOLD = (0.6, 0.0048, 6.7)
#: Samples of the model in a ring.
_SAMPLES = 2


def left_by_only_sphere(frame: NDArray[np.generic], x: float, y: float, optics: Optics) -> float | None:
    """Share of the squares that a sphere leaves which touches or hovers, where all rings around a point are its.

    From the centre outwards such a sphere left 0.2 % of the squares in plain light, whatever its distance, out of
    focus and beside dust, and 1.1 % where a camera is not linear; around contacts of 0.6 and 0.8 Newton spots it
    leaves 0.5 and 3.5 % more, which these explain.
    """
    slope = optics.phase_scale
    reach = min(2.0 * math.pi / (_COARSE_SPACING * slope), math.sqrt(4.0 * math.pi * _MANY_RINGS / slope))
    profile, counts = radial_profile(frame, x, y, 1.0, math.ceil(reach))
    is_seen = counts > 0.0
    seen = len(counts) if is_seen.all() else int(is_seen.argmin())
    if 0.5 * slope * seen**2 < 2.0 * math.pi * _FEW_RINGS:
        return None
    window = Window(profile, counts, 0, seen)
    distance = np.arange(seen, dtype=np.float64) + 0.5
    blurs = dict.fromkeys((optics.blur, *_BLURS))
    left = min(left_by_sphere(window, distance, optics, blur, has_harmonics=True) for blur in blurs)
    if left >= _SPHERE_LEAVES * window.squares or left >= _RINGS_SHOW * left_by_edge(window, seen):
        return None
    likeliest = (terms[window.left_by(terms).argmin()] for terms in _small_contacts(optics, seen))
    contacts = min(window.left_by_all(np.stack([term, 2.0 * term**2 - 1.0])) for term in likeliest)
    return left / window.squares if left < _CONTACT_SURE * contacts else None


def told_radius(share: float) -> float:
    """Least radius, in Newton spots, of a contact that is told from a sphere which leaves this share of the squares.

    It adds as much again to what the sphere leaves.
    """
    told, adds, power = _TOLD
    return told * (share / adds) ** (1.0 / power)


@lru_cache(maxsize=4)
def _small_contacts(optics: Optics, rings: int) -> list[Floats]:
    """Interference terms (radius, ring) of contacts about as small as a Newton spot, for each of some blurs."""
    from labpipe.imaging.fringes._table_kernel import fill_templates

    radii = math.sqrt(math.pi / optics.phase_scale) * _SMALL_RADII
    first, length = np.zeros(len(radii), np.int64), np.full(len(radii), rings)
    sharp = fill_templates(radii, first, length, 1.0, optics.phase_scale, optics.phase, _SAMPLES)
    whole = np.concatenate([sharp[:, ::-1], sharp], axis=1).astype(np.float64)
    blurs = dict.fromkeys((optics.blur, *_BLURS[:-1]))
    return [gaussian_filter1d(whole, blur, axis=1)[:, rings:] if blur else whole[:, rings:] for blur in blurs]

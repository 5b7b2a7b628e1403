"""The parameters of the interference pattern around a contact, and which of them are fitted."""

from enum import IntEnum


class Parameter(IntEnum):
    """Places in the vector of parameters; lengths in px, angles in rad, light in grey levels.

    The light is (GAIN + MODULATION · cos) (1 + SLOPE_X x + SLOPE_Y y + BOWL b), x and y and b of
    order 1 over the ring. STRETCH and SHEAR make circles elliptic. SMEAR is the square of the
    change of the radius during the exposure (px²), SCALE the logarithm of a factor of the phase
    scale. BLUR is the square of the blur (px²) beyond that of the optics. SECOND and TURNED are the
    real and the imaginary part of the ratio q of one harmonic to the one before, as of many beams:
    the real part of z/(1 - qz), z = exp iφ, stands for the cosine. THIRD is a third harmonic beside
    those (a camera that is not linear), and with it come others, as of a power of the light. SPREAD
    is the variance of the wavenumbers in the light, relative to the square of their mean, beyond
    that of the optics: a band of colours, or a cone of directions. FOCUS is the distance (of path,
    in the unit of the sphere's radius) over which light that the gap has bent runs on to where it
    is in focus, beyond that of the optics. SHAPE is the square of the disc's share in the blur, with
    which the fourth cumulant of the image of a point goes, beyond that of the optics.

    With any of LIGHT_, which are the higher powers of x and y, x² - y², xy, x³, x²y, xy², y³, and
    VISIBILITY_, the light is (GAIN + MODULATION · cos · (1 + VISIBILITY_X x + ...)) exp(SLOPE_X x + ...):
    a beam is bell-shaped, and light that comes another way weakens the fringes unevenly.
    """

    RADIUS = 0
    X = 1
    Y = 2
    GAIN = 3
    MODULATION = 4
    SLOPE_X = 5
    SLOPE_Y = 6
    BOWL = 7
    PHASE = 8
    STRETCH = 9
    SHEAR = 10
    SMEAR = 11
    SCALE = 12
    BLUR = 13
    SECOND = 14
    TURNED = 15
    THIRD = 16
    SPREAD = 17
    FOCUS = 18
    SHAPE = 19
    LIGHT_XX = 20
    LIGHT_XY = 21
    LIGHT_X3 = 22
    LIGHT_X2Y = 23
    LIGHT_XY2 = 24
    LIGHT_Y3 = 25
    VISIBILITY_X = 26
    VISIBILITY_Y = 27
    VISIBILITY_BOWL = 28


#: Square of an even motion over its variance: what a lens blurs looks like a motion, and the reverse.
EVEN = 12.0
#: Length of the vector of parameters.
PARAMETERS = len(Parameter)
#: What is fitted in every frame.
USUAL = (
    Parameter.RADIUS,
    Parameter.X,
    Parameter.Y,
    Parameter.GAIN,
    Parameter.MODULATION,
    Parameter.SLOPE_X,
    Parameter.SLOPE_Y,
    Parameter.BOWL,
    Parameter.SMEAR,
)
#: What makes circles elliptic.
AXES = (Parameter.STRETCH, Parameter.SHEAR)
#: Harmonics of the interference: all, those of faces that do not absorb, and those of coatings that do,
#: which turn the phase; the higher powers of place in the light, and unevenly weak fringes.
HARMONICS = (Parameter.SECOND, Parameter.TURNED, Parameter.THIRD)
BEAMS = (Parameter.SECOND, Parameter.THIRD)
COATING = (Parameter.PHASE, *HARMONICS)
LIGHT = tuple(p for p in Parameter if p >= Parameter.LIGHT_XX)
VISIBILITY = tuple(p for p in LIGHT if p >= Parameter.VISIBILITY_X)
#: What changes the light with the distance from the centre alone.
RADIAL = (Parameter.SCALE, Parameter.BLUR, Parameter.SPREAD, Parameter.FOCUS, *COATING)
#: What is taken for granted in a frame; the fit tells how the radius depends on it.
ASSUMED = (Parameter.PHASE, Parameter.SCALE)

"""The parameters of the interference pattern around a contact, and which of them are fitted."""

from enum import IntEnum


class Parameter(IntEnum):
    """Places in the vector of parameters; lengths in px, angles in rad, light in grey levels.

    The light is (GAIN + MODULATION · cos) (1 + SLOPE_X x + SLOPE_Y y + BOWL b), x and y and b of
    order 1 over the ring. STRETCH and SHEAR make circles elliptic. SMEAR is the square of the
    change of the radius during the exposure (px²), SCALE the logarithm of a factor of the phase
    scale. BLUR is the square of the blur (px²) beyond that of the optics, SECOND and THIRD are
    harmonics of the cosine (many beams, a camera that is not linear), LIGHT_ the higher powers of
    x and y in the light: x² - y², xy, x³, x²y, xy², y³.
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
    THIRD = 15
    LIGHT_XX = 16
    LIGHT_XY = 17
    LIGHT_XXX = 18
    LIGHT_XXY = 19
    LIGHT_XYY = 20
    LIGHT_YYY = 21


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
#: Harmonics of the interference, and the higher powers of place in the light.
HARMONICS = (Parameter.SECOND, Parameter.THIRD)
LIGHT = tuple(p for p in Parameter if p.name.startswith("LIGHT_"))
#: What is taken for granted in a frame; the fit tells how the radius depends on it.
ASSUMED = (Parameter.PHASE, Parameter.SCALE)

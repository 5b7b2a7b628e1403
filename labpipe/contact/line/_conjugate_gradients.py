r"""Any contact of a periodic line: rough, two-tip or off-centre profiles; conjugate gradients.

The step's problem is the linear complementarity problem of elastic contact,

.. math::
    P \ge 0, \qquad h = G P - (\delta - f - G\,p_{past}) \ge 0, \qquad P\,h = 0,

for the pressure times the step's compliance, P. It is solved by projected conjugate gradients after
Polonsky and Keer with FFT products, preconditioned by 1/G(q) restricted to the contact, started
from the last step's pressure. It needs no nested order and costs some products per step where
:mod:`labpipe.contact.springs._bed` costs none. Where the gradients do not settle, block principal
pivoting with dense solves finishes the step: it ends after finitely many pivots for every positive
definite matrix.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from labpipe.arrays import Flags, Floats
from labpipe.contact.line._kernels import LineKernel
from labpipe.contact.springs import EDGE_OFFSET, Answer
from labpipe.errors import InputError

# Largest gap in the contact, or penetration outside it, relative to the largest approach.
_TOLERANCE = 1e-11
_MAX_ITERATIONS = 120
_MAX_PIVOTS = 500
# Block pivots without progress before single (least index) pivots, which cannot cycle, take over.
_PATIENCE = 10
# A half-plane needs an open part: its displacements have no mean.
_OPEN_STRIPS = 6
_FORCE_TOLERANCE = 1e-10
_STIFFNESS_TOLERANCE = 1e-4
_MAX_FORCE_ITERATIONS = 60


@dataclass(slots=True)
class GeneralContact:
    """Contact of a period with any profile, for E* = 1.

    ``kernel``: Period, strips and influence. ``profile`` (element,) [m]: Height of the indenter over the undeformed
    surface at zero approach; infinite where there is no indenter. ``limit``: What to say when no open part is left of
    a half-plane. ``has_end``: The indenter may be in contact up to where its profile becomes infinite (a punch).
    """

    kernel: LineKernel
    profile: Floats
    limit: str
    has_end: bool = True
    products: int = 0
    pivots: int = 0
    _start: Floats = field(init=False)
    _preconditioner: Floats = field(init=False)
    _present: Flags = field(init=False)
    _heights: Floats = field(init=False)

    def __post_init__(self) -> None:
        """Prepare what every step needs."""
        self._start = np.zeros(self.kernel.elements)
        symbol = self.kernel.symbol.copy()
        # Any positive number serves for the mean: the preconditioner need not be exact.
        symbol[0] = max(symbol[0], symbol[1])
        self._preconditioner = 1.0 / symbol
        self._present = np.isfinite(self.profile)
        self._heights = np.where(self._present, self.profile, 0.0)

    @property
    def size(self) -> int:
        """Number of strips."""
        return self.kernel.elements

    @property
    def weights(self) -> Floats:
        """Force per unit pressure (element,)."""
        return np.full(self.size, self.kernel.spacing)

    def inner(self, left: Floats, right: Floats) -> Floats:
        """Energy products (...,) of pressures (..., element)."""
        return self.kernel.spacing * np.sum(left * self.kernel.displacement(right), axis=-1)

    def press(self, history: Floats, compliance: float, displacement: float, before: float = 0.0) -> Answer:
        """Solve at a prescribed displacement.

        ``history`` (element,) is a pressure-like memory: its elastic displacement is the surface without load now.
        ``compliance`` [1/Pa] is that of this step, ``displacement`` [m] the approach; ``before`` is not used, for the
        search starts from the last solution. A half-plane that would be in contact everywhere raises InputError.
        """
        self.products += 1
        approach = displacement - self._heights - self.kernel.displacement(history)
        scale = max(abs(displacement), float(np.ptp(approach[self._present])), 1e-300)
        if not np.any(approach[self._present] > 0.0):
            self._start = np.zeros(self.size)
            return Answer(self._start, 0.0, displacement, 0.0)
        if self.kernel.mean_compliance == 0.0 and self._present.all() and approach.mean() >= 0.0:
            raise InputError(self.limit)
        scaled = self._solve(approach, scale * _TOLERANCE)
        contact = scaled > 0.0
        touched = int(np.count_nonzero(contact))
        if self.kernel.mean_compliance == 0.0 and touched > self.size - _OPEN_STRIPS:
            raise InputError(self.limit)
        if not self.has_end and np.any(contact & ~np.roll(self._present, 1)):
            raise InputError(self.limit)
        self._start = scaled
        load = scaled / compliance
        force = self.kernel.spacing * float(load.sum())
        patches = int(np.count_nonzero(contact & ~np.roll(contact, 1)))
        width = self.kernel.spacing * (0.5 * touched - EDGE_OFFSET * patches)
        return Answer(load, force, displacement, max(width, 0.0))

    def push(self, history: Floats, compliance: float, force: float, before: float) -> Answer:
        """Solve at a prescribed force, by Newton's method for the displacement."""
        free = self._heights + self.kernel.displacement(history)
        low = float(free[self._present].min())
        if force <= 0.0:
            return Answer(np.zeros(self.size), 0.0, low, 0.0)
        resolution = 10.0 * _TOLERANCE * max(float(np.ptp(free[self._present])), abs(low), 1e-300)
        # A single strip is the softest contact there is: it starts a search from no contact.
        first = force * compliance / self.kernel.spacing * float(self.kernel.influence[0])
        displacement = before if before > low + resolution else low + min(first, np.ptp(free))
        for _ in range(_MAX_FORCE_ITERATIONS):
            answer, displacement = self._press_open(history, compliance, displacement, low)
            stiffness = self._stiffness(answer.load > 0.0) / compliance
            step = (force - answer.force) / stiffness
            if abs(step) <= resolution or abs(step) * stiffness <= _FORCE_TOLERANCE * force:
                return answer._replace(force=force)
            # The force is convex in the displacement, so Newton's steps come from above.
            displacement = max(displacement + step, low + 0.1 * (displacement - low))
        raise InputError(f"no displacement was found that carries {force} N/m per tip; {self.limit}")

    def _press_open(self, history: Floats, compliance: float, displacement: float, low: float) -> tuple[Answer, float]:
        """Solve at a displacement, or at one nearer to first touch if that closes the period."""
        for _ in range(_MAX_FORCE_ITERATIONS):
            try:
                return self.press(history, compliance, displacement), displacement
            except InputError:
                displacement = low + 0.9 * (displacement - low)
        raise InputError(self.limit)

    def _stiffness(self, contact: Flags) -> float:
        """Force (times compliance) per displacement of a contact that keeps its strips."""
        load = contact / float(self.kernel.influence.sum() + self.kernel.influence[0])
        gap = np.where(contact, self._gap(load, contact.astype(float)), 0.0)
        direction, previous = np.zeros(self.size), np.inf
        for _ in range(_MAX_ITERATIONS):
            if np.abs(gap).max() <= _STIFFNESS_TOLERANCE:
                break
            steepest = np.where(contact, self._precondition(gap), 0.0)
            measure = float(gap @ steepest)
            direction = steepest + measure / previous * direction
            image = np.where(contact, self.kernel.displacement(direction), 0.0)
            self.products += 2
            length = measure / float(direction @ image)
            load, gap, previous = load - length * direction, gap - length * image, measure
        return self.kernel.spacing * float(load.sum())

    def _solve(self, approach: Floats, tolerance: float) -> Floats:
        """Pressure times compliance (element,) with G P = approach in contact, more outside."""
        pressure = np.where(self._present, self._start, 0.0)
        if not np.any(pressure > 0.0):
            pressure = np.where(self._present, np.maximum(approach, 0.0), 0.0)
            pressure /= self.kernel.influence[0]
        gap = self._gap(pressure, approach)
        direction = np.zeros(self.size)
        previous = np.inf
        for _ in range(_MAX_ITERATIONS):
            contact = pressure > 0.0
            residual = np.where(contact, gap, 0.0)
            outside = self._present & ~contact & (gap < 0.0)
            worst = max(float(np.abs(residual).max()), -float(gap[outside].min(initial=0.0)))
            if worst <= tolerance:
                return pressure
            steepest = np.where(contact, self._precondition(residual), 0.0)
            measure = float(residual @ steepest)
            direction = steepest + np.where(contact, measure / previous * direction, 0.0)
            image = self.kernel.displacement(direction)
            self.products += 2
            length = float(residual @ direction) / max(float(direction @ image), 1e-300)
            pressure = np.maximum(pressure - length * direction, 0.0)
            pressure[outside] = -gap[outside] / self.kernel.influence[0]
            changed = np.any((pressure > 0.0) != contact)
            previous = np.inf if changed else measure
            gap = self._gap(pressure, approach)
        return self._pivot(pressure > 0.0, approach, tolerance)

    def _gap(self, pressure: Floats, approach: Floats) -> Floats:
        self.products += 1
        return self.kernel.displacement(pressure) - approach

    def _precondition(self, residual: Floats) -> Floats:
        spectrum = np.fft.rfft(residual) * self._preconditioner
        return np.fft.irfft(spectrum, n=self.size)

    def _pivot(self, contact: Flags, approach: Floats, tolerance: float) -> Floats:
        """Block principal pivoting, with Murty's single pivots when blocks make no progress."""
        contact = contact.copy()
        fewest, patience = self.size + 1, _PATIENCE
        for _ in range(_MAX_PIVOTS):
            self.pivots += 1
            pressure = self._dense(contact, approach)
            gap = self._gap(pressure, approach)
            wrong = (contact & (pressure < 0.0)) | (self._present & ~contact & (gap < -tolerance))
            count = int(np.count_nonzero(wrong))
            if count == 0:
                return pressure
            if count < fewest:
                fewest, patience = count, _PATIENCE
            else:
                patience -= 1
            if patience < 0:
                last = int(np.flatnonzero(wrong)[-1])
                wrong = np.zeros_like(wrong)
                wrong[last] = True
            contact ^= wrong
        raise InputError(
            f"the contact problem was not solved in {_MAX_ITERATIONS} iterations and "
            f"{_MAX_PIVOTS} pivots; use a smoother profile or other elements"
        )

    def _dense(self, contact: Flags, approach: Floats) -> Floats:
        """Pressure (element,) on a given contact by a dense solve."""
        index = np.flatnonzero(contact)
        pressure = np.zeros(self.size)
        if index.size:
            distance = np.abs(index[:, None] - index)
            try:
                factor = cho_factor(self.kernel.influence[distance])
            except LinAlgError:
                raise InputError(self.limit) from None
            pressure[index] = cho_solve(factor, approach[index])
        return pressure

"""What a search may cost: elements of the systems that were solved, so that every machine stops alike."""

from dataclasses import dataclass

# Somewhat more than a second of a processor of 2020; a usual set of sweeps needs a tenth.
_MOST = 40_000_000


@dataclass(slots=True)
class Work:
    """Elements (rows times columns) of all least-squares systems that were solved so far.

    ``is_cut`` tells whether something was not looked for because of them.
    """

    spent: int = 0
    is_cut: bool = False

    def goes_on(self, times: int = 1) -> bool:
        """Tell whether something further may be looked for; asked only where there is something.

        ``times`` two asks whether all that was done may be done again.
        """
        is_over = times * self.spent > _MOST
        self.is_cut = self.is_cut or is_over
        return not is_over

"""Linear viscoelastic materials: Prony series, interconversion, master curves, library."""

from typing import TYPE_CHECKING

from labpipe.installation import lazily

if TYPE_CHECKING:
    from labpipe.materials._fem_export import (
        CODES as CODES,
        Bulk as Bulk,
        Deck as Deck,
        deck_text as deck_text,
        make_deck as make_deck,
    )
    from labpipe.materials._response import respond as respond
    from labpipe.materials._shift_law import (
        ShiftLaw as ShiftLaw,
        arrhenius as arrhenius,
        shift_at as shift_at,
        wlf as wlf,
    )
    from labpipe.materials._specimen import form_factor as form_factor
    from labpipe.materials._step_tests import with_responses as with_responses
    from labpipe.materials.library import (
        Material as Material,
        Solid as Solid,
        Thermal as Thermal,
        describe as describe,
        load as load,
        solid as solid,
        thermal as thermal,
    )
    from labpipe.materials.prony import (
        Prony as Prony,
        Retardation as Retardation,
        relaxation_from_creep as relaxation_from_creep,
    )
    from labpipe.materials.spectrum import KramersKronig as KramersKronig, kramers_kronig as kramers_kronig
    from labpipe.materials.superposition import (
        MasterCurve as MasterCurve,
        gather_sweeps as gather_sweeps,
        isothermal_runs as isothermal_runs,
        loading_of as loading_of,
        master_curve as master_curve,
        modulus_factor as modulus_factor,
        trusted_rows as trusted_rows,
        uncertain_spectra as uncertain_spectra,
    )
else:
    __getattr__ = lazily(__name__)

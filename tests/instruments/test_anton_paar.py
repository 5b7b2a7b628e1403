"""Anton Paar exports: every locale and form gives the same numbers; what is written is read."""

import io
import json
import re
import warnings
from pathlib import Path

import numpy as np
import openpyxl
import pytest

import instruments
from instruments import anton_paar
from instruments.anton_paar import assemble
from tests.faults import seeds

SAMPLES = Path(__file__).parents[2] / "../shared/samples/rheocompass"

ROWS = [
    ["1", "62.83", "2.5012E+09", "1.2500E+08", "0.050", "25.01", "0.010", "TruStrain™"],
    ["2", "6.283", "2.4000E+09", "1.1000E+08", "0.046", "25.02", "0.010", "ME-,taD"],
    ["3", "0.6283", "2.3001E+09", "9.9000E+07", "0.043", "25.00", "0.010", ""],
]

LABELS = {
    "en": ("Project:", "Test:", "Result:", "Interval and data points:", "Interval data:"),
    "de": ("Projekt:", "Versuch:", "Ergebnis:", "Abschnitt und Datenpunkte:", "Abschnittsdaten:"),
    "fr": ("Projet:", "Test:", "Résultat:", "Intervalle et points de données:", "Intervalle données:"),
}


def columns_of(text):
    return text.split("|")


ENGLISH = columns_of(
    "Point No.|Angular Frequency|Storage Modulus|Loss Modulus|Loss Factor|Temperature|Shear Strain|Status"
)
UNITS = columns_of("|[rad/s]|[Pa]|[Pa]|[1]|[°C]|[%]|")
GERMAN = columns_of(
    "Punkt-Nr.|Kreisfrequenz|Speichermodul|Verlustmodul|Verlustfaktor|Temperatur|Scherdeformation|Status"
)
FRENCH = columns_of(
    "Point No.|Fréquence angulaire|Module de Stockage|Module de Perte|Facteur de perte|Température|"
    "Déformation de cisaillement|Etat"
)
CHINESE = columns_of("Point No.|角频率|储能模量|损耗模量|损耗因子|温度|Shear Strain|Status")


def rheocompass(rows=ROWS, columns=ENGLISH, units=UNITS, language="en", delimiter="\t", declared=None):
    labels = LABELS[language]
    lines = [
        [labels[0], "Sweep | PC, 2/27/2020 | 2"],
        [],
        [labels[1], "sample A 25C"],
        [],
        [labels[2], "Frequency sweep 1"],
        [],
        [labels[3], "1", str(len(rows) if declared is None else declared)],
        [labels[4], *columns],
        ["", *[""] * len(columns)],
        ["", *units],
        *(["", *row] for row in rows),
    ]

    def joined(cells):
        return delimiter.join(f'"{c}"' if delimiter == "," and "," in c else c for c in cells)

    return "\r\n".join(map(joined, lines)) + "\r\n"


def read_text(folder, text, encoding="utf-16", **options):
    path = folder / "export.csv"
    path.write_bytes(text.encode(encoding))
    return anton_paar.read(path, **options)


def assert_is_the_sweep(found):
    assert found.sizes["sample"] == 3
    np.testing.assert_allclose(found.angular_frequency, [62.83, 6.283, 0.6283], rtol=1e-12)
    np.testing.assert_allclose(found.frequency * 2 * np.pi, found.angular_frequency, rtol=1e-12)
    np.testing.assert_allclose(found.storage_modulus, [2.5012e9, 2.4e9, 2.3001e9], rtol=1e-12)
    np.testing.assert_allclose(found.loss_modulus, [1.25e8, 1.1e8, 9.9e7], rtol=1e-12)
    np.testing.assert_allclose(found.strain, [1e-4] * 3, rtol=1e-12)
    np.testing.assert_allclose(found.temperature, [25.01, 25.02, 25.00])
    assert found.status.values.tolist() == ["TruStrain™", "ME-,taD", ""]
    assert found.storage_modulus.attrs["units"] == "Pa"
    assert found.point.values.tolist() == [1, 2, 3]


def commas(rows):
    return [[c if i == 7 else c.replace(".", ",") for i, c in enumerate(row)] for row in rows]


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8", "utf-8-sig", "cp1252"])
@pytest.mark.parametrize("delimiter", ["\t", ";", ","])
def test_every_codec_and_delimiter_gives_the_same_numbers(tmp_path, encoding, delimiter):
    assert_is_the_sweep(read_text(tmp_path, rheocompass(delimiter=delimiter), encoding))


@pytest.mark.parametrize(("language", "columns"), [("en", ENGLISH), ("de", GERMAN), ("fr", FRENCH), ("en", CHINESE)])
@pytest.mark.parametrize("rows", [ROWS, commas(ROWS)], ids=["dot", "comma"])
def test_every_language_and_decimal_sign_gives_the_same_numbers(tmp_path, language, columns, rows):
    found = read_text(tmp_path, rheocompass(rows, columns, language=language))
    assert_is_the_sweep(found)
    (entry,) = json.loads(found.attrs["tests"])
    assert entry["test_name"] == "sample A 25C"
    assert entry["result_name"] == "Frequency sweep 1"


def book_of(text, kept=""):
    """Save a text as a workbook: its numbers as numbers, but those with ``kept`` as texts with a decimal comma."""
    book, made = openpyxl.Workbook(), io.BytesIO()
    for line in text.split("\r\n"):
        cells = [c.replace(".", ",") if kept and kept in c else c for c in line.split("\t")]
        book.active.append([float(c) if re.fullmatch(r"[\d.]+(E[+-]\d+)?", c) else c or None for c in cells])
    book.save(made)
    return made.getvalue()


@pytest.mark.parametrize("kept", ["", "E+"])
def test_a_workbook_gives_the_same_numbers(tmp_path, kept):
    (tmp_path / "export.xlsx").write_bytes(book_of(rheocompass(), kept))
    assert instruments.identify(tmp_path / "export.xlsx") == "anton_paar"
    assert_is_the_sweep(anton_paar.read(tmp_path / "export.xlsx"))


def test_a_clipped_loss_factor_is_recomputed_only_from_a_real_storage_modulus(tmp_path):
    rows = [list(r) for r in ROWS]
    rows[0][4] = "20000.000"  # G' is a reading
    rows[1][2], rows[1][3], rows[1][4] = "1.0000E-03", "20.000", "20000.000"  # G' made from it
    found = read_text(tmp_path, rheocompass(rows))
    np.testing.assert_allclose(found.loss_factor[0], 1.25e8 / 2.5012e9)
    assert np.isnan(found.loss_factor[1])
    assert found.is_clipped.values.tolist() == [1, 1, 0]


@pytest.mark.parametrize("mark", ["(invalid)", "(invalide)", "(ungültig)", "(inválido)"])
def test_an_invalid_point_is_nan_and_keeps_its_row(tmp_path, mark):
    rows = [list(r) for r in ROWS]
    rows[1][0] = f"2 {mark}"
    found = read_text(tmp_path, rheocompass(rows))
    assert found.is_valid.values.tolist() == [1, 0, 1]
    assert np.isnan(found.storage_modulus.values).tolist() == [False, True, False]


MEASUREMENTS = ("freqsweep.csv", "multiple_relaxation.csv", "multiple_relaxation.xlsx", "viscosity_curves.csv")


@pytest.mark.parametrize("name", MEASUREMENTS)
def test_real_files_read_without_a_warning(name):
    if not (SAMPLES / name).is_file():
        pytest.skip("the real files lie outside the project")
    found = instruments.read(SAMPLES / name)
    entries = json.loads(found.attrs["tests"])
    assert sum(e["rows"] for e in entries) == found.sizes["sample"]
    assert all(e["rows"] == e["declared"] for e in entries)


def test_a_written_export_is_read(tmp_path):
    intervals = seeds.anton_paar_intervals()
    made = assemble(intervals)
    anton_paar.write(tmp_path / "x.csv", intervals, "p | x | 1")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = anton_paar.read(tmp_path / "x.csv")
    assert found.attrs["tests"] == made.attrs["tests"]
    assert found.attrs["project"] == "p | x | 1"
    for name in made.variables:
        if made[name].dtype.kind in "fi":
            np.testing.assert_allclose(found[name], made[name], rtol=1e-12)
        else:
            assert found[name].values.tolist() == made[name].values.tolist()

"""Tables as programs and laboratories write them: every layout gives the numbers that it was made of."""

# ruff: noqa: E501 (a layout is seen best on one line)

import warnings

import numpy as np
import openpyxl
import pytest

import instruments
from labpipe.errors import SourceError
from tests.instruments.tables_of_sweeps import (
    ALL,
    DELTA,
    FREQUENCY,
    LOSS,
    OMEGA,
    SIZE,
    STORAGE,
    TAN,
    TEMPERATURE,
    F,
    T,
    assert_is_the_truth,
    read,
    table,
)

DE = {"sep": ";", "decimal": ","}
LAYOUTS = {
    "units in the names": table("freq_hz,G_storage_pa,G_loss_pa,temperature_C", F, STORAGE, LOSS, T),
    "units in brackets": table("Frequency (Hz),E' (MPa),E'' (MPa),Temperature (°C)", *ALL),
    "units behind a slash": table("f/Hz\tE'/MPa\tE''/MPa\tT/°C", *ALL, sep="\t"),
    "a row of units": table("f,E_stor,E_loss,T\nHz, MPa, MPa, C", *ALL),
    "blanks": table("omega  Gp  Gpp  T\nrad/s  Pa  Pa  C", OMEGA, STORAGE, LOSS, T, sep="   "),
    "decimal comma": table("Frequenz [Hz]\tSpeichermodul [MPa]\tVerlustmodul [MPa]\tTemperatur [°C]", *ALL, sep="\t", decimal=","),
    "powers of ten with a comma": table("f (Hz);E' (Pa);E'' (Pa);T (°C)", F, STORAGE, LOSS, T, sep=";", decimal=",", form=".13e"),
    "size and degrees": table("omega,|E*| (MPa),delta_deg,T_C", OMEGA, SIZE / 1e6, np.rad2deg(DELTA), T),
    "viscosities": table("omega (rad/s),eta' (Pa.s),eta'' (Pa.s),T (C)", OMEGA, LOSS / OMEGA, STORAGE / OMEGA, T),
    "lines above": "Sample: NBR 70\nOperator\tA. B.\nDate: 3/6/2020 14:02\n\n" + table("f (Hz),E' (MPa),E'' (MPa),T (°C)", *ALL),
    "times of day": table("Datum;Uhrzeit;f (Hz);E' (MPa);E'' (MPa);T (°C)", *ALL, **DE).replace("\n0", "\n06.03.2021;14:02:11,5;0").replace("\n1", "\n06.03.2021;14:02:11,5;1").replace("\n3", "\n06.03.2021;14:02:11,5;3"),
    "French": table("Fréquence (Hz);Température (°C);Module de conservation (MPa);Module de perte (MPa)", F, T, *ALL[1:3], **DE),
    "Japanese in wide letters": table("周波数（Hz）,温度（℃）,貯蔵弾性率（MPa）,損失弾性率（MPa）", F, T, *ALL[1:3]),
    "both frequencies": table("Freq (Hz),Freq (rad/s),E' (MPa),E'' (MPa),T (C)", F, OMEGA, *ALL[1:]),
    "RheoWin": table("f in Hz;ω in rad/s;G' in Pa;G\" in Pa;|G*| in Pa;δ in °;T in °C", F, OMEGA, STORAGE, LOSS, SIZE, np.rad2deg(DELTA), T, **DE),
    "Eplexor": table("Nr.;f[Hz];E'[MPa];E''[MPa];T[°C]", np.arange(F.size), *ALL, **DE),
    "ARES": table(" [page 1]\n\tFreq\tG'\tG''\tTemp\n\t[rad/s]\t[Pa]\t[Pa]\t[°C]", np.full(F.size, np.nan), OMEGA, STORAGE, LOSS, T, sep="\t").replace("nan", ""),
    "Universal Analysis": "Instrument\tDMA Q800 V21.1\nNsig\t4\nSig1\tFrequency (Hz)\nSig2\tStorage Modulus (MPa)\nSig3\tLoss Modulus (MPa)\nSig4\tTemperature (°C)\nDate\t01-Jan-2020\n" + table("StartOfData", *ALL, sep="\t"),
    "Netzsch": "#EXPORTTYPE:DATA ALL\n#FILE:a.ngb-dm2\n#DECIMAL:POINT\n#SEPARATOR:SEMICOLON\n#SAMPLE:PP\n\n" + table("##Temp./°C;Time/min;Freq./Hz;E'/MPa;E\"/MPa;tan d", T, F, F, *ALL[1:3], TAN, sep=";"),
    "Mettler": "Curve Name:\n    [1]DMA, 01.02.2020\nCurve Values:\n" + table("  Index        t       Ts       Tr        F       M'      M''   Tan Delta\n              [s]     [°C]     [°C]     [Hz]    [MPa]    [MPa]      []", np.arange(F.size), F, T, T, *ALL[:3], TAN, sep="    "),
    "RepTate": "\n".join(f"T={t:g};Mw=94.9;chem=PI;\n" + table("w G' G''", OMEGA[t == T], STORAGE[t == T], LOSS[t == T], sep=" ") for t in TEMPERATURE),
    "a table per frequency": "\n".join(f"Frequency  {at:.12g} Hz\nCurve Values:\n" + table("  Index   Ts   M'   M''\n          [°C]   [MPa]   [MPa]", np.arange(3), TEMPERATURE, STORAGE[at == F] / 1e6, LOSS[at == F] / 1e6, sep="   ") for at in FREQUENCY),
    "a table per temperature": "\n".join(f"Temperature: {t:g} °C\n" + table("f (Hz),E' (MPa),E'' (MPa)", F[t == T], STORAGE[t == T] / 1e6, LOSS[t == T] / 1e6) for t in TEMPERATURE),
    "temperatures side by side": table("f (Hz)," + ",".join(f"E' @ {t:g} °C (MPa),E'' @ {t:g} °C (MPa)" for t in TEMPERATURE), FREQUENCY, *(part[t == T] / 1e6 for t in TEMPERATURE for part in (STORAGE, LOSS))),
    "frequencies side by side": table("T (°C)," + ",".join(f"E'({f:.10f} Hz)/MPa" for f in FREQUENCY) + "," + ",".join(f"tan d({f:.10f} Hz)" for f in FREQUENCY), TEMPERATURE, *(STORAGE[np.isclose(F, f)] / 1e6 for f in FREQUENCY), *(TAN[np.isclose(F, f)] for f in FREQUENCY)),
}  # fmt: skip


@pytest.mark.parametrize("name", LAYOUTS)
def test_every_layout_gives_the_truth(tmp_path, name):
    assert_is_the_truth(read(tmp_path, LAYOUTS[name]))
    if name == "units in brackets":
        for encoding in ("utf-8-sig", "utf-16", "cp1252"):
            assert_is_the_truth(read(tmp_path, LAYOUTS[name], encoding))


@pytest.mark.parametrize(
    "title", ["--- {t:g} °C ---", "Solltemperatur;{t:g};°C", "T = {t:g} °C", "Isotherm 1: {t:g} ± 0.1 °C",
              "[step]\nSweep {t:g} °C"],
)  # fmt: skip
def test_a_title_states_the_temperature_with_its_sign(tmp_path, title):
    def blocks():
        for t in TEMPERATURE:
            columns = (F[t == T], STORAGE[t == T] / 1e6, LOSS[t == T] / 1e6)
            yield title.format(t=t - 40) + "\n" + table("f [Hz];E' [MPa];E'' [MPa]", *columns, sep=";")

    for text in ("\n".join(blocks()), "\n".join(blocks()).replace("-2", "\N{MINUS SIGN}2")):
        found = read(tmp_path, text)
        assert_is_the_truth(found.assign(temperature=found.temperature + 40))


@pytest.mark.parametrize(
    "line",
    ["Specimen cured at 120 °C", "Room temperature: 23 °C", "Reference temperature 20 °C", "Iso, 3 °C to 20 °C"],
)  # fmt: skip
def test_the_temperature_of_something_else_is_left(tmp_path, line):
    text = line + "\n" + table("f (Hz),E' (MPa),E'' (MPa)", F, STORAGE / 1e6, LOSS / 1e6)
    assert "temperature" not in read(tmp_path, text)


def test_each_curve_has_the_temperatures_to_its_left(tmp_path):
    head = "\t".join(f"##Temp./°C\tE'({f:.10f} Hz)/MPa\ttan d({f:.10f} Hz)" for f in FREQUENCY)
    columns = [c for k, f in enumerate(FREQUENCY) for c in (TEMPERATURE + k, STORAGE[f == F] / 1e6, TAN[f == F])]
    found = read(tmp_path, table(head, *columns, sep="\t"))
    for k, f in enumerate(FREQUENCY):
        is_its = found.frequency.values.round(9) == round(f, 9)
        assert found.temperature.values[is_its] == pytest.approx(TEMPERATURE + k)


def workbook(path, sheets):
    book = openpyxl.Workbook()
    book.remove(book.active)
    for title, rows in sheets.items():
        sheet = book.create_sheet(title)
        for row in rows:
            sheet.append(row)
    book.save(path)
    return path


def test_sheets_of_a_workbook_are_read(tmp_path):
    rows = [[float(v) for v in row] for row in zip(*ALL, strict=True)]
    head = [["f", "E'", "E''", "T"], ["Hz", "MPa", "MPa", "°C"]]
    prose = [["Aim", "Storage modulus and loss modulus over frequency"], ["Operator", "A. B."], ["Gap", 1.0]]
    path = workbook(tmp_path / "a.xlsx", {"Remarks": prose, "DMA": [*head, *rows], "Chart data": [["x"], [1.0]]})
    assert instruments.identify(path) == "plain_table"
    assert_is_the_truth(instruments.read(path))
    one_each = {
        f"{t:g} °C": [["f (Hz)", "E' (MPa)", "E'' (MPa)"], *(r[:3] for r in rows if r[3] == t)] for t in TEMPERATURE
    }
    assert_is_the_truth(instruments.read(workbook(tmp_path / "b.xlsx", one_each)))
    shifts = {"DMA": [*head, *rows], "shifts": [["T (°C)", "log aT"], [20, 1.0], [40, 0.0]]}
    with pytest.warns(UserWarning, match="a table of shift factors among the readings is left out"):
        assert_is_the_truth(instruments.read(workbook(tmp_path / "c.xlsx", shifts)))
    lacking = {"DMA": [["f (Hz)", "E' (MPa)", "T (°C)"], [1.0, 2.0, 20.0]]}
    with pytest.raises(SourceError, match=r"d\.xlsx, sheet DMA:1: found frequency, storage modulus, temperature; no"):
        instruments.read(workbook(tmp_path / "d.xlsx", lacking))


def test_responses_over_time_are_read(tmp_path):
    time = np.geomspace(0.01, 100, 5)
    found = read(tmp_path, table("t,E_relax,T,Set\ns,MPa,C,-", time, 3e3 / (1 + time), 0 * time + 20, 0 * time))
    np.testing.assert_allclose(found.time, time, rtol=1e-9)
    np.testing.assert_allclose(found.relaxation_modulus, 3e9 / (1 + time), rtol=1e-9)
    found = read(tmp_path, table("time_min;J(t) [1/GPa]", time / 60, 1 + time, sep=";"))
    np.testing.assert_allclose(found.creep_compliance, 1e-9 * (1 + time), rtol=1e-9)
    found = read(tmp_path, "T=25;Mw=100;gamma=0.1;chem=PS;\n" + table("t\tGt", time, 1e6 + time, sep="\t"))
    np.testing.assert_allclose(found.relaxation_modulus, 1e6 + time, rtol=1e-9)


@pytest.mark.parametrize(
    "text",
    ["T,log_aT\nC, -\n40,-1.5\n20,0\n", "T,aT\nC,-\n40,0.0316227766\n20,1\n", "T,ln aT\nC,1\n40,-3.45387764\n20,0\n"],
)
def test_shift_factors_become_decimal_logarithms(tmp_path, text):
    found = read(tmp_path, text)
    np.testing.assert_allclose(found.log10_aT, [-1.5, 0.0], atol=1e-8)
    np.testing.assert_allclose(found.temperature, [40.0, 20.0])


def test_columns_that_agree_are_no_contradiction(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert_is_the_truth(read(tmp_path, table("f (Hz),E' (MPa),E'' (MPa),T (°C),Temp (°C)", *ALL, T)))
    with pytest.warns(UserWarning, match=r"two columns hold temperature and differ; the first, T \(°C\), is taken"):
        assert_is_the_truth(read(tmp_path, table("f (Hz),E' (MPa),E'' (MPa),T (°C),Temp (°C)", *ALL, T + 1)))
    head = "f (Hz),E' (MPa),E'' (MPa),Temp1 (C),K* (N/m),E* (MPa),E' std (MPa)"
    assert_is_the_truth(read(tmp_path, table(head, *ALL, SIZE / 1e3, SIZE / 1e6, SIZE / 1e8)))


@pytest.mark.parametrize("line", ["x,y,z", "Time,Temperature", "T,E", "Time, s\tPosition (z), mm\tFz, N"])
def test_other_tables_are_not_claimed(tmp_path, line):
    (tmp_path / "a.txt").write_text(line + "\n1\t2\t3\n")
    with pytest.raises(SourceError, match="no instrument recognises"):
        instruments.identify(tmp_path / "a.txt")


def test_a_unit_of_millipascal_is_noted(tmp_path):
    with pytest.warns(UserWarning, match="moduli are in mPa, which is read as MPa"):
        assert_is_the_truth(read(tmp_path, table("f (Hz),E' (mPa),E'' (mPa),T (°C)", *ALL)))

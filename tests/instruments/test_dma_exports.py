"""Exports in which something stands where a reader does not expect it: right numbers, or a refusal in words."""

import openpyxl
import pytest

import instruments
from instruments import anton_paar
from labpipe.errors import SourceError
from tests.instruments.test_table_layouts import (
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
)  # fmt: skip

SHIFTED = TEMPERATURE - 40.0  # temperatures below zero too


def blocks(title, head="f [Hz];E' [MPa];E'' [MPa]"):
    """Write a table per temperature below a title."""
    parts = (
        title.format(t=t - 40) + "\n" + table(head, F[t == T], STORAGE[t == T] / 1e6, LOSS[t == T] / 1e6, sep=";")
        for t in TEMPERATURE
    )
    return "\n".join(parts)


@pytest.mark.parametrize(
    "title",
    ["{t:g} °C", "--- {t:g} °C ---", "Isotherm 2 ({t:g} °C)", "Frequency sweep, {t:g}°C", "Solltemperatur;{t:g};°C",
     "Temperature,{t:g},°C", "T = {t:g} °C", "### {t:g} °C", "Isotherm 1: {t:g} ± 0.1 °C", "Sweep at {t:g} C"],
)  # fmt: skip
def test_a_title_states_the_temperature_with_its_sign(tmp_path, title):
    found = read(tmp_path, blocks(title))
    assert_is_the_truth(found.assign(temperature=found.temperature + 40))
    found = read(tmp_path, blocks(title).replace("-", "\N{MINUS SIGN}").replace("\N{MINUS SIGN}" * 3, "---"))
    assert_is_the_truth(found.assign(temperature=found.temperature + 40))


@pytest.mark.parametrize(
    "title", ["Reference temperature {t:g} °C", "Temp. ramp from {t:g} °C", "Iso, 3 °C to {t:g} °C"]
)
def test_another_temperature_in_a_title_is_not_that_of_the_sweep(tmp_path, title):
    assert "temperature" not in read(tmp_path, blocks(title))


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
    path = workbook(tmp_path / "a.xlsx", {"Remarks": [["measured by A. B."]], "DMA": [*head, *rows]})
    assert instruments.identify(path) == "plain_table"
    assert_is_the_truth(instruments.read(path))
    one_each = {
        f"{t:g} °C": [["f (Hz)", "E' (MPa)", "E'' (MPa)"], *(r[:3] for r in rows if r[3] == t)] for t in TEMPERATURE
    }
    assert_is_the_truth(instruments.read(workbook(tmp_path / "b.xlsx", one_each)))
    shifts = {"DMA": [*head, *rows], "shifts": [["T (°C)", "log aT"], [20, 1.0], [40, 0.0]]}
    with pytest.warns(UserWarning, match="a table of shift factors beside the readings is left out"):
        assert_is_the_truth(instruments.read(workbook(tmp_path / "c.xlsx", shifts)))


def test_a_fault_in_a_workbook_is_told_with_its_sheet(tmp_path):
    path = workbook(tmp_path / "a.xlsx", {"DMA": [["f (Hz)", "E' (MPa)", "T (°C)"], [1.0, 2.0, 20.0]]})
    with pytest.raises(
        SourceError, match=r"a\.xlsx, sheet DMA:1: found frequency, storage modulus, temperature; no loss"
    ):
        instruments.read(path)
    (tmp_path / "a.xls").write_bytes(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600))
    with pytest.raises(SourceError, match=r"save it as \.xlsx or as CSV"):
        instruments.read(tmp_path / "a.xls")


def test_specimens_side_by_side_are_not_taken_for_one(tmp_path):
    head = "#EXPORTTYPE:\tDATA COMPARE\tDATA COMPARE\n#SAMPLE:\tA\tB\n\n" + "\t".join(
        ["##Temp./°C\tE'(1.0 Hz)/MPa\ttan d(1.0 Hz)"] * 2
    )
    one = STORAGE[F == 1.0] / 1e6, TAN[F == 1.0]
    text = table(head, TEMPERATURE, *one, TEMPERATURE, 2 * one[0], one[1], sep="\t")
    with pytest.raises(SourceError, match="as of several specimens") as caught:
        read(tmp_path, text)
    columns = caught.value.hint.partition('columns="')[2].partition('"')[0]
    assert columns.endswith("-, -, -")
    assert read(tmp_path, text, columns=columns).storage_modulus.values == pytest.approx(STORAGE[F == 1.0], rel=1e-9)


def test_each_curve_has_the_temperatures_to_its_left(tmp_path):
    head = "\t".join(f"##Temp./°C\tE'({f:.10f} Hz)/MPa\ttan d({f:.10f} Hz)" for f in FREQUENCY)
    columns = [c for k, f in enumerate(FREQUENCY) for c in (TEMPERATURE + k, STORAGE[f == F] / 1e6, TAN[f == F])]
    found = read(tmp_path, table(head, *columns, sep="\t"))
    for k, f in enumerate(FREQUENCY):
        assert found.temperature.values[found.frequency.values.round(9) == round(f, 9)] == pytest.approx(
            TEMPERATURE + k
        )


def test_a_vague_modulus_is_asked_for(tmp_path):
    with pytest.raises(SourceError, match="may be the storage modulus or the complex one") as caught:
        read(tmp_path, table("f (Hz),T (°C),Modulus (MPa),phase (°)", F, T, SIZE / 1e6, DELTA))
    assert "Modulus (MPa)" in caught.value.hint


def test_rows_of_frequency_zero_are_no_readings(tmp_path):
    with pytest.warns(UserWarning, match="2 of 14 rows have a frequency of zero or below"):
        found = read(tmp_path, table("f (Hz),E' (MPa),E'' (MPa),T (°C)", *ALL) + "0,0,0,0\n-2,0,0,0\n")
    assert_is_the_truth(found.isel(sample=found.is_valid.values == 1))


@pytest.mark.parametrize(
    "names",
    [
        ("Frecuencia angular", "Temperatura", "Módulo de almacenamiento", "Módulo de pérdida"),
        ("角频率", "温度", "储能模量", "损耗模量"),
        ("Angular Frequency", "Temperature", "Young's Storage Modulus", "Young's Loss Modulus"),
    ],
)
def test_words_of_rheocompass_in_other_languages(tmp_path, names):
    lines = ["Project:\tx", "", "Test:\ty", "", "Result:\tz", "", f"Interval and data points:\t1\t{F.size}"]
    lines += ["\t".join(["Interval data:", "Point No.", *names]), "\t" * 5, "\t\t[rad/s]\t[°C]\t[Pa]\t[Pa]"]
    lines += [
        "\t".join(["", str(k + 1), *(format(v, ".14g") for v in row)])
        for k, row in enumerate(zip(OMEGA, T, STORAGE, LOSS, strict=True))
    ]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(lines) + "\n", "utf-16")
    assert_is_the_truth(instruments.read(path))
    text = "\n".join(lines).replace(names[2], "Complex Shear Modulus").replace(names[3], "Phase Shift Angle")
    bare = text.replace("[Pa]\t[Pa]", "[Pa]\t[rad]").split("\n")
    rows = [
        "\t".join(["", str(k + 1), *(format(v, ".14g") for v in row)])
        for k, row in enumerate(zip(OMEGA, T, SIZE, DELTA, strict=True))
    ]
    path.write_text("\n".join([*bare[: -F.size], *rows]) + "\n", "utf-16")
    assert_is_the_truth(anton_paar.read(path))


def test_the_temperature_nearest_to_the_table_counts(tmp_path):
    found = read(tmp_path, "Temperature: 25 °C\nHumidity: 50 %\n\n" + blocks("Sweep at {t:g} °C"))
    assert_is_the_truth(found.assign(temperature=found.temperature + 40))


@pytest.mark.parametrize(
    "line",
    [
        "Specimen cured at 120 °C",
        "Stored at 23 °C / 50 % RH",
        "Room temperature: 23 °C",
        "Glass transition at 105 °C",
        "End temperature: 23 °C",
    ],
)
def test_a_temperature_of_something_else_is_left(tmp_path, line):
    assert "temperature" not in read(
        tmp_path, line + "\n" + table("f (Hz),E' (MPa),E'' (MPa)", F, STORAGE / 1e6, LOSS / 1e6)
    )


@pytest.mark.parametrize(
    ("head", "columns", "message"),
    [
        ("f (Hz),E' (MPa),E'' (MPa),T (°C),tan δ", (*ALL, 1.5 * TAN), "loss modulus of E' .* and tan δ is 1.5 times"),
        ("f (Hz),E' (MPa),E'' (MPa),T (°C),|E*| (GPa)", (*ALL, SIZE / 1e6), "is 1e.03 times the size of E' "),
        ("f (Hz),E' (MPa),E'' (MPa),T (°C),ω (rad/s)", (*ALL, F), "ω .rad/s. is 0.159 times 2π f "),
        ("f (Hz),E' (mPa),E'' (MPa),T (°C)", ALL, "E' .mPa. is in mPa, which is read as MPa"),
    ],
)  # fmt: skip
def test_columns_that_do_not_agree_are_told(tmp_path, head, columns, message):
    with pytest.warns(UserWarning, match=message):
        assert_is_the_truth(read(tmp_path, table(head, *columns)))


def test_several_specimens_in_a_table_are_told(tmp_path):
    text = "Sample," + table("f (Hz),E' (MPa),E'' (MPa),T (°C)", *ALL).replace("\n", "\nA,", 6).replace("\n0", "\nB,0")
    rows = text.split("\n")
    rows = [rows[0], *(row if row[:1] in "AB" else "B," + row for row in rows[1:-1])]
    with pytest.warns(UserWarning, match="Sample names 2 specimens"):
        assert_is_the_truth(read(tmp_path, "\n".join(rows) + "\n"))


def test_a_header_that_states_the_decimal_sign_is_believed(tmp_path):
    head = "#FORMAT:NETZSCH5\n#DECIMAL:COMMA\n#SEPARATOR:SEMICOLON\n\n##Temp./°C;Freq./Hz;E'/MPa;E\"/MPa\n"
    found = read(tmp_path, head + "20,000;1,000;950,125;45,125\n")
    assert found.storage_modulus.values == pytest.approx([950.125e6])


def test_powers_of_ten_and_frequencies_in_millihertz(tmp_path):
    rows = "".join(
        f"10⁻¹;{t:g};{s / 1e8:.12f}·10⁸;{g / 1e7:.12f}×10⁷\n" for t, s, g in zip(T, STORAGE, LOSS, strict=True)
    )
    found = read(tmp_path, "f (Hz);T (°C);E' (Pa);E'' (Pa)\n" + rows)
    assert found.storage_modulus.values == pytest.approx(STORAGE, rel=1e-9)
    assert found.frequency.values == pytest.approx(0.1)
    wide = table("T (°C);E'(100 mHz)/MPa;E''(100 mHz)/MPa", TEMPERATURE, TEMPERATURE, TEMPERATURE, sep=";")
    assert read(tmp_path, wide).frequency.values == pytest.approx(0.1)


def test_means_below_the_readings_are_none(tmp_path):
    text = "Point;" + table("f (Hz);E' (MPa);E'' (MPa);T (°C)", *ALL, sep=";").replace("\n", "\n1;").removesuffix("1;")
    with pytest.warns(UserWarning, match="line.* means or deviations are no readings"):
        assert_is_the_truth(read(tmp_path, text + "Mean;1;900;40;20\nStd.Dev.;0.1;10;2;1\n"))


def test_a_stiffness_beside_the_modulus_is_no_modulus(tmp_path):
    head = "f (Hz),E' (MPa),E'' (MPa),Temp1 (C),K* (N/m),E* (MPa)"
    assert_is_the_truth(read(tmp_path, table(head, *ALL, SIZE / 1e3, SIZE / 1e6)))


@pytest.mark.parametrize("gap", [";", ""])
@pytest.mark.parametrize("sep", [";", "\t"])
def test_isotherms_side_by_side_keep_their_temperatures(tmp_path, gap, sep):
    """Columns of nothing between them are columns too."""
    parts = [[FREQUENCY, STORAGE[t == T] / 1e6, LOSS[t == T] / 1e6] for t in TEMPERATURE]
    above = (";;;" + gap).join(f"T = {t - 40:g} °C" for t in TEMPERATURE)
    head = (";" + gap).join(["f (Hz);E' (MPa);E'' (MPa)"] * len(parts))
    rows = [
        (";" + gap).join(";".join(repr(float(c[k])) for c in part) for part in parts) for k in range(FREQUENCY.size)
    ]
    found = read(tmp_path, "\n".join([above, head, *rows]).replace(";", sep) + "\n")
    assert_is_the_truth(found.assign(temperature=found.temperature + 40))


def test_titles_in_fahrenheit_and_frequencies_without_brackets(tmp_path):
    parts = (
        f"Sweep at {1.8 * t + 32:g} °F\n"
        + table("f (Hz);E' (MPa);E'' (MPa)", FREQUENCY, STORAGE[t == T] / 1e6, LOSS[t == T] / 1e6, sep=";")
        for t in TEMPERATURE
    )
    assert_is_the_truth(read(tmp_path, "\n".join(parts)))
    head = ",".join(f"E' {f:.12g} Hz (MPa),tan δ {f:.12g} Hz" for f in FREQUENCY)
    wide = [c for f in FREQUENCY for c in (STORAGE[f == F] / 1e6, TAN[f == F])]
    assert_is_the_truth(read(tmp_path, table("T (°C)," + head, TEMPERATURE, *wide)))


def test_symbols_below_words_are_no_units(tmp_path):
    head = "Frequency;Storage modulus;Loss modulus;Temperature\nf;E';E'';T\nHz;MPa;MPa;°C"
    assert_is_the_truth(read(tmp_path, table(head, *ALL, sep=";")))


def test_means_of_specimens_and_a_loss_factor_in_thousandths(tmp_path):
    columns = (F, STORAGE / 1e6, STORAGE / 1e8, 1e3 * TAN, T)
    assert_is_the_truth(read(tmp_path, table("f (Hz),E' mean (MPa),E' std (MPa),tan δ (10^-3),T (°C)", *columns)))


def test_sets_may_be_named_in_words(tmp_path):
    """A word for several rows is a set; one for each row, as ``1|3`` of segment and point, is none."""
    rows = [
        f"{'ramp' if t == 20 else 'sweep'};{f:.14g};{s:.14g};{b:.14g};{t:g}"
        for f, s, b, t in zip(F, STORAGE, LOSS, T, strict=True)
    ]
    text = "\n".join(["Segment;f (Hz);E' (Pa);E'' (Pa);T (°C)", *rows]) + "\n"
    found = read(tmp_path, text)
    assert_is_the_truth(found)
    assert set(found.interval.values) == {1, 2}
    for name in ("ramp", "sweep"):
        for k in range(F.size):
            text = text.replace(f"\n{name};", f"\n1|{k}{name[0]};", 1)
    found = read(tmp_path, text)
    assert_is_the_truth(found)
    assert set(found.interval.values) == {1}


def test_the_specimens_temperature_counts_before_the_ovens(tmp_path):
    head = "f (Hz),Oven temperature (°C),Sample temperature (°C),E' (Pa),E'' (Pa)"
    assert_is_the_truth(read(tmp_path, table(head, F, T + 5.0, T, STORAGE, LOSS)))
    assert_is_the_truth(read(tmp_path, table("f (Hz),Oven temperature (°C),E' (Pa),E'' (Pa)", F, T, STORAGE, LOSS)))


@pytest.mark.parametrize("title", ["Sweep {k} at {t:g} °C", "[step]\nFreq sweep T={t:g} C", "Test {k}: T = {t:g} °C"])
def test_a_title_in_the_middle_of_words(tmp_path, title):
    parts = (
        title.format(t=t, k=k)
        + "\n"
        + table("f [Hz];E' [Pa];E'' [Pa]", F[t == T], STORAGE[t == T], LOSS[t == T], sep=";")
        for k, t in enumerate(TEMPERATURE)
    )
    assert_is_the_truth(read(tmp_path, "\n".join(parts)))


def test_a_frequency_in_the_title_is_that_of_a_table_without_one(tmp_path):
    parts = (
        f"Temperature sweep at {f:.12g} Hz\n"
        + table("T (°C);E' (Pa);E'' (Pa)", TEMPERATURE, STORAGE[f == F], LOSS[f == F], sep=";")
        for f in FREQUENCY
    )
    assert_is_the_truth(read(tmp_path, "\n".join(parts)))


def test_words_and_counts_below_the_readings_are_none(tmp_path):
    rows = "N;12;12;12\nMax.;1e9;1e8;60\nσ;1;1;1\n"
    with pytest.warns(UserWarning, match="lines 14, 15, 16: rows of means"):
        assert_is_the_truth(
            read(tmp_path, table("f (Hz);E' (Pa);E'' (Pa);T (°C)", F, STORAGE, LOSS, T, sep=";") + rows)
        )


def test_revolutions_and_signs_of_one_letter(tmp_path):
    assert_is_the_truth(read(tmp_path, table("f (rpm),储能模量(㎫),损耗模量(㎫),温度(℃)", 60 * F, *ALL[1:])))


def test_a_sentence_above_a_relaxation_is_no_heading(tmp_path):
    text = "Stress relaxation at T = 298.15 K\n" + table("Time (h)\tE(t) (GPa)", F, LOSS, sep="\t")
    found = read(tmp_path, text)
    assert found.time.values == pytest.approx(3600 * F, rel=1e-12)
    parameters = "T=25;Mw=100;gamma=0.1;chem=PS;\n" + table("t\tGt", F, LOSS, sep="\t")
    assert read(tmp_path, parameters).relaxation_modulus.values == pytest.approx(LOSS, rel=1e-12)

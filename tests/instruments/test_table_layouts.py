"""Tables as laboratories have them: every layout gives the same numbers as the truth it was made of."""

# ruff: noqa: E501 (a layout is seen best on one line)

import json
import warnings

import numpy as np
import pytest

import instruments
from instruments import tables
from labpipe.errors import SourceError

FREQUENCY = np.array([0.1, 1.0, 3.1622776602, 10.0])
TEMPERATURE = np.array([20.0, 40.0, 60.0])
F, T = (grid.ravel() for grid in np.broadcast_arrays(FREQUENCY, TEMPERATURE[:, None]))
OMEGA = 2 * np.pi * F
STORAGE = 1.0e9 * (1 + 0.1 * np.log10(F)) * (1 - 0.008 * (T - 20))
LOSS = STORAGE * (0.05 + 0.002 * (T - 20)) / (1 + 0.02 * F)
TAN = LOSS / STORAGE
SIZE, DELTA = np.hypot(STORAGE, LOSS), np.arctan2(LOSS, STORAGE)


def table(head, *columns, sep=",", decimal=".", form=".14g"):
    """Write lines of headings and rows."""
    rows = (sep.join(format(v, form).replace(".", decimal) for v in row) for row in zip(*columns, strict=True))
    return "\n".join([head, *rows]) + "\n"


def read(folder, text, encoding="utf-8", **options):
    path = folder / "anything.txt"
    path.write_bytes(text.encode(encoding))
    if not options:
        assert instruments.identify(path) == "plain_table"
    return tables.read(path, **options)


def assert_is_the_truth(found, *, has_temperature=True):
    order = np.lexsort((found.frequency.values, found.temperature.values)) if has_temperature else slice(None)
    np.testing.assert_allclose(found.frequency.values[order], F, rtol=1e-9)
    np.testing.assert_allclose(found.storage_modulus.values[order], STORAGE, rtol=1e-9)
    np.testing.assert_allclose(found.loss_modulus.values[order], LOSS, rtol=1e-9)
    if has_temperature:
        np.testing.assert_allclose(found.temperature.values[order], T, rtol=0, atol=1e-9)


ALL = (F, STORAGE / 1e6, LOSS / 1e6, T)
LAYOUTS = {
    "units in the names": table("freq_hz,G_storage_pa,G_loss_pa,temperature_C", F, STORAGE, LOSS, T),
    "units in the names, small letters": table("frequency_hz,storage_modulus_mpa,loss_modulus_mpa,temp_c", *ALL),
    "units in brackets": table("Frequency (Hz),E' (MPa),E'' (MPa),Temperature (°C)", *ALL),
    "units in square brackets": table("f [Hz];E′ [MPa];E″ [MPa];T [°C]", *ALL, sep=";"),
    "units behind a slash": table("f/Hz\tE'/MPa\tE''/MPa\tT/°C", *ALL, sep="\t"),
    "units behind a comma": table("Frequency, Hz; Storage modulus, MPa; Loss modulus, MPa; Temperature, °C", *ALL, sep=";"),
    "units behind the name": table("Frequency Hz,Storage Modulus MPa,Loss Modulus MPa,Temperature C", *ALL),
    "units with in": table("f in Hz;E' in MPa;E'' in MPa;T in K", F, STORAGE / 1e6, LOSS / 1e6, T + 273.15, sep=";"),
    "a row of units": table("f,E_stor,E_loss,T\nHz, MPa, MPa, C", *ALL),
    "a row of units in brackets": table("Freq\tG'\tG\"\tTemp\n[rad/s]\t[Pa]\t[Pa]\t[°C]", OMEGA, STORAGE, LOSS, T, sep="\t"),
    "blanks": table("omega  Gp  Gpp  T\nrad/s  Pa  Pa  C", OMEGA, STORAGE, LOSS, T, sep="   "),
    "blanks, brackets with blanks around": table("Frequency (Hz) E' (MPa) E'' (MPa) Temperature (C)", *ALL, sep=" "),
    "a comment of numpy": table("# f_Hz E1_Pa E2_Pa T_C", F, STORAGE, LOSS, T, sep=" ", form=".18e"),
    "a comment of matlab": table("% f (Hz), E' (MPa), E'' (MPa), T (C)", *ALL, sep=" "),
    "bars": table("| f (Hz) | E' (MPa) | E'' (MPa) | T (°C) |", *ALL, sep=" | "),
    "decimal comma": table("f (Hz);E' (MPa);E'' (MPa);T (°C)", *ALL, sep=";", decimal=","),
    "decimal comma and TAB": table("Frequenz [Hz]\tSpeichermodul [MPa]\tVerlustmodul [MPa]\tTemperatur [°C]", *ALL, sep="\t", decimal=","),
    "decimal comma between blanks": table("f (Hz)  E' (MPa)  E'' (MPa)  T (°C)", *ALL, sep="  ", decimal=","),
    "powers of ten with a comma": table("f (Hz);E' (Pa);E'' (Pa);T (°C)", F, STORAGE, LOSS, T, sep=";", decimal=",", form=".13e"),
    "quoted": table('"f (Hz)","E\' (MPa)","E\'\' (MPa)","T (°C)"', *ALL).replace("\n0", '\n"0"').replace('"0".1', '"0.1"'),
    "storage and tan delta": table("f (Hz),E' (MPa),tan(delta),T (°C)", F, STORAGE / 1e6, TAN, T),
    "loss and tan delta": table("f (Hz),E'' (MPa),tan δ,T (°C)", F, LOSS / 1e6, TAN, T),
    "size and degrees": table("omega,|E*| (MPa),delta_deg,T_C", OMEGA, SIZE / 1e6, np.rad2deg(DELTA), T),
    "size and radian": table("f_Hz,E_star (GPa),phase (rad),T_C", F, SIZE / 1e9, DELTA, T),
    "size and tan delta": table("f_Hz,Complex modulus (GPa),Tan Delta,T_C", F, SIZE / 1e9, TAN, T),
    "compliances": table("f_Hz,D' (1/GPa),D'' (1/GPa),T_C", F, 1e9 * STORAGE / SIZE**2, 1e9 * LOSS / SIZE**2, T),
    "compliance and phase": table("f_Hz,|J*| (1/Pa),phase angle (°),T_C", F, 1 / SIZE, np.rad2deg(DELTA), T, form=".17g"),
    "viscosities": table("omega (rad/s),eta' (Pa.s),eta'' (Pa.s),T (C)", OMEGA, LOSS / OMEGA, STORAGE / OMEGA, T),
    "size of the viscosity": table("ω [rad/s],|η*| [Pa·s],δ [°],T [°C]", OMEGA, SIZE / OMEGA, np.rad2deg(DELTA), T),
    "logarithms": table("log f (Hz),log E' (MPa),log E'' (MPa),T (°C)", np.log10(F), np.log10(STORAGE / 1e6), np.log10(LOSS / 1e6), T),
    "pounds per square inch": table("f (Hz),E' (psi),E'' (psi),T (°F)", F, STORAGE / 6894.757293168361, LOSS / 6894.757293168361, T * 1.8 + 32),
    "dynes": table("f (Hz),G' (dyn/cm2),G'' (dyn/cm2),T (C)", F, STORAGE * 10, LOSS * 10, T),
    "word and symbol": table("Frequency (Hz),Storage Modulus (E') (MPa),Loss Modulus (E'') (MPa),Temperature (°C)", *ALL),
    "a set temperature only": table("Freq. (Hz),Storage Mod. (MPa),Loss Mod. (MPa),Set Temp. (°C)", *ALL),
    "columns of no concern": table("Pt,f (Hz),E' (MPa),E'' (MPa),T (°C),Force (N)", np.arange(F.size), *ALL, F),
    "lines above": "Sample: NBR 70\nOperator\tA. B.\nDate: 3/6/2020 14:02\n\n" + table("f (Hz),E' (MPa),E'' (MPa),T (°C)", *ALL),
    "lines below": table("f (Hz),E' (MPa),E'' (MPa),T (°C)", *ALL) + "\nEnd of data\nmeasured by A. B.\n",
    "names in two rows": table("Frequency,Storage,Loss,Temperature\n,Modulus,Modulus,\nHz,MPa,MPa,C", *ALL),
    "an index without a name": table(",freq_hz,E_stor_MPa,E_loss_MPa,temp_c", np.arange(F.size), *ALL),
    "signs of LaTeX": table("$f$ (Hz),$E'$ (MPa),$E''$ (MPa),$T$ ($^\\circ$C)", *ALL),
    "capitals": table("FREQ (HZ),E' (MPA),E'' (MPA),TEMP (DEG C)", *ALL),
    "a table of markdown": table("| f (Hz) | E' (MPa) | E'' (MPa) | T (°C) |\n|---|---|---|---|", *ALL, sep=" | "),
    "HAAKE RheoWin": table(
        "f in Hz;ω in rad/s;G' in Pa;G\" in Pa;|G*| in Pa;δ in °;T in °C", F, OMEGA, STORAGE, LOSS, SIZE, np.rad2deg(DELTA), T, sep=";", decimal=","
    ),
    "Bohlin": table("Frequency\tElastic Modulus\tViscous Modulus\tTemperature\nHz\tMPa\tMPa\tC", *ALL, sep="\t"),
    "Kinexus": table("Frequency(Hz),Shear modulus (elastic component)(MPa),Shear modulus (viscous component)(MPa),Temperature(°C)", *ALL),
    "Eplexor": table("Nr.;f[Hz];E'[MPa];E''[MPa];T[°C]", np.arange(F.size), *ALL, sep=";", decimal=","),
    "ARES Orchestrator": table(" [page 1]\n\tFreq\tG'\tG''\tTemp\n\t[rad/s]\t[Pa]\t[Pa]\t[°C]", OMEGA, STORAGE, LOSS, T, sep="\t").replace("\n0", "\n\t0").replace("\n6", "\n\t6").replace("\n1", "\n\t1"),
    "Universal Analysis": "Instrument\tDMA Q800 V21.1\nNsig\t4\nSig1\tFrequency (Hz)\nSig2\tStorage Modulus (MPa)\nSig3\tLoss Modulus (MPa)\nSig4\tTemperature (°C)\nDate\t01-Jan-2020\n" + table("StartOfData", *ALL, sep="\t"),
    "Windows": table("f (Hz),E' (MPa),E'' (MPa),T (°C)", *ALL).replace("\n", "\r\n"),
    "a table per temperature": "\n".join(
        f"Temperature: {t:g} °C\n" + table("f (Hz),E' (MPa),E'' (MPa)", F[t == T], STORAGE[t == T] / 1e6, LOSS[t == T] / 1e6)
        for t in TEMPERATURE
    ),
    "temperatures side by side": table(
        "f (Hz)," + ",".join(f"E' @ {t:g} °C (MPa),E'' @ {t:g} °C (MPa)" for t in TEMPERATURE),
        FREQUENCY, *(part[t == T] / 1e6 for t in TEMPERATURE for part in (STORAGE, LOSS)),
    ),
    "temperatures in the line above": table(
        "20 °C,,,40 °C,,,60 °C,,\n" + ",".join(["f (Hz),G' (MPa),G'' (MPa)"] * 3),
        *(part[t == T] for t in TEMPERATURE for part in (F, STORAGE / 1e6, LOSS / 1e6)),
    ),
    "frequencies side by side": table(
        "T (°C)," + ",".join(f"E'({f:.10f} Hz)/MPa" for f in FREQUENCY) + "," + ",".join(f"tan d({f:.10f} Hz)" for f in FREQUENCY),
        TEMPERATURE, *(STORAGE[np.isclose(F, f)] / 1e6 for f in FREQUENCY), *(TAN[np.isclose(F, f)] for f in FREQUENCY),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", LAYOUTS)
def test_every_layout_gives_the_truth(tmp_path, name):
    assert_is_the_truth(read(tmp_path, LAYOUTS[name]))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252", "mac_roman"])
def test_in_every_encoding(tmp_path, encoding):
    assert_is_the_truth(read(tmp_path, LAYOUTS["units in brackets"], encoding))


def reptate(t, order="T={t:g};Mw=94.9;chem=PI;label=PI88k;PDI=1.03;"):
    rows = t == T
    head = order.format(t=t) + "\nFreq\tG'\tG\"\tTemp\tStrain\tTemp\nrad/s\tPa\tPa\t°C\t%\t°C"
    return table(head, OMEGA[rows], STORAGE[rows], LOSS[rows], T[rows], F[rows], T[rows], sep="       ")


def test_a_file_of_reptate_gives_its_temperature(tmp_path):
    found = [read(tmp_path, reptate(t)) for t in TEMPERATURE]
    for name, truth in (("storage_modulus", STORAGE), ("loss_modulus", LOSS), ("temperature", T), ("frequency", F)):
        np.testing.assert_allclose(np.concatenate([part[name].values for part in found]), truth, rtol=1e-9)
    rows = T == 40
    bare = table("Mw=2.4;T=40;PDI=1.09;\nw\tG'\tG''\nrad/s\tPa\tPa", OMEGA[rows], STORAGE[rows], LOSS[rows], sep=" ")
    assert read(tmp_path, bare).temperature.values.tolist() == [40.0] * 4
    without_units = bare.replace("rad/s\tPa\tPa\n", "")
    np.testing.assert_allclose(read(tmp_path, without_units).loss_modulus, LOSS[rows], rtol=1e-9)


def trios(points="Number of points\t4"):
    """Write a file as TRIOS does: many steps, some of them no sweep."""
    head = (
        "Filename\tsweeps\nInstrument name\t5343\nrundate\t3/6/2020\n[File Parameters]\nTrios version\t5.4\n"
        + "note\tx\n" * 900
    )
    steps = ["\n[step]\nAmplitude sweep - 1\nNumber of points\t1\nOscillation strain\tTorque\n%\tµN.m\n0.01\t2.5\n"]
    for k, t in enumerate(TEMPERATURE):
        rows = t == T
        steps.append(
            f"\n[step]\nFrequency sweep - {k + 1}\n{points}\n"
            + table(
                "Storage modulus\tLoss modulus\tTan(delta)\tAngular frequency\tStep time\tTemperature\tRaw phase\n"
                "MPa\tMPa\t\trad/s\ts\t°C\t°",
                STORAGE[rows] / 1e6, LOSS[rows] / 1e6, TAN[rows], OMEGA[rows], F[rows], T[rows], F[rows], sep="\t",
            )
        )  # fmt: skip
    return head + "".join(steps)


def test_the_steps_of_a_trios_file_are_its_sweeps(tmp_path):
    found = read(tmp_path, trios())
    assert_is_the_truth(found)
    assert [entry["result_name"] for entry in json.loads(found.attrs["tests"])] == [
        f"Frequency sweep - {k}" for k in (1, 2, 3)
    ]


def test_the_rows_of_a_trios_file_may_begin_with_words(tmp_path):
    rows = T == 20
    text = "[step]\nFrequency sweep - 1\nNumber of points\t4\nVariables\tStorage modulus\tLoss modulus\tAngular frequency\tTemperature\n"
    text += "Units\tPa\tPa\trad/s\t°C\n"
    cells = zip(STORAGE[rows], LOSS[rows], OMEGA[rows], T[rows], strict=True)
    text += "".join("data point\t" + "\t".join(f"{v:.14g}" for v in row) + "\n" for row in cells)
    found = read(tmp_path, text)
    np.testing.assert_allclose(found.storage_modulus, STORAGE[rows], rtol=1e-9)


def test_an_export_of_netzsch(tmp_path):
    head = "#EXPORTTYPE:DATA ALL\n#FILE:a.ngb-dm2\n#FORMAT:NETZSCH5\n#DECIMAL:POINT\n#SEPARATOR:SEMICOLON\n#MTYPE:DMA\n#SAMPLE:PP\n\n"
    text = head + table(
        "##Temp./°C;Time/min;Freq./Hz;E'/MPa;E\"/MPa;tan d", T, F, F, STORAGE / 1e6, LOSS / 1e6, TAN, sep=";"
    )
    assert_is_the_truth(read(tmp_path, text, "cp1252"))


def test_an_export_of_mettler(tmp_path):
    head = "Curve Name:\n    [1]DMA, 01.02.2020\nCurve Values:\n"
    text = head + table(
        "  Index        t       Ts       Tr        F       M'      M''   Tan Delta\n"
        "              [s]     [°C]     [°C]     [Hz]    [MPa]    [MPa]      []",
        np.arange(F.size), F, T, T, F, STORAGE / 1e6, LOSS / 1e6, TAN, sep="    ",
    )  # fmt: skip
    assert_is_the_truth(read(tmp_path, text))


def test_an_export_of_perkin_elmer(tmp_path):
    head = "Filename:\tC:\\data\\pp.dma\r\nOperator ID:\tx\r\nSample Weight:\t1.000 mg\r\n\r\n1) Hold for 1.0 min at 20.00°C\r\n\r\n"
    text = head + table(
        "Index\tTime\tTemp.\tFrequency\tStorage Modulus\tLoss Modulus\tTan Delta\n\tmin\t°C\tHz\tPa\tPa\t",
        np.arange(F.size), F, T, F, STORAGE, LOSS, TAN, sep="\t",
    )  # fmt: skip
    assert_is_the_truth(read(tmp_path, text))


def test_a_sweep_without_a_temperature_is_read(tmp_path):
    rows = T == 20
    found = read(tmp_path, table("omega (rad/s) G' (Pa) G'' (Pa)", OMEGA[rows], STORAGE[rows], LOSS[rows], sep=" "))
    assert "temperature" not in found
    np.testing.assert_allclose(found.loss_modulus, LOSS[rows], rtol=1e-9)


def test_columns_can_be_named(tmp_path):
    rows = "\n".join(table("", OMEGA, STORAGE, LOSS, T, sep=" ").splitlines()[1:]) + "\n"
    assert_is_the_truth(read(tmp_path, rows, columns="omega (rad/s), G' (Pa), G'' (Pa), T (C)"))
    strange = table("drive,one,two,chamber", *ALL)
    assert_is_the_truth(read(tmp_path, strange, columns="f (Hz), E' (MPa), E'' (MPa), T (C)"))


def test_responses_over_time_are_read(tmp_path):
    time = np.geomspace(0.01, 100, 5)
    found = read(tmp_path, table("t,E_relax,T,Set\ns,MPa,C,-", time, 3e3 / (1 + time), 0 * time + 20, 0 * time))
    np.testing.assert_allclose(found.time, time, rtol=1e-9)
    np.testing.assert_allclose(found.relaxation_modulus, 3e9 / (1 + time), rtol=1e-9)
    found = read(tmp_path, table("time_min;J(t) [1/GPa]", time / 60, 1 + time, sep=";"))
    np.testing.assert_allclose(found.creep_compliance, 1e-9 * (1 + time), rtol=1e-9)


@pytest.mark.parametrize(
    ("head", "message", "hint"),
    [
        ("f (Hz),E' (MPa),T (°C)", "found frequency, storage modulus, temperature; no loss modulus, tan δ or phase", "columns="),
        ("T (°C),E' (MPa),tan d", "found temperature, storage modulus, tan δ; no frequency", 'columns="T (°C), E'),
        ("f (Hz),|E*| (MPa),T (C)", "found frequency, complex modulus, temperature; no phase or tan δ", "columns="),
        ("f,E' (MPa),E'' (MPa)", "f has no unit, expected a unit of Hz or rad/s", "columns=\"f (Hz), E' (MPa), E'' (MPa)\""),
        ("a,b,c", "no line names the columns: .* there are rows of 3 numbers", "columns="),
    ],
)  # fmt: skip
def test_a_refusal_names_what_is_missing_and_what_helps(tmp_path, head, message, hint):
    path = tmp_path / "table.csv"
    path.write_text(table(head, F, STORAGE, LOSS), "utf-8")
    with pytest.raises(SourceError, match=message) as caught:
        tables.read(path)
    assert hint in caught.value.hint


def test_a_column_given_twice_is_told_where_it_differs(tmp_path):
    with pytest.warns(UserWarning, match='two columns hold temperature and differ; the first, "T '):
        found = read(tmp_path, table("f (Hz),E' (MPa),E'' (MPa),T (°C),Temp (°C)", *ALL, T + 1))
    assert_is_the_truth(found)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert_is_the_truth(read(tmp_path, table("f (Hz),E' (MPa),E'' (MPa),T (°C),Temp (°C)", *ALL, T)))

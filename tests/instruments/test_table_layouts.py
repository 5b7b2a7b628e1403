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
    "three rows of names over units": table("Frequency,Storage,Loss,Sample\n,Modulus,Modulus,Temperature\n,E',E'',\nHz,MPa,MPa,°C", *ALL),
    "German, set and measured temperature": table("Nr;T_soll [°C];T_Probe [°C];f [Hz];Speicher-Modul [N/mm²];Verlust-Modul [kN/m²]", np.arange(F.size), np.round(T + 3, -1), T, F, STORAGE / 1e6, LOSS / 1e3, sep=";", decimal=","),
    "times of day": table("Datum;Uhrzeit;f (Hz);E' (kN/mm²);E'' (MPa);T (°C)", F, STORAGE / 1e9, LOSS / 1e6, T, sep=";", decimal=",").replace("\n0", "\n06.03.2021;14:02:11,5;0").replace("\n1", "\n06.03.2021;14:02:11,5;1").replace("\n3", "\n06.03.2021;14:02:11,5;3"),
    "a report in decimal commas between blanks": "\n".join(
        f"Temperatur: {at:g} °C\n" + table("Frequenz   E'      E\"\n[Hz]       [MPa]   [MPa]", FREQUENCY, STORAGE[at == T] / 1e6, LOSS[at == T] / 1e6, sep="   ", decimal=",") + "-" * 40
        for at in TEMPERATURE
    ),
    "a table per frequency, which blanks part from its name": "\n".join(
        f"Frequency  {at:.12g} Hz\nCurve Values:\n" + table("  Index   Ts   M'   M''\n          [°C]   [MPa]   [MPa]", np.arange(TEMPERATURE.size), TEMPERATURE, STORAGE[at == F] / 1e6, LOSS[at == F] / 1e6, sep="   ")
        for at in FREQUENCY
    ),
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


# Layouts of instruments, languages and programs as people send them; see :data:`LAYOUTS`.
DE = {"sep": ";", "decimal": ","}
ROWS = list(zip(F.tolist(), (STORAGE / 1e6).tolist(), (LOSS / 1e6).tolist(), T.tolist(), strict=True))
SENT = {
    "merged names over units, csv": table("Frequency,Temperature,Modulus,,\n,,E',E'',tan d\nHz,°C,MPa,MPa,",F,T,STORAGE/1e6,LOSS/1e6,TAN),
    "merged quantity row + unit row": table("Frequency;Temperature;Dynamic modulus;;Loss factor\nHz;°C;Storage [MPa];Loss [MPa];-",F,T,STORAGE/1e6,LOSS/1e6,TAN,sep=";"),
    "group row above names": table("Control,,Result,,\nFrequency (Hz),Temperature (°C),E' (MPa),E'' (MPa),tan d",F,T,STORAGE/1e6,LOSS/1e6,TAN),
    "blank line between head and units": table("f\tE'\tE''\tT\n\nHz\tMPa\tMPa\t°C",*ALL,sep="\t"),
    "Temperature merged over two E": "Temperature,20 °C,,40 °C,,60 °C,\nFrequency (Hz),E' (MPa),E'' (MPa),E' (MPa),E'' (MPa),E' (MPa),E'' (MPa)\n"+table("x",FREQUENCY,*(p[t == T]/1e6 for t in TEMPERATURE for p in (STORAGE,LOSS))).split("\n",1)[1],
    "T over columns, units row below": "f,20 °C,,40 °C,,60 °C,\n,E',E'',E',E'',E',E''\nHz,MPa,MPa,MPa,MPa,MPa,MPa\n"+table("x",FREQUENCY,*(p[t == T]/1e6 for t in TEMPERATURE for p in (STORAGE,LOSS))).split("\n",1)[1],
    "German Excel": table("Frequenz [Hz];Temperatur [°C];Speichermodul [MPa];Verlustmodul [MPa];Verlustfaktor",F,T,STORAGE/1e6,LOSS/1e6,TAN,**DE),
    "German Excel E-Modul": table("Frequenz (Hz);Temp. (°C);E'-Modul (MPa);E''-Modul (MPa);tan delta",F,T,STORAGE/1e6,LOSS/1e6,TAN,**DE),
    "French Excel": table("Fréquence (Hz);Température (°C);Module de conservation (MPa);Module de perte (MPa);Facteur de perte",F,T,STORAGE/1e6,LOSS/1e6,TAN,**DE),
    "French Excel 2": table("Fréquence;Température;Module élastique E';Module visqueux E'';tan δ\nHz;°C;MPa;MPa;",F,T,STORAGE/1e6,LOSS/1e6,TAN,**DE),
    "Japanese Excel": table("周波数 (Hz),温度 (°C),貯蔵弾性率 (MPa),損失弾性率 (MPa),損失正接",F,T,STORAGE/1e6,LOSS/1e6,TAN),
    "Japanese 2": table("周波数[Hz],温度[℃],貯蔵弾性率 E'[Pa],損失弾性率 E''[Pa],tanδ",F,T,STORAGE,LOSS,TAN),
    "Japanese fullwidth": table("周波数（Hz）,温度（℃）,貯蔵弾性率（MPa）,損失弾性率（MPa）",*(ALL[0],ALL[3],ALL[1],ALL[2])),
    "Spanish": table("Frecuencia (Hz);Temperatura (°C);Módulo de almacenamiento (MPa);Módulo de pérdida (MPa)",F,T,STORAGE/1e6,LOSS/1e6,**DE),
    "Italian": table("Frequenza (Hz);Temperatura (°C);Modulo conservativo (MPa);Modulo dissipativo (MPa)",F,T,STORAGE/1e6,LOSS/1e6,**DE),
    "Portuguese": table("Frequência (Hz);Temperatura (°C);Módulo de armazenamento (MPa);Módulo de perda (MPa)",F,T,STORAGE/1e6,LOSS/1e6,**DE),
    "Chinese": table("频率 (Hz),温度 (°C),储能模量 (MPa),损耗模量 (MPa),损耗因子",F,T,STORAGE/1e6,LOSS/1e6,TAN),
    "rad/s under Frequency": table("Frequency (rad/s),E' (MPa),E'' (MPa),Temperature (K)",OMEGA,STORAGE/1e6,LOSS/1e6,T+273.15),
    "Hz under omega": table("omega (Hz),E' (MPa),E'' (MPa),T (C)",*ALL),
    "both freq": table("Freq (Hz),Freq (rad/s),E' (MPa),E'' (MPa),T (C)",F,OMEGA,STORAGE/1e6,LOSS/1e6,T),
    "1/s": table("ω (1/s),G' (Pa),G'' (Pa),T (°C)",OMEGA,STORAGE,LOSS,T),
    "log10 with brackets": table("log10(f/Hz),log10(E'/Pa),log10(E''/Pa),T/°C",np.log10(F),np.log10(STORAGE),np.log10(LOSS),T),
    "lg": table("lg f [Hz];lg E' [MPa];lg E'' [MPa];T [°C]",np.log10(F),np.log10(STORAGE/1e6),np.log10(LOSS/1e6),T,**DE),
    "log a unit behind": table("log(frequency) (Hz),log(E') (Pa),log(E'') (Pa),Temperature (C)",np.log10(F),np.log10(STORAGE),np.log10(LOSS),T),
    "log ang": table("Log Angular Frequency (rad/s)\tLog Storage Modulus (Pa)\tLog Loss Modulus (Pa)\tTemp (C)",np.log10(OMEGA),np.log10(STORAGE),np.log10(LOSS),T,sep="\t"),
    "thousands quoted": 'f (Hz),E\' (Pa),E\'\' (Pa),T (°C)\n'+"".join(f'{f!r},"{s:,.6f}","{g:,.6f}",{t}\n' for f, s, g, t in zip(F.tolist(),STORAGE,LOSS,T, strict=True)),
    "thousands apostrophe": "f (Hz);E' (Pa);E'' (Pa);T (°C)\n"+"".join(f"{f!r};{s:,.6f};{g:,.6f};{t}\n".replace(",","'") for f, s, g, t in zip(F.tolist(),STORAGE,LOSS,T, strict=True)),
    "thousands blank, decimal comma": "f (Hz);E' (Pa);E'' (Pa);T (°C)\n"+"".join(f"{f!r};{s:,.6f};{g:,.6f};{t}\n".replace(","," ").replace(".",",") for f, s, g, t in zip(F.tolist(),STORAGE,LOSS,T, strict=True)),
    "thousands dot, decimal comma": "f (Hz);E' (Pa);E'' (Pa);T (°C)\n"+"".join(f"{f!r}".replace(".",",")+";"+";".join(f"{v:,.6f}".translate(str.maketrans(",.",".,")) for v in (s, g, t))+"\n" for f, s, g, t in zip(F.tolist(),STORAGE,LOSS,T, strict=True)),
    "exponents 10^": "f (Hz),E' (Pa),E'' (Pa),T (°C)\n"+"".join(f"{f!r},{s/1e6:.12f}x10^6,{g/1e6:.12f}x10^6,{t}\n" for f, s, g, t in zip(F.tolist(),STORAGE,LOSS,T, strict=True)),
    "E+009 (old Windows)": "f (Hz),E' (Pa),E'' (Pa),T (°C)\n"+"".join(f"{f!r},{s/1e9:.14f}E+009,{g/1e9:.14f}E+009,{t}\n" for f, s, g, t in zip(F.tolist(),STORAGE,LOSS,T, strict=True)),
    "percent tan": table("f (Hz),E' (MPa),tan delta (%),T (°C)",F,STORAGE/1e6,100*TAN,T),
    "mrad phase": table("f (Hz),|E*| (MPa),phase (mrad),T (°C)",F,SIZE/1e6,1e3*DELTA,T),
    "kgf/cm2": table("f (Hz),E' (kgf/cm²),E'' (kgf/cm²),T (°C)",F,STORAGE/98066.5,LOSS/98066.5,T),
    "N/mm²": table("f (Hz);E' (N/mm²);E'' (N/mm²);T (°C)",*ALL,**DE),
    "10^6 Pa": table("f (Hz),E' (10^6 Pa),E'' (10^6 Pa),T (°C)",*ALL),
    "kPa, mHz": table("f (mHz),E' (kPa),E'' (kPa),T (°C)",F*1e3,STORAGE/1e3,LOSS/1e3,T),
    "TRIOS csv": "Filename,a.tri\nInstrument serial number,5343\n\n[step]\n"+table("Frequency,Storage modulus,Loss modulus,Tan(delta),Temperature\nHz,MPa,MPa,,°C",F,STORAGE/1e6,LOSS/1e6,TAN,T),
    "TRIOS excel tab with step name": "Frequency sweep - 1\n"+table("Angular frequency\tOscillation strain\tTemperature\tStorage modulus\tLoss modulus\nrad/s\t%\t°C\tPa\tPa",OMEGA,F,T,STORAGE,LOSS,sep="\t"),
    "Pyris": "Filename:\tC:\\a.dm8d\nData Collected:\t1/2/2020\n"+table("Index\tTime\tSample Temp.\tFrequency\tModulus\tStorage Modulus\tLoss Modulus\tTan Delta\tPhase\n\tmin\t°C\tHz\tPa\tPa\tPa\t\t°",np.arange(F.size),F,T,F,SIZE,STORAGE,LOSS,TAN,np.rad2deg(DELTA),sep="\t"),
    "STARe German": "Kurvenname:\n  [1]DMA\nKurvenwerte:\n"+table("  Index        t       Tp       Tr        f       M'      M''   Tan Delta\n  []            [s]     [°C]     [°C]     [Hz]    [MPa]    [MPa]      []",np.arange(F.size),F,T,T,F,STORAGE/1e6,LOSS/1e6,TAN,sep="    "),
    "Proteus German": "#EXPORTTYPE:DATEN ALLE\n#DECIMAL:KOMMA\n#SEPARATOR:SEMIKOLON\n\n"+table("##Temp./°C;Zeit/min;Freq./Hz;E'/MPa;E\"/MPa;tan d",T,F,F,STORAGE/1e6,LOSS/1e6,TAN,**DE),
    "Proteus freq in columns": "#EXPORTTYPE:DATA ALL\n#SEPARATOR:SEMICOLON\n\n"+"##Temp./°C;"+";".join(f"E'({f:.10f} Hz)/MPa;E\"({f:.10f} Hz)/MPa" for f in FREQUENCY)+"\n"+table("x",TEMPERATURE,*(p[np.isclose(F,f)]/1e6 for f in FREQUENCY for p in (STORAGE,LOSS)),sep=";").split("\n",1)[1],
    "Bohlin txt": "Bohlin Instruments\nSample: x\n\n"+table("Time\tTemperature\tFrequency\tPhase Angle\tComplex Modulus\tElastic Modulus\tViscous Modulus\ns\t°C\tHz\t°\tPa\tPa\tPa",F,T,F,np.rad2deg(DELTA),SIZE,STORAGE,LOSS,sep="\t"),
    "RheoWin German": "Firma / Bediener: x\nDatum: 1.2.2020\n\n"+table("f in Hz;G' in Pa;G\" in Pa;|G*| in Pa;T in °C;t in s",F,STORAGE,LOSS,SIZE,T,F,**DE),
    "RheoWin seg": "Element Definition: Osc\n"+"".join(f"\nSegment {k+1}\n"+table("t_seg in s;f in Hz;G' in Pa;G\" in Pa;T in °C",F[t == T],F[t == T],STORAGE[t == T],LOSS[t == T],T[t == T],sep=";") for k,t in enumerate(TEMPERATURE)),
    "GABO Eplexor with header": "Eplexor 500N;;;\nProbe;x;;\n\n"+table("Nr.;Zeit;Temp.;Frequenz;|E*|;E';E\";tan delta\n;[s];[°C];[Hz];[MPa];[MPa];[MPa];[-]",np.arange(F.size),F,T,F,SIZE/1e6,STORAGE/1e6,LOSS/1e6,TAN,**DE),
    "Metravib": table("Temperature (°C)\tFrequency (Hz)\tModulus E' (Pa)\tModulus E\" (Pa)\tTan(delta)",T,F,STORAGE,LOSS,TAN,sep="\t"),
    "Hitachi DMA": table("Temp Cel\tFreq Hz\tE' Pa\tE\" Pa\ttanD",T,F,STORAGE,LOSS,TAN,sep="\t"),
    "UBM Japanese": table("No.,温度(℃),周波数(Hz),E'(Pa),E''(Pa),tanδ",np.arange(F.size),T,F,STORAGE,LOSS,TAN),
    "comments between": "# a\n"+table("f (Hz),E' (MPa),E'' (MPa),T (°C)",*ALL).replace("\n10,","\n# remark: clamp\n10,"),
    "footer statistics": table("f (Hz),E' (MPa),E'' (MPa),T (°C)",*ALL)+"\nMean,,,\nMax;1;2\nEnd of file\n",
    "sep=; line": "sep=;\n"+table("f (Hz);E' (MPa);E'' (MPa);T (°C)",*ALL,**DE),
    "pandas index": table(",f,E',E'',T\n,Hz,MPa,MPa,degC",np.arange(F.size),*ALL),
    "R write.table": "\"f_Hz\" \"E_storage_MPa\" \"E_loss_MPa\" \"T_C\"\n"+"".join(f'"{k+1}" {f!r} {s/1e6:.14g} {g/1e6:.14g} {t}\n' for k, (f, s, g, t) in enumerate(zip(F.tolist(),STORAGE,LOSS,T, strict=True))),
    "two tabs between": table("Freq [Hz]\t\tE' [MPa]\t\tE'' [MPa]\t\tT [°C]",F,STORAGE/1e6,LOSS/1e6,T,sep="\t\t"),
    "T in title line": "".join(f"Isotherm at {t:g} °C\n"+table("f (Hz);E' (MPa);E'' (MPa)",F[t == T],STORAGE[t == T]/1e6,LOSS[t == T]/1e6,**DE)+"\n" for t in TEMPERATURE),
    "T = line": "".join(f"T = {t:g} degC\n"+table("f (Hz);E' (MPa);E'' (MPa)",F[t == T],STORAGE[t == T]/1e6,LOSS[t == T]/1e6,**DE)+"\n" for t in TEMPERATURE),
    "T K line": "".join(f"Temperature [K]\t{t+273.15:g}\n"+table("f (Hz)\tE' (MPa)\tE'' (MPa)",F[t == T],STORAGE[t == T]/1e6,LOSS[t == T]/1e6,sep="\t")+"\n" for t in TEMPERATURE),
    "Temp(F)": table("Freq(Hz),E'(psi),E''(psi),Temp(F)",F,STORAGE/6894.757293168361,LOSS/6894.757293168361,T*1.8+32),
    "ksi": table("Freq(Hz),E'(ksi),E''(ksi),Temp(°F)",F,STORAGE/6894757.293168361,LOSS/6894757.293168361,T*1.8+32),
    "compliance 1/MPa": table("f (Hz),J' (1/MPa),J'' (1/MPa),T (°C)",F,STORAGE/SIZE**2*1e6,LOSS/SIZE**2*1e6,T,form=".16g"),
    "Storage Modulus E', MPa (colon)": table("Frequency: Hz,Storage modulus: MPa,Loss modulus: MPa,Temperature: °C",*ALL),
    "underscored words": table("Frequency_Hz,Storage_Modulus_MPa,Loss_Modulus_MPa,Temperature_degC",*ALL),
    "camel": table("FrequencyHz,StorageModulusMPa,LossModulusMPa,TemperatureC",*ALL),
    "E1 E2": table("Frequency [Hz] E1 [MPa] E2 [MPa] Temperature [°C]",*ALL,sep=" "),
    "malvern rspace with action names":"\n".join(['Action Name,Time (action)(s),Temperature(°C),Frequency(Hz),Shear modulus (elastic component)(Pa),Shear modulus (viscous component)(Pa),Phase angle(°)']+[f'"Frequency sweep",{i},{t:.14g},{f:.14g},{s:.14g},{g:.14g},{np.rad2deg(d):.14g}' for i,(f,s,g,t,d) in enumerate(zip(F,STORAGE,LOSS,T,DELTA,strict=True))])+"\n",
    "rad s^-1":table("omega [rad s^-1],G' [Pa],G'' [Pa],T [°C]",OMEGA,STORAGE,LOSS,T),
    "rad·s⁻¹ behind slash":table("ω / rad·s⁻¹\tG′ / Pa\tG″ / Pa\tT / °C",OMEGA,STORAGE,LOSS,T,sep="\t"),
    "s^-1":table("omega (s^-1);G' (Pa);G\" (Pa);T (K)",OMEGA,STORAGE,LOSS,T+273.15,sep=";"),
    "Gprime Gdoubleprime":table("Frequency (rad/s),Gprime (Pa),Gdoubleprime (Pa),Temp (C)",OMEGA,STORAGE,LOSS,T),
    "E_prime_MPa":table("freq_Hz,E_prime_MPa,E_double_prime_MPa,temp_C",*ALL),
    "Eprime dblprime":table("freq_Hz,Eprime_MPa,Edblprime_MPa,temp_C",*ALL),
    "Re Im":table("f (Hz),Re(E*) (MPa),Im(E*) (MPa),T (°C)",*ALL),
    "E_real":table("frequency_hz,E_real_pa,E_imag_pa,temperature_c",F,STORAGE,LOSS,T),
    "real part words":table("Frequency [Hz],Real part of E* [MPa],Imaginary part of E* [MPa],Temperature [°C]",*ALL),
    "quoted name with comma":table('"Frequency, f [Hz]","Storage modulus, E\' [MPa]","Loss modulus, E\'\' [MPa]","Temperature, T [°C]"',*ALL),
    "newline in quoted head":table('"Frequency\n(Hz)","Storage\nModulus\n(MPa)","Loss\nModulus\n(MPa)","Temp.\n(°C)"',*ALL),
    "rad per s names":table("omega_rad_per_s,G_prime_Pa,G_doubleprime_Pa,temperature_K",OMEGA,STORAGE,LOSS,T+273.15),
    "Frequency_rad_s":table("frequency_rad_s,storage_modulus_Pa,loss_modulus_Pa,temperature_degC",OMEGA,STORAGE,LOSS,T),
    "Origin labelled rows": "Long Name\tFrequency\tE'\tE''\tT\nUnits\tHz\tMPa\tMPa\t°C\nComments\t\t\t\t\n"+"".join(f"\t{f:.14g}\t{s:.14g}\t{g:.14g}\t{t:.14g}\n" for f,s,g,t in ROWS),
    "first row of block names T":"T (°C),f (Hz),E' (MPa),E'' (MPa)\n"+"".join((f"{t:g}" if i%4==0 else "")+f",{f:.14g},{s:.14g},{g:.14g}\n" for i,(f,s,g,t) in enumerate(ROWS)),
    "gnuplot blocks":"# f(Hz) E'(MPa) E''(MPa) T(C)\n"+"".join(f"{f:.14g} {s:.14g} {g:.14g} {t:.14g}\n"+("\n\n" if i%4==3 else "") for i,(f,s,g,t) in enumerate(ROWS)),
    "numbers in quotes":"f (Hz);E' (MPa);E'' (MPa);T (°C)\n"+"".join(";".join(f'"{v:.14g}"' for v in r)+"\n" for r in ROWS),
    "quoted decimal comma in csv":"f (Hz),E' (MPa),E'' (MPa),T (°C)\n"+"".join(",".join('"'+f'{v:.14g}'.replace(".",",")+'"' for v in r)+"\n" for r in ROWS),
    "Kreisfrequenz":table("Kreisfrequenz [1/s];Temperatur [°C];G' [Pa];G'' [Pa]",OMEGA,T,STORAGE,LOSS,sep=";",decimal=","),
    "Dutch":table("Frequentie (Hz);Temperatuur (°C);Opslagmodulus (MPa);Verliesmodulus (MPa)",F,T,STORAGE/1e6,LOSS/1e6,sep=";",decimal=","),
    "Polish":table("Częstotliwość [Hz];Temperatura [°C];Moduł zachowawczy [MPa];Moduł stratności [MPa]",F,T,STORAGE/1e6,LOSS/1e6,sep=";",decimal=","),
    "Russian":table("Частота, Гц;Температура, °C;Модуль накопления, МПа;Модуль потерь, МПа",F,T,STORAGE/1e6,LOSS/1e6,sep=";",decimal=","),
    "Korean":table("주파수 (Hz),온도 (°C),저장 탄성률 (MPa),손실 탄성률 (MPa)",F,T,STORAGE/1e6,LOSS/1e6),
    "Turkish":table("Frekans (Hz);Sıcaklık (°C);Depolama modülü (MPa);Kayıp modülü (MPa)",F,T,STORAGE/1e6,LOSS/1e6,sep=";",decimal=","),
    "Czech":table("Frekvence (Hz);Teplota (°C);Elastický modul (MPa);Ztrátový modul (MPa)",F,T,STORAGE/1e6,LOSS/1e6,sep=";",decimal=","),
    "Swedish":table("Frekvens (Hz);Temperatur (°C);Lagringsmodul (MPa);Förlustmodul (MPa)",F,T,STORAGE/1e6,LOSS/1e6,sep=";",decimal=","),
    "damping":table("Frequency (Hz),Temperature (°C),Dynamic Modulus (MPa),Damping (tan d)",F,T,SIZE/1e6,TAN),
    "loss angle":table("f (Hz),|G*| (Pa),Loss angle (°),T (°C)",F,SIZE,np.rad2deg(DELTA),T),
    "tight head":table("Freq.(Hz)  Temp.(C)  E'(MPa)  E\"(MPa)  tand",F,T,STORAGE/1e6,LOSS/1e6,TAN,sep="  "),
    "failed readings as stars":table("f (Hz),E' (MPa),E'' (MPa),T (°C)",*ALL)+"100,****,****,60\n",
    "failed readings n.d.":table("f (Hz),E' (MPa),E'' (MPa),T (°C)",*ALL)+"100,n.d.,#N/A,60\n",
    "columns and units in comments":"# columns: f E' E'' T\n# units: Hz MPa MPa C\n"+"".join(f"{f:.14g} {s:.14g} {g:.14g} {t:.14g}\n" for f,s,g,t in ROWS),
    "head again at every temperature":"".join("f (Hz)\tE' (MPa)\tE'' (MPa)\tT (°C)\n"+"".join(f"{f:.14g}\t{s:.14g}\t{g:.14g}\t{t:.14g}\n" for f,s,g,t in ROWS[4*k:4*k+4])+"\n" for k in range(3)),
    "wide E'_20C_MPa":table("f_Hz,"+",".join(f"E'_{t:g}C_MPa,E''_{t:g}C_MPa" for t in TEMPERATURE),FREQUENCY,*(p[t==T]/1e6 for t in TEMPERATURE for p in (STORAGE,LOSS))),
    "wide 20 °C E'":table("f (Hz);"+";".join(f"{t:g} °C E' (MPa);{t:g} °C E'' (MPa)" for t in TEMPERATURE),FREQUENCY,*(p[t==T]/1e6 for t in TEMPERATURE for p in (STORAGE,LOSS)),sep=";"),
    "wide 1 Hz E'":table("T (°C);"+";".join(f"{f:.10f} Hz E' (MPa);{f:.10f} Hz E'' (MPa)" for f in FREQUENCY),TEMPERATURE,*(p[np.isclose(F,f)]/1e6 for f in FREQUENCY for p in (STORAGE,LOSS)),sep=";"),
    "markdown titles":"".join(f"### {t:g} °C\n"+table("f (Hz),E' (MPa),E'' (MPa)",F[t==T],STORAGE[t==T]/1e6,LOSS[t==T]/1e6)+"\n" for t in TEMPERATURE),
    "title with set temperature":"".join(f"Soak at {t:g}.0 °C, frequency sweep\n"+table("Freq (Hz)\tE' (MPa)\tE'' (MPa)",F[t==T],STORAGE[t==T]/1e6,LOSS[t==T]/1e6,sep="\t")+"\n" for t in TEMPERATURE),
    "Fortran exponents":"f (Hz) E' (Pa) E'' (Pa) T (C)\n"+"".join(f"{f:.14E} {s*1e6:.14E} {g*1e6:.14E} {t:.14E}\n".replace("E+","D+").replace("E-","D-") for f,s,g,t in ROWS),
    "plus signs":"f (Hz);E' (MPa);E'' (MPa);T (°C)\n"+"".join(f"+{f:.14E};+{s:.14E};+{g:.14E};+{t:.14E}\n" for f,s,g,t in ROWS),
    "complex viscosity and tan":table("Angular Frequency (rad/s),Complex Viscosity (Pa.s),Tan Delta,Temperature (°C)",OMEGA,SIZE/OMEGA,TAN,T),
    "mPas":table("ω [rad/s];|η*| [mPa·s];δ [°];T [°C]",OMEGA,SIZE/OMEGA*1e3,np.rad2deg(DELTA),T,sep=";"),
    "JMP names":table("Frequency Hz\tStorage Modulus [E'] MPa\tLoss Modulus [E\"] MPa\tTan δ\tTemperature °C",F,STORAGE/1e6,LOSS/1e6,TAN,T,sep="\t"),
    "Q800 excel":table("Time\tTemperature\tFrequency\tStorage Modulus\tLoss Modulus\tTan Delta\tDrive Force\tAmplitude\nmin\t°C\tHz\tMPa\tMPa\t\tN\tµm",F,T,F,STORAGE/1e6,LOSS/1e6,TAN,F,F,sep="\t"),
    "Bose/ElectroForce":"Project: x\nSample: y\n\n"+table("Point,Freq (Hz),Disp Amp (mm),Load Amp (N),E* (MPa),E' (MPa),E\" (MPa),Tan Delta,Phase (deg),Temp (C)",np.arange(F.size),F,F,F,SIZE/1e6,STORAGE/1e6,LOSS/1e6,TAN,np.rad2deg(DELTA),T),
    "Metravib French":table("Fréquence (Hz)\tTempérature (°C)\tModule E' (Pa)\tModule E'' (Pa)\tTangente delta",F,T,STORAGE,LOSS,TAN,sep="\t",decimal=","),
    "RPA 2000":table("Temp,Freq,Strain,S' kPa,S'' kPa,G' kPa,G'' kPa,tan d\n°C,Hz,%,,,,,",T,F,F,F,F,STORAGE/1e3,LOSS/1e3,TAN),
    "Alpha RPA cpm":table("Temperature [°C],Frequency [cpm],G' [kPa],G'' [kPa]",T,F*60,STORAGE/1e3,LOSS/1e3),
    "units with times":table("f (Hz),E' (×10^9 Pa),E'' (×10^6 Pa),T (°C)",F,STORAGE/1e9,LOSS/1e6,T),
    "e+ Pa x1e6":table("f (Hz),E' (1e6 Pa),E'' (1e6 Pa),T (°C)",*ALL),
    "C1 under T celsius word":table("Frequency (hertz),Storage modulus (megapascal),Loss modulus (megapascal),Temperature (celsius)",*ALL),
    "kelvin word":table("Frequency (Hz),Storage modulus (Pa),Loss modulus (Pa),Temperature (Kelvin)",F,STORAGE,LOSS,T+273.15),
}  # fmt: skip


@pytest.mark.parametrize("name", SENT)
def test_every_layout_that_was_sent_gives_the_truth(tmp_path, name):
    found = read(tmp_path, SENT[name])
    assert_is_the_truth(found.isel(sample=np.isfinite(found.storage_modulus.values)))


@pytest.mark.parametrize(
    ("name", "encoding"),
    [("Japanese 2", "cp932"), ("Chinese", "gbk"), ("Russian", "cp1251"), ("Polish", "cp1250"), ("Korean", "euc_kr")],
)
def test_codecs_of_spreadsheets_are_found_by_their_words(tmp_path, name, encoding):
    assert_is_the_truth(read(tmp_path, SENT[name], encoding))


def test_more_names_than_numbers_between_blanks_are_refused(tmp_path):
    path = tmp_path / "table.txt"
    path.write_text(table("what f_Hz E'_MPa E''_MPa T_C", *ALL, sep=" "), "utf-8")
    with pytest.raises(SourceError, match="the headings name 5 columns, the rows hold 4 numbers"):
        tables.read(path)


def test_columns_of_fixed_width_are_read(tmp_path):
    head = "Frequency   Temperature  Storage Modulus  Loss Modulus\n   Hz          C              MPa            MPa\n"
    lines = (f"{f:12.10f} {t:12.6f} {s:24.14f} {g:20.14f}\n" for f, s, g, t in zip(*ALL, strict=True))
    assert_is_the_truth(read(tmp_path, head + "".join(lines)))


@pytest.mark.parametrize("row", ["100,NaN,NaN,60\n", "100,,,60\n", "100,-,-,60\n"])
def test_a_row_without_readings_is_none(tmp_path, row):
    found = read(tmp_path, LAYOUTS["units in brackets"] + row)
    assert int(np.isnan(found.storage_modulus).sum()) == 1
    assert_is_the_truth(found.isel(sample=slice(12)))


def test_a_strain_sweep_between_is_no_part_of_the_frequency_sweep(tmp_path):
    strain = table(
        "Strain (%),Frequency (Hz),E' (MPa),E'' (MPa),T (°C)", [0.01, 0.1], [1, 1], [1e3, 9e2], [50, 50], [20, 20]
    )
    found = read(tmp_path, f"Strain sweep\n{strain}\nFrequency sweep\n" + LAYOUTS["units in brackets"])
    assert_is_the_truth(found.isel(sample=slice(2, None)))
    assert np.unique(found.interval).size == 2


def test_units_in_the_cells_are_told(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("f;E';E'';T\n0.1 Hz;900 MPa;45 MPa;20 °C\n", "utf-8")
    with pytest.raises(SourceError, match="found no row of numbers below the headings") as caught:
        tables.read(path)
    assert "units stand in the headings" in caught.value.hint


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252", "mac_roman"])
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


def test_columns_that_are_empty_to_the_end_of_every_row(tmp_path):
    rows = T == 40
    phase = np.round(np.degrees(np.arctan2(LOSS, STORAGE)), 2)[rows]
    head = "T=40;\nFreq\tG'\tG\"\tPhaseAngle\tTorque\ttan_delta\tStress\nrad/s\tPa\tPa\t°\tN-m\t-\tPa"
    given = (OMEGA[rows], STORAGE[rows], LOSS[rows])
    with pytest.warns(UserWarning, match="tan_delta, Stress at the end are taken as empty"):
        found = read(tmp_path, table(head, *given, phase, F[rows], sep="    "))
    np.testing.assert_allclose(found.loss_modulus, LOSS[rows], rtol=1e-9)
    refused = pytest.raises(SourceError, match="the headings name 7 columns, the rows hold 5 numbers between blanks")
    with pytest.warns(UserWarning, match="one of them is wrong"), refused:
        read(tmp_path, table(head, *given, phase + 3, F[rows], sep="    "))
    with pytest.raises(SourceError, match="the rows hold 2 numbers between blanks"):
        read(tmp_path, table(head, *given[:2], sep="    "))


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


def test_columns_that_no_modulus_is_made_of_stop_no_sweep(tmp_path, recwarn):
    names = (
        "Run time\tTime\tTemperature\tAngular frequency\tOscillation displacement (cmd)\tTorque\tStress\tStress (step)\t"
        "Viscosity\tG*/sin(delta)\tG*.sin(delta)\tStorage modulus\tLoss modulus"
    )
    units = "s\ts\t°C\trad/s\trad\tfurlong\tMPa\tMPa\tPa.s\tkPa\tkPa\tMPa\tMPa"
    text = "[Step]\nStep name\tFrequency sweep\nNumber of points\t12\n" + f"Variables\t{names}\nUnits\t{units}\n"
    columns = (F + 9, F, T, OMEGA, F, F, F, 2 * F, SIZE, SIZE, LOSS, STORAGE / 1e6, LOSS / 1e6)
    for row in zip(*columns, strict=True):
        cells = [f"{v:.14g}" for v in row]
        cells[8] = ""  # a viscosity that was not measured
        text += "Data point\t" + "\t".join(cells) + "\n"
    found = read(tmp_path, text)
    assert_is_the_truth(found)
    assert (found.torque.attrs["units"], found.stress.attrs["units"]) == ("furlong", "Pa")
    assert found.oscillation_displacement.attrs["units"] == "rad"
    assert "viscosity" not in found
    assert not [str(w.message) for w in recwarn]


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


@pytest.mark.parametrize("mark", ["OVER", "1.#INF", "#####", "9.91E+37", "k.A."])
def test_what_stands_for_no_reading_is_none(tmp_path, mark):
    cells = [mark if k == 3 else format(value, ".14g") for k, value in enumerate(LOSS / 1e6)]
    rows = (f"{f:.14g},{e:.14g},{loss},{t:.14g}" for f, e, loss, t in zip(F, STORAGE / 1e6, cells, T, strict=True))
    found = read(tmp_path, "\n".join(["f (Hz),E' (MPa),E'' (MPa),T (°C)", *rows]) + "\n")
    np.testing.assert_array_equal(np.isnan(found.loss_modulus), np.arange(F.size) == 3)


def test_the_only_column_in_degrees_is_the_temperature(tmp_path):
    with pytest.warns(UserWarning, match="Kammer .°C.', the only column in degrees, is taken for the temperature"):
        assert_is_the_truth(read(tmp_path, table("f (Hz),E' (MPa),E'' (MPa),Kammer (°C)", *ALL)))
    with pytest.warns(UserWarning, match="several columns are in degrees, none is called temperature and none taken"):
        found = read(tmp_path, table("f (Hz),E' (MPa),E'' (MPa),Kammer (°C),Boden (°C)", *ALL, T + 1))
    assert_is_the_truth(found, has_temperature=False)


def test_a_page_of_html_is_told(tmp_path):
    path = tmp_path / "table.xls"
    path.write_text("<html><table><tr><th>f (Hz)</th></tr></table></html>", "utf-8")
    with pytest.raises(SourceError, match="page of HTML"):
        instruments.identify(path)


def test_rows_of_a_table_have_three_numbers_or_more() -> None:
    assert tables.holds_rows(b"1.0 2.0 3.0\n4.0 5.0 6.0\n")
    assert not tables.holds_rows(b"1.0 2.0\n4.0 5.0\n6.0 7.0\n")

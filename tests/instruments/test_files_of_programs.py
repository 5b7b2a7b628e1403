"""Files as other programs leave them: a part that no result needs never costs the rest.

The layouts are those of public files and bug reports; the numbers are our own.
"""

import base64
import io
import warnings
import zipfile
import zlib

import numpy as np
import openpyxl
import pytest

import instruments
from labpipe.errors import SourceError
from pipelines.session import inspect

OLD_WORKBOOK = (
    "c-rk)OK1~O6g_Y9X;PXrsj1M2VW_lCVmH!_2yOh()J;qMfFgpXW)x{jOAy5_v|76n1i_W!rqGR>svG};?pz3!3Kj$*(WNUv!9|<#-kV9A#w;"
    "4JMP<(L&fIt3J8$m1-+bQ91#{C6!+BJo2M!cWFWhB5Maf&r1VH7c$!6*7p=8?lr{ML_K)PLc?t5FuW60y3hlU5v*TleQO2;vVfzgbiZy@$c3"
    "@ODibQ3GwC66C15>=D%DdA1R_oe0w;oai7A>2)MbLtr85(Dv_)+|1%wMv;E-0ox1d=$?PG~*4=;>$Nxv91eyvS(8xe`i6&*?<|)xb+zsBbyq"
    "@Aw&Z>gCC|2d@rrkSGw)rSib`Kf3Eh|Rq@}_oWKOklQO}l;KPE0OI$c~!7#=a(FLj?iPq(5J-UB9Mw@JJhaT-8OvSuxS~j^4>(R7vW?!tHw`"
    "p0{fmO@eC)2%wIE_ZJgEHv@v~e%q`!?S{G?+Lco(b8?iyM9$#|RTwSV3aHlt`lzSX>m_g|AAhTf`0vhv;7D+&<WB8Ocehb4^Oy={jA4_lb@&"
    "J4*J{*8@)?Q(qD>vS<79<DuDw#57vz0hA^^ACu@*o$AhQ#?wUUtgOx9lW@y#8-+&;Sh1VdQ>_t8s24LRT+DIrsO6ky^;I$Fpq#^MOI5V>5)t"
    "tQsZW^ab>{Pm`I2Z^rBzXBQr|7CZDSs)P&ulo98y0noM~fDR;Zj+RL-&ppM{xsX%g+S%2h?>DvR*?R%U;N%3Vd}E{iZJz41Y<sCu*}JmOoYZ"
    "F>dvuwlc74I4IW*s!rKQ1WsM>(vtSis!ao@cF;a5~YIuo8-U6L5$LIjy_C#k)d-I7i*e7o8eNWw$vImrT>MDBXspFhA|{@4A(q=>0?io-_M$"
    "bfj_r|YQ27;mN?h>`o929QQI*"
)
"""A workbook of 1997 (.xls), made by xlwt: one sheet, f, E', E'' and T of two isotherms of three frequencies."""

STORAGE, LOSS = [2100.0, 2240.0, 2395.0], [93.0, 88.0, 81.0]


def write(folder, name, text, encoding="utf-8"):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode(encoding))
    return path


def read(path):
    """Read a file from Python, and make sure that `inspect` describes the same; return it and what is said of it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what they say is among the problems
        found = instruments.read(path)
    described = inspect(path)
    shown = {row["name"]: row for row in described["variables"]}
    for name, column in found.data_vars.items():
        if column.dtype.kind == "f" and np.isfinite(column).any():
            assert shown[name]["max"] == pytest.approx(float(column.max()))
    return found, described["problems"]


def assert_holds(found, storage=STORAGE, loss=LOSS):
    np.testing.assert_allclose(found.storage_modulus, np.array(storage) * 1e6, rtol=1e-9)
    np.testing.assert_allclose(found.loss_modulus, np.array(loss) * 1e6, rtol=1e-9)


@pytest.mark.parametrize("name", ["Point No.", "Meas. Pts.", "Messpunkt", "Point", "Punkt-Nr."])
def test_a_column_of_point_numbers_is_that(tmp_path, name):
    text = f"{name},Angular Frequency [rad/s],Storage Modulus [MPa],Loss Modulus [MPa]\n"
    rows = "".join(f"{k + 4},{10.0**-k},{a},{b}\n" for k, (a, b) in enumerate(zip(STORAGE, LOSS, strict=True)))
    found, said = read(write(tmp_path, "a.csv", text + rows))
    assert_holds(found)
    assert found.point.values.tolist() == [4, 5, 6]
    assert not said


RHEOPLUS = [
    ["Data Series Information"], ["Name:", "", "", "Gel 7 12C"], ["Number of Intervals:", "", "", "1"],
    ["Application:", "", "", "RHEOPLUS/32 V3.62"], ["Calculating Constants:"], ["- Csr [min/s]:", "", "", "2.5"],
    ["Interval:", "", "", "1"], ["Number of Data Points:", "", "", "3"], ["Time Setting:", "", "", "9 Meas. Pts."],
    ["Measuring Profile:"], ["- strain", "", "", "Amplitude gamma = 2 %"],
    ["", "", "", "Angular Frequency omega = 90 ... 0.3 rad/s log; |Slope| = 4 Pt. / dec"], [""],
]  # fmt: skip
PLUS_TABLE = [
    ["Meas. Pts.", "Angular Frequency", "Storage Modulus", "Loss Modulus", "Torque", "Status"],
    ["", "[rad/s]", "[MPa]", "[MPa]", "[µNm]", "[]"],
    *([str(k + 1), str(90 / 3**k), str(STORAGE[k]), str(LOSS[k]), "9.1", "DSO"] for k in range(3)),
]


@pytest.mark.parametrize("kind", ["text", "workbook", "cut"])
def test_lines_of_the_measuring_profile_stand_before_a_table_of_rheoplus(tmp_path, kind):
    lines = [*RHEOPLUS, *PLUS_TABLE]
    if kind == "cut":
        lines = [RHEOPLUS[0], RHEOPLUS[1], [""], *PLUS_TABLE]
    if kind == "workbook":
        book = openpyxl.Workbook()
        for line in lines:
            book.active.append([float(c) if c.replace(".", "").isdigit() else c or None for c in line])
        book.save(tmp_path / "a.xlsx")
        found, said = read(tmp_path / "a.xlsx")
    else:
        sign = "," if kind == "cut" else "\t"
        text = "\r\n".join(sign.join(f'"{c}"' if sign in c else c for c in line) for line in lines) + "\r\n"
        found, said = read(write(tmp_path, "a.txt", text, "cp1252"))
    assert_holds(found)
    assert found.status.values.tolist() == ["DSO"] * 3
    assert [("without the line" in text) for text in said] == [True] * (kind == "cut")


STEP = "[step]\nFrequency sweep - 1\n"
STEP += "Angular frequency\tStep time\tTemperature\tStorage modulus\tLoss modulus\tDate and time\n"
STEP += "rad/s\tmin\t°C\tMPa\tMPa\t\n"
STEP += "".join(f"{9 - k}\t0.{k}\t31.0\t{STORAGE[k]}\t{LOSS[k]}\t3/16/2021 10:1{k}:44 AM\n" for k in range(3))
CREEP = "[step]\nCreep - 2\nTorque\tStep time\tTermination reason\tRun time\tDate and time\tCompliance\n"
CREEP += "µN.m\tmin\t\tmin\t\t1/MPa\n" + "".join(
    f"15.3\t0.{k + 1}\tNormal\t2.{k}\t3/16/2021 10:27:0{k} AM\t{0.2 * (k + 1)}\n" for k in range(4)
)
HEAD = "Filename\tsample_7.txt\nOperator\tA. Person\n[File Parameters]\nTrios version\t4.5.0\n"


def test_steps_of_trios_with_columns_of_text(tmp_path):
    found, _ = read(write(tmp_path, "both.txt", HEAD + STEP + "\n" + CREEP))
    assert_holds(found.isel(sample=slice(3)))
    np.testing.assert_allclose(found.creep_compliance[3:], 2e-7 * np.arange(1, 5), rtol=1e-9)
    np.testing.assert_allclose(found.interval_time[3:], 6.0 * np.arange(1, 5), rtol=1e-9)
    assert_holds(read(write(tmp_path, "sweep.txt", HEAD + STEP))[0])
    found, _ = read(write(tmp_path, "ramp.txt", HEAD + "[step]\nRamp - 1\nTime\tGap\ns\tmm\n1\t2\n2\t3\n\n" + STEP))
    assert_holds(found)


@pytest.mark.parametrize("formula", ["", "<x:f>CONCATENATE(1)</x:f>"])
def test_cells_written_as_strings_of_a_formula(tmp_path, formula):
    """Under a namespace with a prefix, as the OpenXML SDK writes them."""
    book, made = openpyxl.Workbook(), io.BytesIO()
    book.save(made)
    rows = [["f (Hz)", "E' (MPa)", "E'' (MPa)"], *([10.0**k, STORAGE[k], LOSS[k]] for k in range(3))]
    cells = [
        f'<x:c r="{"ABC"[j]}{i}"{f""" t="str">{formula}""" if isinstance(v, str) else ">"}<x:v>{v}</x:v></x:c>'
        for i, row in enumerate(rows, 1)
        for j, v in enumerate(row)
    ]
    body = "".join(f'<x:row r="{i + 1}">{"".join(cells[3 * i : 3 * i + 3])}</x:row>' for i in range(4))
    main = 'xmlns:x="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
    sheet = f"<x:worksheet {main}><x:sheetData>{body}</x:sheetData></x:worksheet>"
    path = tmp_path / "sdk.xlsx"
    with zipfile.ZipFile(made) as source, zipfile.ZipFile(path, "w") as target:
        for name in source.namelist():
            target.writestr(name, sheet if name == "xl/worksheets/sheet1.xml" else source.read(name))
    assert_holds(read(path)[0])


def test_workbooks_of_other_programs(tmp_path):
    old = write(tmp_path, "old.xls", zlib.decompress(base64.b85decode(OLD_WORKBOOK)))
    assert_holds(read(old)[0].isel(sample=slice(3)))
    body = "".join(
        "<table:table-row>"
        + "".join(
            f'<table:table-cell office:value-type="string"><text:p>{v}</text:p></table:table-cell>'
            if isinstance(v, str)
            else f'<table:table-cell office:value-type="float" office:value="{v}"/>'
            for v in row
        )
        + "</table:table-row>"
        for row in (["f (Hz)", "E' (MPa)", "E'' (MPa)"], *([10.0**k, STORAGE[k], LOSS[k]] for k in range(3)))
    )
    names = "".join(f' xmlns:{n}="urn:oasis:names:tc:opendocument:xmlns:{n}:1.0"' for n in ("office", "table", "text"))
    content = f'<office:document-content{names}><office:body><office:spreadsheet><table:table table:name="A">{body}'
    content += "</table:table></office:spreadsheet></office:body></office:document-content>"
    with zipfile.ZipFile(tmp_path / "a.ods", "w") as archive:
        archive.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        archive.writestr("content.xml", content)
        archive.writestr("META-INF/manifest.xml", "<manifest/>")
    assert_holds(read(tmp_path / "a.ods")[0])


def test_archives_and_owner_files_are_named_rightly(tmp_path):
    made = io.BytesIO()
    np.savez(made, a=np.arange(3))
    for name, data, message in (
        ("a.npz", made.getvalue(), "an archive of NumPy arrays"),
        ("~$gel.xlsx", b"\x05A. B." + bytes(159), "keeps this file next to an open workbook"),
        ("b.xls", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600), "the workbook is damaged or incomplete"),
        ("c.xls", b"<html><table><tr><th>f (Hz)</th></tr></table></html>", "no instrument recognises"),
    ):
        with pytest.raises(SourceError, match=message) as caught:
            inspect(write(tmp_path, name, data))
        assert name != "c.xls" or "page of HTML" in caught.value.hint


@pytest.mark.parametrize("frequencies", [["1", "8"], ["1"]])
def test_two_samples_side_by_side_are_refused(tmp_path, frequencies):
    head = "#EXPORTTYPE:\tDATA COMPARE\tDATA COMPARE\r\n#FILE:\tOne.ngb-dm2\tTwo.ngb-dm2\r\n"
    one = "Temp./°C\tFrequency/Hz\tE'/MPa\tE\"/MPa"
    rows = [f"{t}.0\t{f}\t{2000 - t}\t{150 - t}" for t in (20, 30) for f in frequencies]
    text = f"{head}#{one}\t{one}\r\n" + "".join(f"{row}\t{row.replace('.0', '.1')}5\r\n" for row in rows)
    path = write(tmp_path, "compare.txt", text, "cp1252")
    with pytest.raises(SourceError, match="as of several specimens or runs side by side") as caught:
        inspect(path)
    found = instruments.read(path, columns=caught.value.hint.partition("columns = ")[2])
    assert_holds(found, *zip(*((2000 - t, 150 - t) for t in (20, 30) for _ in frequencies), strict=True))


def grid(order):
    rows = [(t, w, 1e3 * (100 - t) + w, 50.0 + t) for t in (15.0, 25.0, 40.0, 60.0) for w in (0.3, 3.0, 30.0)]
    return "T (degC),omega (rad/s),E' (Pa),E'' (Pa)\n" + "".join(
        ",".join(map(repr, row)) + "\n" for row in sorted(rows, key=order)
    )


@pytest.mark.parametrize("noise", [0.0, 0.4])
def test_a_grid_is_grouped_by_temperature_whatever_the_order_of_its_rows(tmp_path, noise):
    rng = np.random.default_rng(5)
    orders = {
        "by temperature": lambda row: (row[0], row[1]),
        "by frequency": lambda row: (row[1], row[0]),
        "by frequency downwards": lambda row: (-row[1], -row[0]),
        "shuffled": lambda row: hash((row[0] * 7919 + row[1] * 104729) % 13),
    }
    for order in orders.values():
        lines = grid(order).splitlines()
        for k, line in enumerate(lines[1:], 1):
            t, rest = line.split(",", 1)
            lines[k] = f"{float(t) + noise * rng.uniform(-1, 1):.3f},{rest}"
        found, _ = read(write(tmp_path, "grid.csv", "\n".join(lines) + "\n"))
        sweeps = [part.sortby("frequency") for _, part in found.groupby("interval")]
        if len(sweeps) > 1:
            assert len(sweeps) == 4
            for part in sweeps:
                assert part.sizes["sample"] == 3
                assert float(np.ptp(part.temperature.values)) <= 2 * noise
        assert len(sweeps) == (1 if order is orders["by temperature"] else 4)


def test_up_and_down_at_the_same_temperatures_are_no_grid(tmp_path):
    rows = [(t, w) for t in (20.0, 40.0, 40.0, 20.0) for w in (1.0, 10.0)]
    text = "T (degC),f (Hz),E' (Pa),E'' (Pa)\n" + "".join(f"{t},{w},1e6,1e5\n" for t, w in rows)
    found, _ = read(write(tmp_path, "loop.csv", text))
    assert found.temperature.values.tolist() == [t for t, _ in rows]
    ramp = "T (degC),f (Hz),E' (Pa),E'' (Pa)\n" + "".join(f"{t},1,{1e6 - t},1e5\n" for t in range(20, 60))
    assert set(read(write(tmp_path, "ramp.csv", ramp))[0].interval.values) == {1}


@pytest.mark.parametrize("column", ["Eta' [MPas]", "Torque [furlong]", "Viscosity [blob]", "Colour [-]", "Stress [px]"])
def test_a_column_that_nothing_is_made_of_may_be_in_any_unit(tmp_path, column):
    name, unit = column.split(" ")
    text = f"   Index      f     E'     E\"   {name}\n     [#]   [Hz]  [MPa]  [MPa]  {unit}\n"
    text += "".join(f"   {k}   {10.0**k:.5e}   {STORAGE[k]:.5e}   {LOSS[k]:.5e}   9.6e+01\n" for k in range(3))
    found, said = read(write(tmp_path, "T31.txt", text))
    assert_holds(found)
    assert len(said) == (unit != "[-]")


@pytest.mark.parametrize("sign", ["\t", "  "])
def test_more_headings_than_numbers_where_the_first_are_all_that_is_needed(tmp_path, sign):
    head = sign.join(["w", "G'", "G''", "Temp", "g", "h*", "h''", "tan", "NormalStress"])
    rows = (sign.join(map(str, (9.0 - k, 1e6 * STORAGE[k], 1e6 * LOSS[k], -8.02, 0.01, 77.3))) for k in range(3))
    found, said = read(write(tmp_path, "melt.osc", "T=-8;Mw=21.3;chem=PI;\n" + "\n".join([head, *rows]) + "\n"))
    assert_holds(found)
    assert set(found.temperature.values) == {-8.0}
    assert any("name 9 columns, the rows hold 6 numbers" in text for text in said)

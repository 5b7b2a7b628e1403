"""Input files of simulation codes, read back by their published rules, give the master curve again."""

import json
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from labpipe.materials import Prony, arrhenius, deck_text, make_deck, wlf

WINDOW = (1e-3, 1e5)
OMEGA = 2 * np.pi * np.geomspace(*WINDOW, 60)
RHO = np.geomspace(1e-8, 1e5, 40)
SOLID = Prony(5e6, 1e8 / (1 + (np.log10(RHO) + 3) ** 2), RHO, nu=0.4)
LIQUID = Prony(0.0, 1e8 / (1 + (np.log10(RHO) + 3) ** 2), RHO, nu=0.4)
FEW = Prony(1e6, [1e6], [1e-3], nu=0.4)
BETWEEN = {"abaqus": 1e-9, "ansys": 1e-9, "comsol": 1e-9, "lsdyna": 3e-5}
"""Relative error of the digits of a file."""


def numbers(line):
    return [float(cell) for cell in line.split("!")[0].split(",")]


def maxwell(relaxed, weights, times):
    x = OMEGA[:, None] * np.asarray(times)
    return relaxed + (np.asarray(weights) * (x**2 + 1j * x) / (1 + x**2)).sum(axis=1)


def tension(G, K):
    """Return E* of shear and bulk modulus; K is None for an incompressible material."""
    return 3 * G if K is None else 9 * K * G / (3 * K + G)


def from_shares(E0, nu, g, k, times):
    g, k = np.asarray(g), np.asarray(k)
    assert g.sum() < 1
    assert (g > 0).all()
    G0, K0 = E0 / (2 + 2 * nu), E0 / (3 - 6 * nu)
    G = maxwell(G0 * (1 - g.sum()), G0 * g, times)
    return tension(G, maxwell(K0 * (1 - k.sum()), K0 * k, times))


def read_abaqus(text):
    lines = [line for line in text.splitlines() if not line.startswith("**")]
    at = {line.split(",")[0].upper(): i for i, line in enumerate(lines) if line.startswith("*")}
    rows = []
    for line in lines[at["*VISCOELASTIC"] + 1 :]:
        if line.startswith("*"):
            break
        rows.append(numbers(line))
    g, k, times = np.array(rows).T
    if "*HYPERELASTIC" in at:
        C10, D1 = numbers(lines[at["*HYPERELASTIC"] + 1])
        assert D1 == 0
        assert g.sum() < 1
        assert not k.any()
        return tension(maxwell(2 * C10 * (1 - g.sum()), 2 * C10 * g, times), None)
    return from_shares(*numbers(lines[at["*ELASTIC"] + 1]), g, k, times)


def read_ansys(text):
    series, name, found = {}, None, {}
    for line in text.splitlines():
        if line.startswith("MP,"):
            found[line.split(",")[1]] = float(line.split(",")[3].split("!")[0])
        elif line.startswith("TB,"):
            name = line.split(",")[5] if line.startswith("TB,PRONY") else line.split(",")[1]
        elif line.startswith("TBDATA"):
            series.setdefault(name, []).append(numbers(line.removeprefix("TBDATA,"))[1:])
    g, times = np.array(series["SHEAR"]).T
    if "HYPER" in series:
        mu, d = series["HYPER"][0]
        assert d == 0
        return tension(maxwell(mu * (1 - g.sum()), mu * g, times), None)
    k = np.array(series["BULK"])[:, 0] if "BULK" in series else 0 * g
    return from_shares(found["EX"], found["PRXY"], g, k, times)


def read_comsol(text):
    stated = {k: float(v) for k, v in re.findall(r"^%   (G|K|E|nu) = ([-+.\deE]+)", text, re.MULTILINE)}
    rows = np.array([line.split() for line in text.splitlines() if not line.startswith("%")], dtype=float)
    assert rows[:, 0].tolist() == list(range(1, len(rows) + 1))
    if "E" in stated:
        E, nu = stated["E"], stated["nu"]
        G = maxwell(E / (2 + 2 * nu), rows[:, 1], rows[:, 2])
        return 2 * (1 + nu) * G
    return tension(maxwell(stated["G"], rows[:, 1], rows[:, 2]), stated.get("K"))


def read_lsdyna(text):
    lines = [line for line in text.splitlines() if not line.startswith("$")]
    assert max(map(len, text.splitlines())) <= 80
    cards = lines[lines.index("*MAT_GENERAL_VISCOELASTIC") + 1 : lines.index("*END")]
    rows = [[float(card[i : i + 10]) for i in range(0, len(card), 10)] for card in cards]
    G, beta, K, beta_K = np.array(rows[2:]).T
    assert len(G) <= 18

    def modulus(weights, rates):
        x = OMEGA[:, None] / np.where(rates > 0, rates, 1.0)
        return (weights * np.where(rates > 0, (x**2 + 1j * x) / (1 + x**2), 1.0)).sum(axis=1)

    bulk = modulus(K, beta_K) if K.any() else rows[0][2]
    return tension(modulus(G, beta), bulk)


@cache
def deck_of(material, bulk):
    return make_deck(material, WINDOW, 25.0, bulk=bulk)


READ = {"abaqus": read_abaqus, "ansys": read_ansys, "comsol": read_comsol, "lsdyna": read_lsdyna}


def worse(found, truth):
    parts = [(found.real / truth.real, found.imag / truth.imag)[i] - 1 for i in (0, 1)]
    return max(float(np.sqrt(np.mean(part**2))) for part in parts)


@pytest.mark.parametrize("code", READ)
@pytest.mark.parametrize("bulk", ["constant", "relaxing", "incompressible"])
@pytest.mark.parametrize("material", [SOLID, LIQUID], ids=["solid", "liquid"])
def test_a_file_gives_the_modulus_again_within_its_stated_error(code, bulk, material):
    deck = deck_of(material, bulk)
    found = READ[code](deck_text(deck, code))
    truth = material.complex_modulus(OMEGA)
    about = 3e-3 if (code, bulk) == ("lsdyna", "incompressible") else 20 * BETWEEN[code]
    stated = float(re.search(r"window: (\S+) %", " ".join(deck.notes))[1]) / 100
    assert stated <= 0.0105
    assert worse(found, truth) <= 1.06 * stated + about


def test_extrapolated_moduli_are_warned_of():
    beyond = Prony(1e5, SOLID.E, RHO, nu=0.4)
    said = make_deck(beyond, (1.0, 1e3), 25.0).warnings
    assert any(text.startswith("the long-time modulus") and "at 1 Hz" in text for text in said)
    assert make_deck(FEW, (1e-4, 1e7), 25.0).warnings == ()
    kept = make_deck(FEW, (1.0, 300.0), 25.0)
    assert any("the instantaneous modulus, 2e+06 Pa" in text for text in kept.warnings)
    assert "** WARNING: the instantaneous modulus" in deck_text(kept, "abaqus")


def law_of(text, code):
    """Return log10 a_T as the file has it, over temperatures in degC."""
    if code == "lsdyna":
        card = text.split("*MAT_GENERAL_VISCOELASTIC\n")[1].splitlines()[1]
        T0, A, B = (float(card[i : i + 10]) for i in (50, 60, 70))
        return lambda T: A * (T + 273.15 - T0) / (B + T + 273.15 - T0) / np.log(10)
    if code == "comsol":
        T0, C1, C2 = (float(re.search(rf"%   {n} = (\S+)", text)[1]) for n in ("T0", "C1", "C2"))
        T0 -= 273.15
    else:
        line = text.split("DEFINITION=WLF\n")[1] if code == "abaqus" else text.split("TBDATA,1,")[-1]
        T0, C1, C2 = numbers(line.splitlines()[0])
    return lambda T: -C1 * (T - T0) / (C2 + T - T0)


T = np.array([10.0, 25.0, 60.0])


@pytest.mark.parametrize("code", READ)
def test_both_laws_are_written_so_that_they_give_the_shifts(code):
    deck = make_deck(FEW, WINDOW, 25.0, law=wlf(9.0, 120.0, 25.0))
    np.testing.assert_allclose(law_of(deck_text(deck, code), code)(T), -9 * (T - 25) / (95 + T), rtol=1e-4, atol=1e-9)
    energy = 150e3
    deck = make_deck(FEW, WINDOW, 25.0, law=arrhenius(energy, 25.0))
    truth = energy / 8.31446261815324 / np.log(10) * (1 / (T + 273.15) - 1 / 298.15)
    np.testing.assert_allclose(law_of(deck_text(deck, code), code)(T), truth, rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("code", READ)
def test_shifts_that_no_law_describes_are_a_remark(code):
    law = replace(wlf(9.0, 120.0, 25.0), chi_square=100.0, freedom=3)
    deck = make_deck(FEW, WINDOW, 25.0, law=law, shifts=([10.0, 25.0], [1.25, 0.0]), b_T=[1.0, 1.1])
    text = deck_text(deck, code)
    said = re.sub(r"\s+(?:\*\*|!|%|\$)?\s*", " ", text)
    assert "the material holds at 25 degC only" in said
    assert "(10, 1.25), (25, 0)" in said
    assert "by factors b_T from 1 to 1.1" in said
    assert not re.search(r"^\*TRS|^TB,SHIFT|^% Thermal", text, re.MULTILINE)


def test_json_holds_the_series_and_the_law():
    found = json.loads(deck_text(make_deck(FEW, WINDOW, 25.0, law=wlf(9.0, 120.0, 25.0)), "json"))
    assert found["tension"] == {"E_relaxed": 1e6, "E": [1e6], "rho": [1e-3]}
    assert found["wlf"] == {"C1": pytest.approx(9.0), "C2": pytest.approx(120.0)}
    assert found["shear"]["G_unrelaxed"] == pytest.approx(2e6 / 2.8)

"""Names and symbols of viscoelastic quantities, as exports and people write them in many languages."""

import re
import unicodedata

#: Canonical name to the symbols and words that stand for it, folded by :func:`fold`.
SYMBOLS = {
    "frequency": (
        "f, freq, freqs, frequency, fset, ν, testfrequency, testfreq, measfreq, oscillationfrequency, oscfreq, "
        "frequencies, drivefrequency, dynamicfrequency, frecuencia, frequenza, 周波数, 频率, 测试频率, frequentie, "
        "czestotliwosc, частота, 주파수, frekans, frekvence, frekvens, taajuus"
    ),
    "angular_frequency": (
        "w, omega, ω, angfreq, angularfreq, angularfrequency, angfrequency, circularfrequency, omegas, "
        "frecuenciaangular, pulsazione, frequenzaangolare, 角周波数, 角频率, hoekfrequentie, 각주파수, "
        "угловая частота, круговая частота, vinkelfrekvens"
    ),
    "temperature": (
        "T, Ts, temp, tmeas, temperature, tsample, sampletemp, sampletemperature, meastemp, temp1, temperature1, "
        "actualtemp, actualtemperature, testtemperature, specimentemperature, probetemperature, meantemperature, "
        "temperatures, temperatura, temperaturacampione, 温度, 试样温度, 測定温度, temperatuur, температура, 온도, "
        "sıcaklık, teplota, lampotila, tist, tprobe, tpr, isttemperatur, probentemperatur, pruftemperatur, "
        "messtemperatur, temperaturprobe, temperatureechantillon, temperaturamuestra, temperaturaprovino"
    ),
    "temperature_set": (
        "chambertemperature, oventemperature, furnacetemperature, tset, tround, Tr, settemp, settemperature, "
        "nominaltemperature, nominaltemp, tnominal, programtemperature, programtemp, setpoint, temperatureset, "
        "tempset, targettemperature, setpointtemperature, temperaturesetpoint, tnom, isothermtemperature, tsoll, "
        "tprog, tconsigne, temperaturconsigne, temperaturaconsigna, temperaturaimpostata, temperaturedeconsigne"
    ),
    "time": "t, time, testtime, elapsedtime, timeelapsed, totaltime, runtime",
    "interval_time": "steptime, segmenttime, intervaltime, relaxationtime, creeptime, actiontime",
    "storage_modulus": (
        "estor, gstor, e', g', m', k', estorage, gstorage, storage, storagemodulus, storagemod, eprime, gprime, ep, "
        "gp, e1, g1, ereal, greal, reale, realg, ree*, reg*, stormod, elasticmodulus, tensilestoragemodulus, "
        "flexuralstoragemodulus, shearstoragemodulus, bendingstoragemodulus, compressivestoragemodulus, "
        "dynamicstoragemodulus, extensionalstoragemodulus, realmodulus, modulusstorage, storagemodulus', modulus', "
        "est, gst, elastic, elasticmodule, youngsstoragemodulus, shearmoduluselasticcomponent, "
        "shearmodulusrealcomponent, storagemodule, emod', eelastic, gelastic, moduloconservativo, "
        "modulodialmacenamiento, modulodealmacenamiento, moduloelastico, moduleelastique, 貯蔵弾性率, "
        "貯蔵せん断弾性率, 储能模量, 存储模量, elastischesmodul, opslagmodulus, schubmodulelastischeranteil, "
        "modułzachowawczy, модуль накопления, 저장탄성률, 저장탄성계수, 저장모듈러스, depolamamodülü, elastickymodul, "
        "lagringsmodul, varastomoduuli, speichermodul, realpartof e*, realpartof g*, realpart, "
        "realpartofthecomplexmodulus"
    ),
    "loss_modulus": (
        "eloss, gloss, e'', g'', m'', k'', loss, lossmodulus, lossmod, edoubleprime, gdoubleprime, eprimeprime, "
        "gprimeprime, epp, gpp, e2, g2, eimag, gimag, image, imagg, ime*, img*, viscousmodulus, tensilelossmodulus, "
        "flexurallossmodulus, shearlossmodulus, bendinglossmodulus, compressivelossmodulus, dynamiclossmodulus, "
        "extensionallossmodulus, imaginarymodulus, moduluslossm, modulusloss, modulus'', edprime, gdprime, els, gls, "
        "viscous, lossmodule, youngslossmodulus, shearmodulusviscouscomponent, shearmodulusimaginarycomponent, "
        "eviscous, gviscous, edblprime, gdblprime, modulodissipativo, modulodeperdida, modulodeperdidas, "
        "moduloviscoso, modulevisqueux, 損失弾性率, 損失せん断弾性率, 损耗模量, 损失模量, verliesmodulus, "
        "schubmodulviskoseranteil, modułstratności, модуль потерь, 손실탄성률, 손실탄성계수, 손실모듈러스, "
        "kayıpmodülü, ztratovymodul, förlustmodul, tapsmodul, tabsmodul, haviomoduuli, verlustmodul, "
        "imaginarypartof e*, imaginarypartof g*, imaginarypart, imaginarypartofthecomplexmodulus"
    ),
    "loss_factor": (
        "tandelta, tand, tanδ, tandel, losstangent, lossfactor, damping, dampingfactor, tgdelta, tgδ, "
        "dissipationfactor, tan, tanphi, tandeltae, tandeltag, tanδe, tanδg, lossfactortandelta, 損失正接, 损耗因子, "
        "损耗角正切, verliesfactor, тангенс угла потерь, 손실계수, kayıpfaktörü, forlustfaktor, factordeperdida, "
        "fattorediperdita, facteurdeperte"
    ),
    "phase_angle": (
        "delta, δ, phase, phaseangle, phaselag, phaseshift, lossangle, phasedelta, phaseangledelta, phaseshiftangle, "
        "deltaangle, deltadegree, 位相差, 相位角, angulodefase, angolodifase"
    ),
    "complex_modulus": (
        "e*, g*, m*, k*, estar, gstar, complexmodulus, dynamicmodulus, absestar, emag, gmag, ecomplex, gcomplex, "
        "abse*, absg*, moduluscomplex, complexmod, ecplx, gcplx, absmodulus, complexshearmodulus, "
        "schubmodulkomplexeranteil, komplexerschubmodul, shearmoduluscomplexcomponent, complexyoungsmodulus, edyn, "
        "gdyn, absolutemodulus, norme*, normg*, 複素弾性率, 复数模量, modulocomplejo, modulocomplesso"
    ),
    "storage_compliance": "d', j', dstor, jstor, dprime, jprime, dp, jp, storagecompliance, d1, j1, dstorage, jstorage",
    "loss_compliance": "d'', j'', dloss, jloss, ddoubleprime, jdoubleprime, dpp, jpp, losscompliance, d2, j2",
    "complex_compliance": "d*, j*, dstar, jstar, complexcompliance",
    "complex_viscosity": "eta*, η*, etastar, complexviscosity, compleviscosity, abseta*, complexvisc",
    "complex_viscosity_real": "eta', η', etaprime, etap, dynamicviscosity",
    "complex_viscosity_imaginary": "eta'', η'', etadoubleprime, etapp",
    "relaxation_modulus": (
        "et, gt, erelax, grelax, relaxationmodulus, erel, grel, relaxmodulus, stressrelaxationmodulus, grelaxation, "
        "erelaxation, relaxedmodulus, ert, e0t, modulusrelaxation"
    ),
    "creep_compliance": (
        "jt, jcreep, dcreep, creepcompliance, compliancecreep, tensilecreepcompliance, jcreept, shearcreepcompliance, "
        "creep, compliance"
    ),
    "set": (
        "set, sweep, isotherm, step, stepnumber, stepno, segment, curve, run, setno, sweepno, stepindex, sweepnumber, "
        "segmentno, cycle, setnumber"
    ),
    "log10_aT": "logat, log10at, lgat, loga, logshift, logshiftfactor, log10shiftfactor, logah",
    "ln_aT": "lnat, lna, lnshiftfactor",
    "a_T": "at, shiftfactor, shift, horizontalshiftfactor, horizontalshift, shiftfactorat",
    "b_T": "bt, verticalshift, verticalshiftfactor",
}

MODULI = frozenset(
    {
        "storage_modulus", "loss_modulus", "complex_modulus", "storage_compliance", "loss_compliance",
        "complex_compliance", "complex_viscosity", "complex_viscosity_real", "complex_viscosity_imaginary",
    }
)  # fmt: skip
RESPONSES = frozenset({"relaxation_modulus", "creep_compliance"})
SHIFTS = frozenset({"log10_aT", "ln_aT", "a_T"})
FREQUENCIES = frozenset({"frequency", "angular_frequency"})
TIMES = frozenset({"time", "interval_time"})

# Primes of all sorts, and what folds away.
_PRIMES = {
    "\u2034": "'''", "\u2032": "'", "\u2033": "''", "\u2019": "'", "\u2018": "'", "\u201d": "''", "\u201c": "''",
    '"': "''", "\u00b4": "'", "`": "'", "\u02b9": "'", "\u02ba": "''",
}  # fmt: skip
_GREEK = {"\u2217": "*", "𝜔": "ω", "𝛿": "δ", "𝜂": "η", "\u0394": "δ", "\u2206": "δ"}
_CASED = ("T", "t", "Ts", "Tr")
_ACCENTS = "\u0300\u036f"
_FOLDED_AWAY = re.compile(r"[\s_().,|:\[\]{}~^$\\-]+")


def fold(heading: str) -> str:
    """Reduce a heading to its symbol: primes alike, no separators; a lone letter keeps its case.

    Examples
    --------
    >>> fold("log_aT"), fold("E″"), fold("T"), fold("t")
    ('logat', "e''", 'T', 't')
    """
    text = heading.strip()
    for table in (_PRIMES, _GREEK):
        for sign, plain in table.items():
            text = text.replace(sign, plain)
    text = re.sub(r"(?<=\w\w)'s\b", "s", text)  # Young's
    text = "".join(c for c in unicodedata.normalize("NFD", text) if not _ACCENTS[0] <= c <= _ACCENTS[1])
    text = _FOLDED_AWAY.sub("", text)
    text = text.translate(str.maketrans("₁₀", "10"))
    return text if text in _CASED else text.casefold()


_NAME_OF = {fold(symbol): name for name, symbols in SYMBOLS.items() for symbol in symbols.split(", ")}


def named(heading: str) -> str | None:
    """Return the canonical name of the quantity that a symbol or word stands for, None of others.

    Examples
    --------
    >>> named("E_stor"), named("G''"), named("colour")
    ('storage_modulus', 'loss_modulus', None)
    """
    return _NAME_OF.get(fold(heading))

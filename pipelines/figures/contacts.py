"""Figures 3.13 to 3.16 and C.1: contact and motion, contact spots and radii, the heated sphere."""

from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.patches import Circle

from labpipe import signals
from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.report import line_arguments
from pipelines.figures.drawing import Drawing, label_outside, legend_above, letter, panels, right_axis
from pipelines.figures.inputs import Inputs, is_heated, temperature_of, with_u

_IMPACTS = 3
_RADIUS: dict[str, Any] = {"color": "#00795a", "marker": "s", "markersize": 2.4, "linestyle": "none"}
_SHADES = {"bouncing": "#dceaf5", "vibration": "#fbe9d3", "static": "#e4efe4"}
_LETTERS = "abcd"


def _first_contact(inputs: Inputs, film: str) -> float:
    """Return the time [s] of first contact on a film's clock, by the largest radius and the simulated time to it."""
    return float(inputs.result(film, "impacts")["peak_time"][0] - _rises(inputs, film)[0])


def _rises(inputs: Inputs, film: str) -> Floats:
    """Return the simulated time (impact,) in s from touch to the largest radius."""
    peaks = inputs.result(film, "comparison")["model_peak_time"].values[:_IMPACTS]
    return np.asarray(peaks - inputs.result(film, "model")["impact_time"].values[: peaks.size])


def _pairs(inputs: Inputs) -> list[tuple[str, str, float]]:
    """Return laser experiment and film of the same drop height, from the lowest."""
    films = {s.height.value: n for n, s in inputs.of_kind("contact_area").items()}
    drops = inputs.of_kind("ball_drop").items()
    pairs = [(name, films[s.height.value], s.height.value) for name, s in drops if s.height.value in films]
    if not pairs:
        raise InputError("no film under the disc and no laser recordings of acrylic share a drop height")
    return pairs


def _draw_both(
    inputs: Inputs, place: Any, pair: tuple[str, str, float], end: float, *, begin: float = -25.0, is_named: bool = True
) -> Any:
    """Draw displacement and, on the right axis, contact radius of one height over some ms; return that axis."""
    drop, film, _ = pair
    repeats, seen = inputs.result(drop, "repeats"), inputs.result(film, "radius")
    t = repeats["time"].values * 1e3
    inside = (t >= begin) & (t <= end)
    moved, label = repeats["displacement_mean"].values[inside] * 1e3, f"displacement, laser, {inputs.origin}"
    place.plot(t[inside], moved, label=label, **(line_arguments("measured") | {"linewidth": 0.9}))
    place.set(xlabel="time $t_c$ (ms)", ylabel="displacement (mm)", xlim=(begin, end))
    other = right_axis(place, "contact radius (µm)", is_named=is_named)
    time, a = (seen["time"].values - _first_contact(inputs, film)) * 1e3, seen["radius"].values * 1e6
    shown = seen["in_contact"].values.astype(bool) & np.isfinite(a)
    other.plot(time[shown], a[shown], label=f"contact radius, film, {inputs.origin} (right axis)", **_RADIUS)
    other.set(ylim=(0, None))
    return other


def phases(inputs: Inputs) -> Drawing:
    """Figure 3.13: bouncing, vibration and rest in displacement and contact radius."""
    drop, film, height = pair = _pairs(inputs)[0]
    impacts, model, seen = (inputs.result(film, stage) for stage in ("impacts", "model", "radius"))
    events = inputs.result(drop, "bounces", inputs.experiments[drop].laser[0])
    settled, rest = ((float(events[f"{n}_time"] - events["first_contact_time"])) * 1e3 for n in ("settling", "rest"))
    recorded = float(inputs.result(drop, "repeats")["time"].max() * 1e3)
    end = max(float(seen["time"].max() - _first_contact(inputs, film)) * 1e3, recorded)
    edges = [e for e in (0.0, settled, rest, end if np.isfinite(rest) else recorded) if np.isfinite(e)]
    hertz = [float(model[f"static_radius_{name}"]) * 1e6 for name in ("brief", "lasting")]
    with panels(1, 1, width=2, aspect=0.42) as (figure, axes):
        place = axes[0, 0]
        other = _draw_both(inputs, place, pair, end)
        other.set_ylim(top=1.25e6 * float(np.nanmax(seen["radius"])))
        other.axhspan(*hertz, color="#8a3a6b", alpha=0.3, linewidth=0, label="Hertz at rest")
        for name, (low, high) in zip(signals.PHASES[2:], pairwise(edges), strict=False):
            place.axvspan(low, high, color=_SHADES[name], linewidth=0, zorder=-1)
            top = {"ha": "center", "va": "top", "fontsize": 7, "transform": place.get_xaxis_transform()}
            place.text(0.5 * (low + high), 0.97, name, **top)
        starts = (impacts["peak_time"].values - float(impacts["peak_time"][0])) * 1e3
        for number, at in enumerate(zip(starts, impacts["peak_radius"].values * 1e6, strict=True), start=1):
            other.annotate("I" * number, at, (0, 3), textcoords="offset points", ha="center", fontsize=7)
        legend_above(figure, [place, other])
    until = f"{rest:.0f} ms, static from then on"
    return Drawing(
        f"Displacement and contact radius of an acrylic sphere dropped from {height * 1e3:g} mm, over time from first "
        "contact; shaded: the phases, found in the laser's record. I, II, III: the impacts that are analysed.",
        figure,
        computed=(
            f"phases: bouncing until {settled:.0f} ms (the last touch after which no flight is resolved), vibration "
            f"until {until if np.isfinite(rest) else f'the end of the record at {recorded:.0f} ms'}. Band: Hertz "
            "radius under the weight, with the creep from an impact's duration to the film's end, "
            f"{hertz[0]:.0f} to {hertz[1]:.0f} µm; the film at rest shows {with_u(impacts, 'static_radius')} µm."
        ),
        **inputs.data_note(
            f"the laser recordings {drop} and the film {film}. A film of reduced size is dense around the first three "
            "impacts and at rest only."
        ),
    )


def four_heights(inputs: Inputs) -> Drawing:
    """Figure C.1: displacement and contact radius at each drop height."""
    pairs = _pairs(inputs)[:4]
    top = 1.15e6 * max(float(np.nanmax(inputs.result(film, "radius")["radius"])) for _, film, _ in pairs)
    rows = (len(pairs) + 1) // 2
    with panels(rows, min(2, len(pairs)), width=2, aspect=0.3 * rows) as (figure, axes):
        for number, pair in enumerate(pairs):
            place = axes.flat[number]
            # The third impact comes after about five times the first fall.
            end = 1e3 * 6.5 * float(np.sqrt(2 * pair[2] / 9.81))
            other = _draw_both(inputs, place, pair, end, is_named=number % 2 == 1 or pair is pairs[-1])
            other.set_ylim(top=top)
            place.yaxis.label.set_visible(number % 2 == 0)
            letter(place, _LETTERS[number], f"$h_0$ = {pair[2] * 1e3:g} mm")
        for unused in axes.flat[len(pairs) :]:
            unused.set_visible(False)
        legend_above(figure, [axes.flat[0], other])
    return Drawing(
        "Displacement by laser and contact radius by film of an acrylic sphere, over time from first contact.",
        figure,
        computed="each film is aligned with the laser's record at first contact only.",
        **inputs.data_note(
            "mean of the laser recordings and the radius fitted to the interference fringes; "
            "between the bursts around the impacts a film of reduced size has few frames."
        ),
    )


def spots(inputs: Inputs) -> Drawing:
    """Figure 3.14: images of the contact at its largest and at rest, with the model's circles."""
    name = next(iter(inputs.of_kind("contact_area")))
    keys, impacts = inputs.result(name, "keys"), inputs.result(name, "impacts")
    model, made = inputs.result(name, "model"), inputs.result(name, "comparison")
    film = inputs.result(name, "radius")
    size = float(film["pixel_size"]) * 1e6
    first = _first_contact(inputs, name)
    chosen = [
        (_key_at(keys, float(t)), float(r) * 1e6, "I" * number)
        for number, (t, r) in enumerate(zip(impacts["peak_time"], made["peak_radius_model"], strict=False), start=1)
    ]
    chosen.append((keys.sizes["key"] - 1, float(model["contact_radius"][-1]) * 1e6, "at rest"))
    notes = []
    aspect = 0.12 + len(chosen) * (0.09 + 0.86 * _shown_share(keys, size))
    with panels(len(chosen), 1, width=1, aspect=aspect, sharex="all") as (figure, axes):
        for number, (key, radius, word) in enumerate(chosen):
            at, place = keys.isel(key=key), axes[number, 0]
            fitted = _spot(place, at, film, radius)
            place.set_ylabel("y (µm)")
            letter(place, _LETTERS[number], f"{word}, $t_c$ = {(float(at['key_time']) - first) * 1e3:.1f} ms")
            notes.append(f"{word}: {fitted:.1f} µm in this frame, model {radius:.1f} µm")
        axes[-1, 0].set_xlabel("x (µm)")
        legend_above(figure, axes[0, 0])
    return Drawing(
        "The contact of an acrylic sphere through the disc at the largest radius of the first impacts and at rest, "
        f"from {inputs.experiments[name].height.value * 1e3:g} mm; t_c is the time since first contact.",
        figure,
        computed=(
            "orange: contact circle of the simulated drop, centred on the fit; light blue, "
            f"dashed: circle fitted to the fringes. {'; '.join(notes)}."
        ),
        difference="the printed caption gives 2.17 mm per pixel; 2.17 µm is meant. The radii are not printed.",
        **inputs.data_note(f"frames of the film {name}, {size:.3f} µm per pixel."),
    )


def _key_at(keys: Any, time: float) -> int:
    """Return the number of the key frame that is nearest to a time [s]."""
    return int(np.argmin(np.abs(keys["key_time"].values - time)))


def _shown_share(keys: Any, size: float, reach: float = 1250.0) -> float:
    """Return height over width of the part of a frame that is shown, ``reach`` µm on either side of the centre."""
    rows, columns = keys["image"].shape[-2:]
    scale = size * float(keys["reduction"])
    return rows * scale / min(columns * scale, 2 * reach)


def _spot(place: Any, at: Any, film: Any, radius: float | None, reach: float = 1250.0) -> float:
    """Draw a frame around its fitted centre, in µm, with the model's circle if there is one; return the fitted radius.

    ``film`` holds the results of all frames.
    """
    found, size, reduction = film.sel(frame=int(at["frame"])), float(film["pixel_size"]) * 1e6, float(at["reduction"])
    x, y, fitted = float(found["centre_x"]), float(found["centre_y"]), float(found["radius"]) * 1e6
    rows, columns = at["image"].shape
    # Pixel centres are whole numbers: the image reaches half a pixel further on every side.
    left, right = (-0.5 - x) * size, (columns * reduction - 0.5 - x) * size
    low, high = (-0.5 - y) * size, (rows * reduction - 0.5 - y) * size
    place.imshow(at["image"].values, cmap="gray", extent=(left, right, -high, -low), interpolation="nearest")
    if radius is not None:
        place.add_patch(Circle((0, 0), radius, fill=False, edgecolor="#ff8c1a", linewidth=2.0, label="model"))
    place.add_patch(
        Circle((0, 0), fitted, fill=False, edgecolor="#56c8ff", linewidth=1.1, linestyle=(0, (4, 3)), label="fit")
    )
    place.set(xlim=(max(left, -reach), min(right, reach)), ylim=(-high, -low))
    place.grid(visible=False)
    return fitted


def heated(inputs: Inputs) -> Drawing:
    """Figure 3.16: contact radius and images at room temperature and heated, first impacts and at rest."""
    pair = _temperatures(inputs)
    looks = ({"color": "#0066a6", "marker": "o"}, {"color": "#cc2a1e", "marker": "s"})
    films = [inputs.result(name, "radius") for name, _ in pair]
    share = max(_shown_share(inputs.result(pair[0][0], "keys"), float(films[0]["pixel_size"]) * 1e6), 0.12)
    ratios = (1.0, share, share)
    with panels(3, _IMPACTS + 1, width=2, aspect=0.14 + 0.25 * sum(ratios), height_ratios=ratios) as (figure, axes):
        rise = _rises(inputs, pair[0][0])
        for row, (look, (name, label)) in enumerate(zip(looks, pair, strict=True), start=1):
            for number in range(_IMPACTS):
                _heated_impact(axes[0, number], inputs, name, label, number, float(rise[number]), look)
            _heated_rest(axes[0, _IMPACTS], inputs, name, label, look)
            keys, impacts = inputs.result(name, "keys"), inputs.result(name, "impacts")
            frames = [_key_at(keys, t) for t in impacts["peak_time"].values[:_IMPACTS]] + [keys.sizes["key"] - 1]
            for place, key in zip(axes[row], frames, strict=True):
                _spot(place, keys.isel(key=key), films[row - 1], None)
                place.set(yticks=[], xticks=(-500, 0, 500))
                place.tick_params(labelbottom=row == len(pair))
                for edge in place.spines.values():
                    edge.set(visible=True, color=look["color"], linewidth=1.2)
            axes[row, 0].set_ylabel(label, color=look["color"], rotation=0, ha="right", va="center")
        warming = _warming(inputs, pair)
        for number, (impact, film, _, u) in enumerate(warming):
            letter(axes[0, number], _LETTERS[number], f"{impact}: {film:+.1f} ± {u:.1f} µm")
        label_outside(axes[1:], "x (µm)")
        label_outside(axes[:1, :_IMPACTS], "time $t_p$ (ms)", "contact radius (µm)")
        letter(axes[0, _IMPACTS], _LETTERS[_IMPACTS], "at rest")
        axes[0, _IMPACTS].margins(x=0.5, y=0.1)
        axes[0, _IMPACTS].set_ylabel("radius (µm)")
        legend_above(figure, axes[0, 0])
    notes = [f"{impact} {film:+.1f} ± {u:.1f} (model {model:+.1f}) µm" for impact, film, model, u in warming]
    at_rest = " and ".join(with_u(inputs.result(name, "impacts"), "static_radius") for name, _ in pair)
    words = ["not distinguished" if abs(d) < 2 * u else "larger" if d > 0 else "smaller" for _, d, _, u in warming]
    larger = ", ".join(f"{word} in {impact}" for word, (impact, *_) in zip(words, warming, strict=True))
    return Drawing(
        "Contact radius of an acrylic sphere at room temperature and heated, dropped from "
        f"{inputs.experiments[pair[0][0]].height.value * 1e3:g} mm: (a) to (c) the first three impacts, over a common "
        "time: from the touch of each impact, with t_p = 0 where the contact at room temperature is largest; (d) at "
        "rest (bars: 95 %; dashes and boxes: the simulation at the end of the film, 95 %). Below: the frame nearest to "
        "the largest radius and one at rest, with the circle fitted to the fringes. Above each impact: the largest "
        "radius by film, heated minus room temperature, with its standard uncertainty.",
        figure,
        computed=(
            "simulated drops; the heated one with the material shifted by its law. A film is laid on the "
            "simulation of its own impact in time. Largest radius, heated minus room temperature (their common scale "
            f"counts in u, though it cancels): {'; '.join(notes)}; at rest {at_rest} µm."
        ),
        difference=(
            "the thesis prints no radii; it says that the heated contact is larger in every "
            f"impact and at rest, and forms earlier. Here {larger}: what is softer also "
            "bounces lower, and falls slower onto the next impact. A softer contact takes longer to its largest "
            "radius; what comes earlier is the next impact."
        ),
        **inputs.data_note(f"the films {pair[0][0]} and {pair[1][0]}."),
    )


def _heated_impact(
    place: Any,
    inputs: Inputs,
    name: str,
    label: str,
    number: int,
    rise: float,
    look: dict[str, str],
    reach: float = 0.8,
) -> None:
    """Draw one impact of one film and its model over the time from touch less ``rise`` [s], within ``reach`` ms."""
    made, model = inputs.result(name, "comparison"), inputs.result(name, "model")
    inside = made["impact_number"].values == number + 1
    late = float(_rises(inputs, name)[number]) - rise
    seen = made["since_peak"].values[inside] + float(made["time_shift"][number]) + late
    a, u = (made[n].values[inside] * 1e6 for n in ("film", "u_film"))
    place.errorbar(seen * 1e3, a, 2 * u, label=f"film, {label}", markersize=2.6, linestyle="none", capsize=1.5, **look)
    since, radius = _around_peak(model, float(made["model_peak_time"][number]))
    place.plot(since + late * 1e3, radius, color=look["color"], linewidth=0.9, label=f"model, {label}")
    place.set(xlim=(-reach, reach), ylim=(0, None))


def _heated_rest(place: Any, inputs: Inputs, name: str, label: str, look: dict[str, str]) -> None:
    """Draw the radius at rest of one film, and for its model a dash with its 95 % band."""
    impacts, model = inputs.result(name, "impacts"), inputs.result(name, "model")
    seen, u = (float(impacts[f"{prefix}static_radius"]) * 1e6 for prefix in ("", "u_"))
    place.errorbar([label], [seen], yerr=[2 * u], markersize=3.5, capsize=2, **look)
    rest = float(model["contact_radius"][-1]) * 1e6
    relative = float(model["u_static_radius_lasting"]) / float(model["static_radius_lasting"])
    box = place.bar(label, 4 * relative * rest, 0.5, (1 - 2 * relative) * rest, color=look["color"], alpha=0.25)
    box[0].sticky_edges.y.clear()  # the axis leaves room below it too
    place.plot([label], [rest], marker="_", markersize=14, color=look["color"])


def _temperatures(inputs: Inputs) -> list[tuple[str, str]]:
    """Film at room temperature and heated film of the same height, with their labels."""
    films = inputs.of_kind("contact_area")
    warm = next(n for n, s in films.items() if is_heated(s))
    height = films[warm].height.value
    cold = [n for n, s in films.items() if not is_heated(s) and s.height.value == height]
    if not cold:
        raise InputError(f"no film at room temperature shares the drop height of {warm}")
    return [(cold[0], "room"), (warm, f"{temperature_of(films[warm]):g} °C")]


def _warming(inputs: Inputs, pair: list[tuple[str, str]]) -> list[tuple[str, float, float, float]]:
    """Return, of each impact, its name and the largest radius in µm, heated minus room: film, model, u of the film."""
    cold, warm = (inputs.result(name, "comparison") for name, _ in pair)
    film, model = (1e6 * (warm[n] - cold[n]).values for n in ("peak_radius_film", "peak_radius_model"))
    u = 1e6 * np.hypot(cold["u_peak_radius_film"].values, warm["u_peak_radius_film"].values)
    return [("I" * (n + 1), float(film[n]), float(model[n]), float(u[n])) for n in range(_IMPACTS)]


def contact_radius(inputs: Inputs) -> Drawing:
    """Figure 3.15: contact radius of the first impacts at each height, film and model."""
    chosen = inputs.of_kind("contact_area", most=4)
    notes = []
    shape: dict[str, Any] = {"aspect": 0.1 + 0.26 * len(chosen), "sharex": "all", "sharey": "row"}
    with panels(len(chosen), _IMPACTS, width=2, **shape) as (figure, axes):
        for row, (name, settings) in enumerate(chosen.items()):
            made, height = inputs.result(name, "comparison"), f"{settings.height.value * 1e3:g} mm"
            for number, place in enumerate(axes[row]):
                inside = made["impact_number"].values == number + 1
                t, a, u = (made[n].values[inside] for n in ("since_peak", "film", "u_film"))
                points = line_arguments("measured", style="points") | {"capsize": 1.5}
                place.errorbar(t * 1e3, a * 1e6, 2e6 * u, label=f"film, {inputs.origin}", **points)
                peak = float(made["model_peak_time"][number])
                place.plot(*_around_peak(inputs.result(name, "model"), peak), label="model", **line_arguments("model"))
                place.set_ylim(bottom=0.0)
                letter(place, _LETTERS[row], f"$h_0$ = {height}, {'I' * (number + 1)}")
            gaps = [with_u(made, "peak_radius_difference", impact=number) for number in range(_IMPACTS)]
            notes.append(f"{height}: {', '.join(gaps)} µm")
        label_outside(axes, "time from largest radius $t_p$ (ms)", "contact radius (µm)")
        legend_above(figure, axes[0, 0])
    return Drawing(
        "Contact radius of the first impacts (I, II, III) at each drop height, t_p = 0 at the largest radius; "
        "bars: two standard uncertainties.",
        figure,
        computed=f"simulated drops; largest radius, film minus model: {'; '.join(notes)}.",
        **inputs.data_note("contact radius from the interference fringes of films."),
    )


def _around_peak(model: Any, peak: float, reach: float = 0.8) -> tuple[Floats, Floats]:
    """Return the simulated contact within ``reach`` ms of a largest radius at ``peak`` s: time in ms, radius in µm."""
    since = (model["time"].values - peak) * 1e3
    shown = np.abs(since) <= reach
    radius = model["contact_radius"].values[shown] * 1e6
    return since[shown], np.where(radius > 0, radius, np.nan)

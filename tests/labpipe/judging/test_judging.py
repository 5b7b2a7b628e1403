from dataclasses import replace
from math import cos, exp, radians

import numpy as np
import pytest
from scipy import stats

from labpipe.errors import InputError
from labpipe.judging import (
    Cause,
    Check,
    agreement,
    bounded,
    compared,
    detectable,
    explain,
    fitted_errors,
    from_json,
    judge,
    model_verdict,
    not_made,
    to_json,
)

G = 9.81


def drop_checks(interval=1.0, scale=1.0, height=1.0, seed=None, u=0.003):
    """Acceleration and fall of a drop whose inputs are too large by factors."""
    random = np.random.default_rng(seed)
    noise = random.normal(0.0, u, 2) if seed is not None else (0.0, 0.0)
    g = G * scale / interval**2 * exp(noise[0])
    fall = 1.5e-3 * scale * exp(noise[1])
    stated_height = 1.5e-3 * height
    return [
        compared("acceleration", "", g, u * g, G, 0.0),
        compared("fall", "", fall, u * fall, stated_height, u * stated_height),
    ]


CAUSES = (
    Cause({"acceleration": -2.0}, lambda k: f"interval {k:.3g}", usual=(0.5, 2.0, 10.0, 0.1)),
    Cause(
        {"acceleration": 1.0, "fall": 1.0},
        lambda k: f"scale {k:.3g}",
        usual=(1e3, 1e-3, 25.4, 10.0, 0.1, 1 / cos(radians(12))),
    ),
    Cause({"fall": -1.0}, lambda k: f"height {k:.3g}", usual=(10.0, 0.1)),
)


@pytest.mark.parametrize(
    ("factors", "expected"),
    [
        ({"interval": 0.5}, "interval 0.5"),
        ({"interval": 1.02}, "interval 1.02"),
        ({"scale": 1000.0}, "scale 1e+03"),
        ({"scale": 25.4}, "scale 25.4"),
        ({"height": 10.0}, "height 10"),
        ({"height": 1.2}, "height 1.2"),
    ],
)
def test_redundancy_names_the_factor(factors, expected):
    judged = judge(drop_checks(**factors, seed=1), CAUSES)
    assert judged.causes[0] == expected
    assert judged.believable == "impossible"
    assert all(f.cause == expected for f in judged.findings)


def test_causes_that_cannot_be_told_from_each_other_are_listed_together():
    causes = [Cause({"fall": 1.0}, lambda k: f"scale {k:.2g}"), *CAUSES[2:]]
    judged = judge(drop_checks(height=1.2), causes)
    assert [f.cause for f in judged.findings] == ["scale 0.83; or height 1.2"]
    # a factor that people are known to get wrong is told alone
    assert [f.cause for f in judge(drop_checks(height=10.0), causes).findings] == ["height 10"]


def test_a_clean_record_is_believed_and_what_no_factor_explains_has_no_cause():
    judged = judge(drop_checks(seed=2), CAUSES)
    assert (judged.believable, judged.findings, judged.causes) == ("yes", (), ())
    assert judged.n_made == 2
    checks = [*drop_checks(interval=0.5), compared("third", "", 5.0, 0.01, 1.0, 0.01)]
    assert not explain(checks, CAUSES[:1])
    assert not explain(drop_checks(height=5e3), [Cause({"fall": -1.0}, str)])  # beyond 1000 only units are wrong


def test_false_alarms_are_as_rare_as_the_levels_say():
    alarms = sum(judge(drop_checks(seed=s), CAUSES).believable != "yes" for s in range(500))
    assert alarms <= 2


@pytest.mark.parametrize(("value", "level"), [(0.9, None), (1.0 + 4.5e-4, "doubtful"), (1.195, "impossible")])
def test_a_law_must_be_broken_by_more_than_the_noise_and_a_difference_exceed_systematic_effects(value, level):
    assert bounded("e", "", value, 1e-4, at_least=0.0, at_most=1.0).level == level
    assert compared("g", "", 9.7, 0.001, G, 0.001, allowance=0.2).level is None


def test_a_check_of_five_recordings_is_one_row_with_its_worst_margin():
    found = [replace(drop_checks(seed=s)[0], title="free fall", recording=f"drop_{s}.csv") for s in range(5)]
    wrong = replace(drop_checks(interval=0.5)[0], title="free fall", recording="drop_4.csv")
    judged = judge(found, laws={"free fall": "flights are parabolas"})
    (row,) = judged.rows
    assert judged.n_made == judged.n_passed == 1
    assert row.law == "flights are parabolas"
    assert row.summary.startswith("passed in 5 of 5 recordings, worst margin ")
    assert float(row.summary.split()[-2]) == pytest.approx(max(abs(c.margin) for c in found), abs=0.05)
    (row,) = judge([*found[:4], wrong]).rows
    assert (row.worst.level, row.worst.recording) == ("impossible", "drop_4.csv")
    assert row.summary.startswith("impossible in 1 of 5 recordings")


def test_a_doubtful_reading_comes_before_the_step_that_failed_for_it_and_gives_its_cause():
    step = Check("step bounces", "no flights", "impossible", cause="any cause", file="a.csv", is_generic=True)
    clipped = Check("clipped", "flat", "doubtful", cause="out of range", file="a.csv", recording="a.csv")
    other = replace(clipped, cause="another", file="b.csv", recording="b.csv")
    judged = judge([step, other, clipped])
    assert [f.cause for f in judged.findings] == ["another", "out of range", "out of range"]
    assert judge([step]).findings[0].cause == "any cause"


def test_a_finding_names_its_file_and_line_and_without_checks_nothing_is_known():
    cause = Cause({"fall": -1.0}, lambda k: "the height", file="session.toml", line=7)
    found = judge(drop_checks(height=3.0), [cause]).findings[0]
    assert (found.file, found.line, found.cause) == ("session.toml", 7, "the height")
    judged = judge([not_made("fall", "a stated height")])
    assert (judged.believable, judged.n_made) == ("unknown", 0)


def test_judgements_survive_json():
    judged = judge([*drop_checks(scale=10.0), Check("bytes", "twice", "note")], CAUSES)
    again = from_json(to_json(judged))
    assert again.findings == judged.findings
    assert again.causes == judged.causes
    assert to_json(again) == to_json(judged)


def shared(n, own, common):
    return own**2 * np.eye(n) + common**2


def test_chi_square_is_what_it_says_under_the_model():
    random = np.random.default_rng(3)
    C = shared(6, 1.0, 3.0)
    root = np.linalg.cholesky(C)
    p = [agreement(root @ random.normal(size=6), C).p for _ in range(400)]
    assert stats.kstest(p, "uniform").pvalue > 0.01


def test_what_rows_share_is_counted_once():
    C = shared(50, 0.1, 1.0)
    together = agreement(np.full(50, 2.0), C)
    assert together.p > 0.5
    assert agreement(np.full(50, 2.0), np.diag(np.diagonal(C))).p < 1e-6


def test_what_is_allowed_and_not_expected_is_no_degree_of_freedom():
    random = np.random.default_rng(7)
    expected = shared(4, 0.0, 1.0) + np.diag([0.3, 0.3, 0.0, 0.0])
    slack = np.array([0.0, 0.0, 0.01, 0.01])
    C = expected + np.diag(slack)
    drawn = random.multivariate_normal(np.zeros(4), expected, size=800)
    found = [agreement(d, C, slack) for d in drawn]
    freedom = float(np.trace(np.linalg.solve(C, expected)))  # the mean of chi square
    assert [one.degrees_of_freedom for one in found] == pytest.approx([freedom] * 800)
    assert np.mean([one.chi2 for one in found]) == pytest.approx(freedom, abs=4 * np.sqrt(6 / 800))
    assert stats.kstest([one.p for one in found], "uniform").pvalue > 0.01
    # Counted as expected, they make every p too close to one.
    assert np.mean([agreement(d, C).p for d in drawn]) > 0.6


def test_verdicts_of_models():
    fine, off = agreement([0.1], [[1.0]]), agreement([5.0], [[1.0]])
    between = agreement([2.5], [[1.0]])
    with pytest.raises(InputError, match="without uncertainty"):
        agreement([1.0], [[0.0]])
    assert model_verdict(None, could_notice=True) == "none"
    assert model_verdict(fine, could_notice=True) == "agrees"
    assert model_verdict(fine, could_notice=False) == "undecided"
    assert model_verdict(between, could_notice=True) == "undecided"
    assert model_verdict(off, could_notice=True) == "differs"
    assert model_verdict(fine, could_notice=True, curves=(1e-5, 0.5)) == "differs"
    assert model_verdict(fine, could_notice=True, curves=(1e-3, 0.5)) == "agrees"  # of two curves one is so by chance
    alone = agreement([3.8, 0.0, 0.0, 0.0], np.eye(4))  # p of all is 0.006, of one among four 0.0006
    assert model_verdict(alone, could_notice=True) == "differs"
    assert model_verdict(agreement([3.5, 0.0, 0.0, 0.0], np.eye(4)), could_notice=True) == "undecided"


def test_a_detectable_error_is_shown_as_often_as_said():
    random = np.random.default_rng(4)
    C, s = shared(5, 1.0, 0.5), np.array([1.0, 2.0, 0.0, -1.0, 0.5])
    error = float(detectable(s[:, None], C)[0])
    limit = stats.chi2.isf(0.05, 5)
    root = np.linalg.cholesky(C)
    shown = np.mean([agreement(root @ random.normal(size=5) + error * s, C).chi2 > limit for _ in range(1000)])
    assert shown == pytest.approx(0.95, abs=0.02)


def test_the_input_that_was_stated_wrongly_explains_most():
    """Five rows, three inputs with effects of their own, a fourth that looks like the first, and one without."""
    generator = np.random.default_rng(3)
    S = generator.normal(size=(5, 3))
    S = np.column_stack([S, 2.0 * S[:, 0], np.zeros(5)])
    C = np.diag(generator.uniform(0.5, 2.0, 5)) + 0.3
    root = np.linalg.cholesky(C)
    for wrong in range(3):
        found = [fitted_errors(12.0 * S[:, wrong] + root @ generator.normal(size=5), S, C) for _ in range(200)]
        assert np.mean([np.argmax(shares) % 3 == wrong for _, shares in found]) > 0.95
    errors, shares = fitted_errors(12.0 * S[:, 0], S, C)
    assert errors[[0, 3, 4]] == pytest.approx([12.0, 6.0, 0.0])
    assert shares[[0, 3, 4]] == pytest.approx([1.0, 1.0, 0.0])


@pytest.mark.parametrize(("beside", "named"), [(1.3, True), (3.0, False)])
def test_a_usual_factor_is_named_beside_a_right_check_that_scatters(beside, named):
    wavelength = Cause({"fringes": 1.0}, lambda k: "wavelength", usual=(663 / 632.8,))
    checks = [
        compared("fringes", "", 1.042, 0.006, 1.0, 0.0),
        compared("duration", "", 1.0 + 0.1 * beside, 0.1, 1.0, 0.0),
    ]
    assert [e.sentence for e in explain(checks, [wavelength])] == ["wavelength"] * named


@pytest.mark.parametrize(("slack", "named"), [(0.02, "1.070"), (5e-3, "1.100")])
def test_of_a_dense_list_a_usual_factor_is_not_met_by_chance(slack, named):
    seen = [compared("fringes", "", 1.1, 1e-3, 1.0, 1e-3)]
    cause = Cause({"fringes": 1.0}, "{:.3f}".format, (1.07, 1.16), slack=slack)
    assert explain(seen, [cause])[0].sentence == named


def test_of_errors_beyond_every_uncertainty_that_explain_as_much_the_smallest_is_named_first():
    seen = [compared("fringes", "", 1.23, 1e-3, 1.0, 1e-3)]
    length = Cause({"fringes": 1.0}, lambda k: "wavelength", u=8e-4)
    scale = Cause({"fringes": -2.0}, lambda k: "scale", u=2e-3)
    assert [one.cause for one in explain(seen, [length, scale])] == [scale, length]

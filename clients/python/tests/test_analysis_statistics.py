"""Statistics against published values, and against other implementations."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from swarmseat.analysis.problems import TooLittleDataError
from swarmseat.analysis.statistics import (
    RIDGE_PENALTIES,
    Names,
    benjamini_hochberg,
    bootstrap_interval,
    correlate,
    fisher_interval,
    is_constant,
    least_squares,
    p_value,
    stars,
    variance_inflation,
)

X = [10, 8, 13, 9, 11, 14, 6, 4, 12, 7, 5]
ANSCOMBE = [
    (X, [8.04, 6.95, 7.58, 8.81, 8.33, 9.96, 7.24, 4.26, 10.84, 4.82, 5.68]),
    (X, [9.14, 8.14, 8.74, 8.77, 9.26, 8.10, 6.13, 3.10, 9.13, 7.26, 4.74]),
    (X, [7.46, 6.77, 12.74, 7.11, 7.81, 8.84, 6.08, 5.39, 8.15, 6.42, 5.73]),
    ([8, 8, 8, 8, 8, 8, 8, 19, 8, 8, 8], [6.58, 5.76, 7.71, 8.84, 8.47, 7.04, 5.25, 12.50, 5.56, 7.91, 6.89]),
]

# NIST StRD: total employment, then deflator, product, unemployed, armed forces, population, year.
LONGLEY = np.array(
    [
        [60323, 83.0, 234289, 2356, 1590, 107608, 1947],
        [61122, 88.5, 259426, 2325, 1456, 108632, 1948],
        [60171, 88.2, 258054, 3682, 1616, 109773, 1949],
        [61187, 89.5, 284599, 3351, 1650, 110929, 1950],
        [63221, 96.2, 328975, 2099, 3099, 112075, 1951],
        [63639, 98.1, 346999, 1932, 3594, 113270, 1952],
        [64989, 99.0, 365385, 1870, 3547, 115094, 1953],
        [63761, 100.0, 363112, 3578, 3350, 116219, 1954],
        [66019, 101.2, 397469, 2904, 3048, 117388, 1955],
        [67857, 104.6, 419180, 2822, 2857, 118734, 1956],
        [68169, 108.4, 442769, 2936, 2798, 120445, 1957],
        [66513, 110.8, 444546, 4681, 2637, 121950, 1958],
        [68655, 112.6, 482704, 3813, 2552, 123366, 1959],
        [69564, 114.2, 502601, 3931, 2514, 125368, 1960],
        [69331, 115.7, 518173, 4806, 2572, 127852, 1961],
        [70551, 116.9, 554894, 4007, 2827, 130081, 1962],
    ]
)
LONGLEY_BETA = [
    15.0618722713733,
    -0.358191792925910e-01,
    -2.02022980381683,
    -1.03322686717359,
    -0.511041056535807e-01,
    1829.15146461355,
]
LONGLEY_ERROR = [
    84.9149257747669,
    0.334910077722432e-01,
    0.488399681651699,
    0.214274163161675,
    0.226073200069370,
    455.478499142212,
]


def models(n: int, each: int = 1) -> Names:
    return np.array([f"model {at // each}" for at in range(n)], object)


@pytest.mark.parametrize(("x", "y"), ANSCOMBE)
def test_anscombes_quartet(x: list[float], y: list[float]) -> None:
    found = correlate(np.array(x, float), np.array(y), models(11))
    assert found.r == pytest.approx(0.816, abs=1e-3)
    fit = least_squares(np.array(x, float)[:, None], np.array(y), models(11))
    assert fit.beta[0] / np.std(x) == pytest.approx(0.5, abs=1e-3)
    assert fit.r2 == pytest.approx(0.667, abs=1e-3)
    assert fit.vif.tolist() == [1.0]


def test_longley_has_the_certified_values() -> None:
    y, x = LONGLEY[:, 0], LONGLEY[:, 1:]
    fit = least_squares(x, y, models(16, 2))
    scale = x.std(axis=0)
    assert fit.beta / scale == pytest.approx(LONGLEY_BETA, rel=1e-7)
    assert fit.error / scale == pytest.approx(LONGLEY_ERROR, rel=1e-7)
    assert fit.intercept - fit.beta @ (x.mean(axis=0) / scale) == pytest.approx(-3482258.63459582, rel=1e-7)
    assert fit.r2 == pytest.approx(0.995479004577296, rel=1e-9)
    # The textbook example of collinearity.
    assert fit.vif.max() > 1000
    assert fit.ridge is not None
    assert fit.penalty is not None
    assert np.abs(fit.ridge).sum() < np.abs(fit.beta).sum()


def test_the_penalty_of_the_ridge_regression_is_the_one_that_predicts_other_models_best() -> None:
    y, x = LONGLEY[:, 0], LONGLEY[:, 1:]
    names = models(16, 4)
    fit = least_squares(x, y, names)
    errors = []
    for penalty in RIDGE_PENALTIES:
        error = 0.0
        for name in set(names):
            own = names == name
            center, mean = fit.z[~own].mean(axis=0), y[~own].mean()
            z = fit.z[~own] - center
            beta = np.linalg.solve(z.T @ z + penalty * np.eye(6), z.T @ (y[~own] - mean))
            error += float(np.sum((y[own] - mean - (fit.z[own] - center) @ beta) ** 2))
        errors.append(error)
    assert fit.penalty == pytest.approx(RIDGE_PENALTIES[int(np.argmin(errors))])


def test_least_squares_needs_enough_rows() -> None:
    with pytest.raises(TooLittleDataError, match="at least 8 games with all of them, and there are 7"):
        least_squares(LONGLEY[:7, 1:], LONGLEY[:7, 0], models(7))


def test_a_model_that_is_left_out_is_predicted_from_the_others() -> None:
    # In each model the slope is 1, but the models differ: other models predict badly.
    x = np.tile(np.arange(4.0), 3)
    y = x + np.repeat([0.0, 50.0, 100.0], 4)
    fit = least_squares(x[:, None], y, models(12, 4))
    assert fit.r2 > 0
    assert fit.left_out < 0
    assert np.isnan(least_squares(x[:, None], y, models(12, 12)).left_out)


def test_a_column_that_others_determine_has_infinite_inflation() -> None:
    random = np.random.default_rng(1)
    z = random.normal(size=(30, 3))
    z[:, 2] = z[:, 0] + z[:, 1]
    z = (z - z.mean(axis=0)) / z.std(axis=0)
    assert np.isinf(variance_inflation(z)).all()
    z[:, 2] = random.normal(size=30)
    assert (variance_inflation(z) < 2).all()


def test_intervals_and_ranks_are_those_of_scipy() -> None:
    random = np.random.default_rng(2)
    x = random.normal(size=20)
    y = x + random.normal(size=20)
    found = correlate(x, y, models(20, 2))
    expected = stats.pearsonr(x, y)
    assert (found.r, found.p) == pytest.approx((expected.statistic, expected.pvalue))
    assert (found.low, found.high) == pytest.approx(tuple(expected.confidence_interval(0.95)))
    assert found.spearman == pytest.approx(pd.Series(x).rank().corr(pd.Series(y).rank()))
    assert p_value(found.r, 20) == pytest.approx(found.p)
    assert (found.n, found.models) == (20, 10)


OF_65 = """
-0.668 0.000 -0.185 0.140 -0.309 0.012 0.382 0.002 0.458 0.000 -0.102 0.419 -0.027 0.832 -0.447 0.000 -0.439 0.000
-0.134 0.286 -0.159 0.205 0.056 0.660 -0.115 0.361
"""
"""r and p of tables S.7 and S.8 of the paper: 13 models, five games each."""

OF_25 = """
0.241 0.246 -0.061 0.774 0.305 0.138 0.372 0.067 -0.147 0.483 -0.141 0.500 -0.044 0.835 -0.031 0.884 -0.307 0.136
-0.255 0.218 -0.499 0.011 -0.267 0.197 0.031 0.884 -0.231 0.267 -0.016 0.941 0.094 0.656 -0.144 0.493 -0.118 0.574
-0.135 0.520 -0.139 0.508 -0.528 0.007 -0.450 0.024 -0.338 0.098 -0.163 0.436 -0.005 0.980 -0.058 0.783
"""
"""r and p of table S.9: five tasks, five games each."""


@pytest.mark.parametrize(("published", "n"), [(OF_65, 65), (OF_25, 25)])
def test_every_published_p_follows_from_its_r(published: str, n: int) -> None:
    numbers = list(map(float, published.split()))
    for r, p in zip(numbers[::2], numbers[1::2], strict=True):
        # The paper prints three digits: p lies between the values of the ends of the rounding interval of r.
        ends = sorted(p_value(r + half, n) for half in (-0.0005, 0.0005))
        assert ends[0] - 0.0005 <= p <= ends[1] + 0.0005, r
    assert p_value(-1.0, 5) == 0.0


def test_games_of_one_model_that_are_alike_are_no_evidence() -> None:
    # The numbers of one model are nearly equal, and models are unrelated.
    x, y = (np.repeat([model * step % 13.0 for model in range(13)], 5) for step in (5, 8))
    game = np.tile(np.arange(5.0), 13)
    found = correlate(x + 0.01 * game, y - 0.02 * game, models(65, 5))
    assert found.boot_low < found.r < found.boot_high
    # Fisher's interval treats 65 games as independent, so it is about √5 times too narrow.
    assert found.boot_high - found.boot_low > 1.5 * (found.high - found.low)


def test_correlations_that_are_not_defined_are_missing() -> None:
    x = np.array([0.0, 1.0, 2.0, 3.0])
    assert np.isnan(correlate(x[:2], x[:2], models(2)).r)
    assert np.isnan(correlate(x, np.full(4, 0.1 + 0.2), models(4)).p)
    assert is_constant(np.array([0.3, 0.1 + 0.2]))
    assert np.isnan(fisher_interval(0.5, 3)).all()
    assert correlate(x, -x, models(4)).p == 0.0
    assert correlate(x, -x, models(4)).low == pytest.approx(-1.0)


def test_discoveries_are_controlled() -> None:
    p = np.array([0.01, 0.04, 0.03, np.nan, 0.5])
    assert benjamini_hochberg(p) == pytest.approx([0.04, 0.16 / 3, 0.16 / 3, np.nan, 0.5], nan_ok=True)
    assert [stars(p) for p in (0.0005, 0.005, 0.04, 0.05, float("nan"))] == ["***", "**", "*", "", ""]


def test_the_bootstrap_draws_models() -> None:
    # Within each model x and y go against each other, over the models together.
    x = np.repeat(np.arange(6.0) * 10, 3) + np.tile([0.0, 1.0, 2.0], 6)
    y = np.repeat(np.arange(6.0) * 10, 3) - np.tile([0.0, 1.0, 2.0], 6)
    low, high = bootstrap_interval(x, y, models(18, 3))
    assert 0.5 < low < correlate(x, y, models(18, 3)).r < high <= 1
    assert bootstrap_interval(x, y, models(18, 3)) == (low, high)
    assert np.isnan(bootstrap_interval(x, y, models(18, 9))).all()
    # A draw of resampled rows gives the same interval, up to chance.
    random, names, drawn = np.random.default_rng(5), sorted(set(models(18, 3))), []
    for _ in range(2000):
        rows = np.concatenate([np.flatnonzero(models(18, 3) == name) for name in random.choice(names, 6)])
        if np.ptp(x[rows]) > 2:
            drawn.append(np.corrcoef(x[rows], y[rows])[0, 1])
    assert np.quantile(drawn, [0.5, 0.975]) == pytest.approx([np.quantile(drawn, 0.5), high], abs=0.01)

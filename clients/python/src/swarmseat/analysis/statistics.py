"""Correlations and least squares, of arrays without missing values."""

import warnings
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import statsmodels.api as sm
from numpy.typing import NDArray
from scipy import stats

from .problems import TooLittleDataError

Floats = NDArray[np.float64]
Names = NDArray[np.object_]

BOOTSTRAP_DRAWS = 2000
BOOTSTRAP_MODELS_MIN = 5
"""The minimum number of models for a bootstrap: with fewer, most draws have one or two models, which says nothing."""
CONFIDENCE = 0.95

VIF_MAX = 10.0
"""The variance inflation from which on single coefficients are too uncertain, and a ridge regression is shown, too."""

MEAN_QUANTILE = 0.9875
"""The quantile of Student's t for the ends of an interval of 95 %, as on boards: scores are skewed."""
MEAN_VALUES_MIN = 3
"""The minimum number of values for such an interval."""

RIDGE_PENALTIES = np.logspace(-3, 4, 71)


class Correlation(NamedTuple):
    """The correlation of a metric with the score. Undefined values are NaN.

    Attributes:
        n: The number of pairs of values.
        r: Pearson's coefficient.
        p: The two-sided p, from Student's t with n - 2 degrees of freedom.
        low: The lower end of the 95 % interval by Fisher's transformation.
        high: The upper end of this interval.
        spearman: Spearman's rank correlation.
        models: The number of models.
        boot_low: The lower end of the 95 % interval of a bootstrap that draws models: games of a model are not
            independent.
        boot_high: The upper end of this interval.
    """

    n: int
    r: float
    p: float
    low: float
    high: float
    spearman: float
    models: int
    boot_low: float
    boot_high: float


def is_constant(values: Floats) -> bool:
    """Whether the values differ at most by rounding errors."""
    return bool(np.ptp(values) <= 1e-12 * np.abs(values).max()) if len(values) else True


def correlate(x: Floats, y: Floats, models: Names) -> Correlation:
    """Correlates two metrics over games. All values are NaN with fewer than three games, or if a metric is constant."""
    n, groups = len(x), len(set(models))
    nan = float("nan")
    if n < 3 or is_constant(x) or is_constant(y):
        return Correlation(n, nan, nan, nan, nan, nan, groups, nan, nan)
    r, p = stats.pearsonr(x, y)
    low, high = fisher_interval(float(r), n)
    rank = float(stats.spearmanr(x, y).statistic)
    return Correlation(n, float(r), float(p), low, high, rank, groups, *bootstrap_interval(x, y, models))


def p_value(r: float, n: int) -> float:
    """The two-sided p of Pearson's r over n pairs."""
    if abs(r) >= 1:
        return 0.0
    return float(2 * stats.t.sf(abs(r) * np.sqrt((n - 2) / (1 - r * r)), n - 2))


def fisher_interval(r: float, n: int) -> tuple[float, float]:
    """The 95 % interval of Pearson's r by Fisher's transformation; NaN for fewer than four pairs."""
    if n < 4:
        return float("nan"), float("nan")
    if abs(r) >= 1:
        return r, r
    half = stats.norm.ppf((1 + CONFIDENCE) / 2) / np.sqrt(n - 3)
    return float(np.tanh(np.arctanh(r) - half)), float(np.tanh(np.arctanh(r) + half))


def bootstrap_interval(x: Floats, y: Floats, models: Names, seed: int = 1) -> tuple[float, float]:
    """The 95 % interval of Pearson's r if models are drawn with replacement, each with all its games."""
    names, at = np.unique(models.astype(str), return_inverse=True)
    if len(names) < BOOTSTRAP_MODELS_MIN:
        return float("nan"), float("nan")
    x, y = (x - x.mean()) / x.std(), (y - y.mean()) / y.std()
    # A draw needs only the sums of each model.
    terms = np.stack([np.ones_like(x), x, y, x * x, y * y, x * y])
    sums = np.stack([np.bincount(at, term, len(names)) for term in terms])
    drawn = np.random.default_rng(seed).multinomial(len(names), np.full(len(names), 1 / len(names)), BOOTSTRAP_DRAWS)
    n, sx, sy, sxx, syy, sxy = sums @ drawn.T
    spread = (sxx - sx * sx / n) * (syy - sy * sy / n)
    valid = spread > 1e-12
    r: Floats = (sxy - sx * sy / n)[valid] / np.sqrt(spread[valid])
    if not valid.any():
        return float("nan"), float("nan")
    low, high = np.quantile(r, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)


def mean_interval(values: Floats) -> tuple[float, float, float]:
    """The mean and the ends of its 95 % interval, as on boards; NaN for what the values do not allow."""
    nan, n = float("nan"), len(values)
    if n == 0:
        return nan, nan, nan
    mean = float(values.mean())
    if n < MEAN_VALUES_MIN:
        return mean, nan, nan
    half = float(stats.t.ppf(MEAN_QUANTILE, n - 1) * values.std(ddof=1) / np.sqrt(n))
    return mean, mean - half, mean + half


def benjamini_hochberg(p: Floats) -> Floats:
    """The q values, which control the false discovery rate among all p that are numbers."""
    q = np.full_like(p, np.nan)
    known = ~np.isnan(p)
    if known.any():
        q[known] = stats.false_discovery_control(p[known])
    return q


def stars(p: float) -> str:
    """`*` below 0.05, `**` below 0.01, `***` below 0.001."""
    return "*" * sum(p < limit for limit in (0.05, 0.01, 0.001))


@dataclass(frozen=True)
class Fit:
    """Least squares on standardised columns.

    Attributes:
        z: The columns, with mean 0 and population deviation 1.
        intercept: The mean of y.
        beta: The coefficients of the columns of z.
        error: The coefficients' standard errors, with n - p - 1 degrees of freedom.
        p: The coefficients' two-sided p.
        vif: The columns' variance inflation factors.
        r2: The share of the variance that is explained.
        adjusted: R² adjusted for the number of columns.
        left_out: R² of predictions of each model's games from those of the other models; NaN for one model.
        ridge: Coefficients of a ridge regression, if a VIF exceeds `VIF_MAX`.
        penalty: The penalty of the ridge regression, chosen by leaving out one model after the other.
        result: The result of statsmodels.
    """

    z: Floats
    intercept: float
    beta: Floats
    error: Floats
    p: Floats
    vif: Floats
    r2: float
    adjusted: float
    left_out: float
    ridge: Floats | None
    penalty: float | None
    result: "sm.regression.linear_model.RegressionResultsWrapper"


def least_squares(x: Floats, y: Floats, models: Names) -> Fit:
    """Fits y to the columns of x, none of which is constant.

    Raises:
        TooLittleDataError: There are fewer than p + 2 rows.
    """
    n, columns = x.shape
    if n < columns + 2:
        raise TooLittleDataError(
            f"a regression on {columns} metrics needs at least {columns + 2} games with all of them, and there are "
            f"{n}: play more, or name fewer metrics"
        )
    z = (x - x.mean(axis=0)) / x.std(axis=0)
    with warnings.catch_warnings():
        # An infinite variance inflation factor reports this case.
        warnings.filterwarnings("ignore", message="The design matrix is rank-deficient")
        result = sm.OLS(y, np.column_stack([np.ones(n), z])).fit()
    vif = variance_inflation(z)
    several = len(set(models)) > 1
    ridge, penalty = _ridge(z, y, models) if several and vif.max() > VIF_MAX else (None, None)
    return Fit(
        z=z,
        intercept=float(result.params[0]),
        beta=result.params[1:],
        error=result.bse[1:],
        p=result.pvalues[1:],
        vif=vif,
        r2=float(result.rsquared),
        adjusted=float(result.rsquared_adj),
        left_out=_r2(y, _left_out(z, y, models, 0.0)) if several else float("nan"),
        ridge=ridge,
        penalty=penalty,
        result=result,
    )


def variance_inflation(z: Floats) -> Floats:
    """The variance inflation factor of each column: infinite if other columns determine it."""
    if z.shape[1] == 1:
        return np.ones(1)
    correlations: Floats = np.atleast_2d(np.corrcoef(z, rowvar=False))
    if np.linalg.matrix_rank(correlations, hermitian=True) < len(correlations):
        # A fit of each column to the others finds the columns that are determined.
        return np.array([_inflation(z, column) for column in range(z.shape[1])])
    return np.maximum(np.diag(np.linalg.inv(correlations)), 1.0)


def _inflation(z: Floats, column: int) -> float:
    others = np.delete(z, column, axis=1)
    unexplained = 1 - _r2(z[:, column], others @ np.linalg.lstsq(others, z[:, column])[0])
    return float("inf") if unexplained < 1e-10 else 1 / unexplained


def _ridge(z: Floats, y: Floats, models: Names) -> tuple[Floats, float]:
    errors = [np.sum((y - _left_out(z, y, models, penalty)) ** 2) for penalty in RIDGE_PENALTIES]
    penalty = float(RIDGE_PENALTIES[int(np.argmin(errors))])
    return _coefficients(z, y, penalty)[0], penalty


def _left_out(z: Floats, y: Floats, models: Names, penalty: float) -> Floats:
    """Predictions of each model's games from those of all others."""
    predicted = np.empty_like(y)
    for model in set(models):
        test = models == model
        beta, center, mean = _coefficients(z[~test], y[~test], penalty)
        predicted[test] = mean + (z[test] - center) @ beta
    return predicted


def _coefficients(z: Floats, y: Floats, penalty: float) -> tuple[Floats, Floats, float]:
    center, mean = z.mean(axis=0), float(y.mean())
    # Rows for the penalty make ridge an ordinary least-squares problem, with the smallest of several solutions.
    rows = np.vstack([z - center, np.sqrt(penalty) * np.eye(z.shape[1])])
    target = np.concatenate([y - mean, np.zeros(z.shape[1])])
    return np.linalg.lstsq(rows, target)[0], center, mean


def _r2(y: Floats, predicted: Floats) -> float:
    return float(1 - np.sum((y - predicted) ** 2) / np.sum((y - y.mean()) ** 2))

"""The analysis of small exports: its input, results, files and errors."""

import functools
import json
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import swarm_tables
from conftest import ROOT
from numpy.typing import NDArray
from swarm_tables import MODELS, Tables

from swarmseat import Client, Server, analysis
from swarmseat.analysis import attribution, figures, pieces, reporting, views, words
from swarmseat.analysis.metrics import TWELVE
from swarmseat.analysis.statistics import correlate
from swarmseat.server import find_binary


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return swarm_tables.write(tmp_path_factory.mktemp("export"))


@pytest.fixture(scope="module")
def games(folder: Path) -> analysis.Games:
    return analysis.load(folder)


def test_json_lines_and_parquet_are_the_same(folder: Path, tmp_path: Path) -> None:
    lines = analysis.load(swarm_tables.write(tmp_path / "lines", kind="jsonl"))
    packed = analysis.load(folder)
    for table in ("episodes", "rounds", "acts", "heard"):
        a, b = lines.table(table), packed.table(table)
        # Columns without values have no type in JSON.
        pd.testing.assert_frame_equal(
            a.dropna(axis=1, how="all"), b[a.columns].dropna(axis=1, how="all"), check_dtype=False
        )
    assert len(lines) == 36


def test_games_are_chosen_by_their_columns(games: analysis.Games) -> None:
    chosen = games.where(task="Pursuit", model=list(MODELS[:2]))
    assert (len(chosen), chosen.tasks, chosen.models) == (12, ["Pursuit"], sorted(MODELS[:2]))
    assert set(chosen.table("acts", ["task"])["task"]) == {"Pursuit"}
    assert games.episodes["temperature"].unique().tolist() == [0.5]


def test_games_that_cannot_be_compared_are_left_out(tmp_path: Path) -> None:
    def change(tables: Tables) -> None:
        episodes = tables["episodes"]
        episodes.loc[0, ["score", "reason"]] = None
        episodes.loc[1, "void_reason"] = "a fault"
        episodes.loc[2, "mixed"] = True

    folder = swarm_tables.write(tmp_path, change=change)
    games = analysis.load(folder)
    assert len(games) == 33
    assert [sentence.split(" games ")[1] for sentence in games.left_out] == [
        "have not ended, and are left out.",
        "were voided, and are left out.",
        "had seats of several holders, and are left out.",
    ]
    assert len(analysis.load(folder, mixed=True)) == 1


BAD: list[tuple[Callable[[Tables], Any], type[Exception], str]] = [
    (lambda t: t.update(episodes=t["episodes"][:0]), analysis.TooLittleDataError, "has no games: play some"),
    (lambda t: t.update(episodes=t["episodes"].drop(columns="explored")), analysis.MissingColumnsError,
     "no metric explored"),
    (lambda t: t["episodes"].__setitem__("embedder", ["hash-1", "other"] * 18), analysis.MixedMeasuresError,
     r"embedders \(hash-1, other\).*load\(…, embedder='hash-1'\)"),
    (lambda t: t["episodes"].__setitem__("metrics_revision", [1, 2] * 18), analysis.MixedMeasuresError, "revisions"),
    (lambda t: t["episodes"].__setitem__("num_agents", [8, 12] * 18), analysis.MixedSettingsError,
     r"Foraging: games with num_agents 12, 8 are not averaged; choose one, as in load\(…, num_agents=8\)"),
    (lambda t: t["episodes"].__setitem__("agent_meta", ['{"top_p": 0.5}', "damaged"] * 18), analysis.MixedSettingsError,
     "Foraging, built-in/random: games with top_p"),
    (lambda t: t["episodes"].__setitem__("score", 1.0), analysis.ConstantError, "add games of other models"),
    (lambda t: t.update(episodes=t["episodes"][:1]), analysis.TooLittleDataError, "needs 3 games of a task"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "error", "says"), BAD)
def test_bad_input_gets_a_sentence(
    change: Callable[[Tables], object], error: type[Exception], says: str, tmp_path: Path
) -> None:
    swarm_tables.write(tmp_path, change=change)
    with pytest.raises(error, match=says):
        analysis.correlations(analysis.load(tmp_path))


def test_missing_and_damaged_files_are_named(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(analysis.FilesError, match="is no folder: make a complete export"):
        analysis.load(tmp_path / "nothing")
    with pytest.raises(analysis.FilesError, match="has no table 'episodes'"):
        analysis.load(tmp_path)
    cut = (folder / "episodes.parquet").read_bytes()[:-100]
    (tmp_path / "episodes.parquet").write_bytes(cut)
    with pytest.raises(analysis.FilesError, match=r"episodes\.parquet is damaged or cut"):
        analysis.load(tmp_path)
    (tmp_path / "episodes.parquet").unlink()
    (tmp_path / "episodes.jsonl").write_text('{"episode": "a"')
    with pytest.raises(analysis.FilesError, match=r"episodes\.jsonl is damaged or cut"):
        analysis.load(tmp_path)
    (tmp_path / "episodes.jsonl").write_text("")
    with pytest.raises(analysis.TooLittleDataError):
        analysis.load(tmp_path)
    (tmp_path / "episodes.jsonl").write_text('{"episode": "a"}\n')
    with pytest.raises(analysis.MissingColumnsError, match="score"):
        analysis.load(tmp_path)
    games = analysis.load(swarm_tables.write(tmp_path / "few", change=lambda tables: tables.pop("heard")))
    with pytest.raises(analysis.FilesError, match="has no table 'heard'"):
        games.table("heard")
    with pytest.raises(analysis.MissingColumnsError, match="no column views"):
        games.table("acts", ["views"])


def test_choices_that_do_not_exist_are_named(games: analysis.Games) -> None:
    with pytest.raises(analysis.AnalysisError, match="choose by num_agents"):
        games.where(num_agent=3)
    with pytest.raises(analysis.TooLittleDataError, match="no game has task Transport: there are Foraging, Pursuit"):
        games.where(task="Transport")


def test_correlations_are_those_of_the_columns(games: analysis.Games) -> None:
    table = analysis.correlations(games)
    own = games.where(task="Pursuit").episodes
    row = table[(table["task"] == "Pursuit") & (table["metric"] == "pushes")].iloc[0]
    expected = correlate(own["pushes"].to_numpy(), own["score"].to_numpy(), own["model"].to_numpy(object))
    assert (row["r"], row["p"], row["n"]) == pytest.approx((expected.r, expected.p, 18))
    assert len(table) == 2 * len(TWELVE)
    assert table[table["task"] == "Pursuit"]["r"].abs().is_monotonic_decreasing
    matrix = analysis.correlation_matrix(games, "Pursuit")
    assert matrix.loc["score", "pushes"] == pytest.approx(expected.r)
    assert np.diag(matrix) == pytest.approx(1.0)
    # All values of the other definition are the same in these tables.
    with pytest.raises(analysis.ConstantError):
        analysis.correlations(games, definition="toolkit")


def test_missing_values_leave_out_pairs_and_constant_metrics_say_so(tmp_path: Path) -> None:
    def change(tables: Tables) -> None:
        tables["episodes"].loc[:3, "kept_pairs"] = None
        tables["episodes"].loc[:0, "pushes"] = None
        tables["episodes"]["stillness"] = 1.0

    games = analysis.load(swarm_tables.write(tmp_path, tasks=["Foraging"], change=change))
    table = analysis.correlations(games).set_index("metric")
    assert table.loc[["kept_pairs", "pushes"], "n"].tolist() == [14, 17]
    assert table.loc["stillness", "note"] == "the metric is the same in all games"
    assert analysis.correlation_matrix(games, "Foraging")["score"].isna()["stillness"]
    found = analysis.regression(games, "Foraging", ["pushes", "stillness", "explored", "kept_pairs"])
    assert found.notes[:3] == (
        "1 of 18 games lack a metric and are left out.",
        "Left out, as undefined in more than 10% of the games: kept_pairs.",
        "Left out, as the same in all games: stillness.",
    )


def test_shap_values_add_up(games: analysis.Games) -> None:
    found = analysis.regression(games, "Foraging")
    sums = found.shap.groupby("episode")["shap"].sum()
    assert (sums - (found.predicted - found.mean)).abs().max() < 1e-9
    importance = found.shap["shap"].abs().groupby(found.shap["metric"]).mean()
    table = found.coefficients.set_index("metric")["importance"]
    assert table.to_dict() == pytest.approx(importance.to_dict())
    residual = games.where(task="Foraging").episodes.set_index("episode")["score"] - found.predicted
    assert residual.sum() == pytest.approx(0, abs=1e-9)


def test_shapley_shares_add_up(games: analysis.Games) -> None:
    table = analysis.blocks(games)
    assert len(table) == 4
    for _, own in table.groupby("task"):
        assert own["share"].sum() == pytest.approx(own["r2_both"].iloc[0])
        assert (own["r2"] <= own["r2_both"] + 1e-12).all()


def test_a_task_with_few_games_says_so_among_the_blocks(tmp_path: Path) -> None:
    games = analysis.load(swarm_tables.write(tmp_path, seeds=2))
    table = analysis.blocks(games)
    assert table["note"].str.contains("needs at least 14 games").all()
    with pytest.raises(analysis.TooLittleDataError):
        figures.plot_blocks(table)


def test_convergence_and_failure_modes(games: analysis.Games) -> None:
    by_task = analysis.convergence_by_task(games)
    assert set(by_task["metric"]) == {"homogeneity_increase", "edit_consistency_increase"}
    by_model = analysis.convergence_by_model(games)
    own = games.where(model="model-a").episodes
    row = by_model[(by_model["model"] == "model-a") & (by_model["metric"] == "homogeneity_increase")].iloc[0]
    assert row["r"] == pytest.approx(np.corrcoef(own["homogeneity_increase"], own["score"])[0, 1])
    standard = own.groupby("task")[["homogeneity_increase", "score"]].transform(
        lambda x: (x - x.mean()) / x.std(ddof=0)
    )
    assert row["within_r"] == pytest.approx(standard.corr().iloc[0, 1])
    modes = analysis.failure_modes(games)
    assert modes[["task", "metric"]].to_numpy().tolist() == [
        ["Pursuit", "direction_imbalance"],
        ["Foraging", "separation"],
    ]


def block(values: NDArray[Any]) -> attribution.Block:
    return attribution.Block(np.zeros((len(values), 1)), values.reshape(len(values), -1).astype(float))


def test_a_random_block_has_no_importance_and_the_cause_has() -> None:
    random = np.random.default_rng(7)
    cause, noise = random.integers(0, 3, 400), random.normal(size=(400, 4))
    actions = np.array(["UP", "DOWN", "STAY"], object)[cause]
    episodes = np.repeat(np.arange(10).astype(str), 40).astype(object)
    found = attribution.attribute({"cause": block(cause), "noise": block(noise)}, actions, episodes, trees=40)
    mean, deviation = found.importance["noise"]
    assert abs(mean) <= 3 * max(deviation, 1 / 400)
    assert found.importance["cause"][0] > 0.5
    assert found.has_model
    assert found.alone["cause"] == 1.0
    # Nothing predicts these actions.
    lost = attribution.attribute({"noise": block(noise)}, actions, episodes, trees=40)
    assert lost.f1 < 0.45
    # Guessing the most frequent of three actions reaches at most a third of the maximum.
    assert 0 < lost.guess_most <= 1 / 3


def test_a_forest_needs_two_games_and_two_actions() -> None:
    noise = np.random.default_rng(1).normal(size=20)
    actions = np.array(["UP", "DOWN"] * 10, object)
    with pytest.raises(analysis.TooLittleDataError, match="one game only"):
        attribution.attribute({"noise": block(noise)}, actions, np.full(20, "a", object))
    with pytest.raises(analysis.TooLittleDataError, match="nothing to predict"):
        attribution.attribute(
            {"noise": block(noise)}, np.full(20, "UP", object), np.repeat(["a", "b"], 10).astype(object)
        )


def test_blocks_are_built_from_the_tables(games: analysis.Games) -> None:
    chosen = games.where(task="Foraging", model="model-a")
    blocks, actions, episodes = attribution.samples(chosen, "grid", analysis.Hash1())
    assert len(actions) == len(episodes) == 6 * swarm_tables.ROUNDS * swarm_tables.AGENTS
    acts = chosen.table("acts")
    first = (acts["round"] == 0).to_numpy()
    # Two others are heard from the second round on; own messages are a block of their own.
    assert blocks["others"].numbers[first].sum() == 0
    assert set(blocks["others"].numbers[~first, 0]) == {2.0}
    heard = chosen.table("heard")
    row = int(np.flatnonzero((acts["round"] == 3) & (acts["agent"] == 1))[0])
    said = heard[
        (heard["episode"] == acts["episode"][row]) & (heard["round"] == 3) & (heard["receiver"] == 1) & ~heard["own"]
    ]
    assert blocks["others"].vectors[row] == pytest.approx(
        analysis.Hash1().vectors(said["message"].tolist()).mean(axis=0)
    )
    before = acts[(acts["episode"] == acts["episode"][row]) & (acts["round"] == 2) & (acts["agent"] == 1)].iloc[0]
    assert blocks["own"].vectors[row] == pytest.approx(analysis.hash_1(before["message"]))
    assert (blocks["observation"].vectors.sum(axis=1) == 9).all()
    with pytest.raises(analysis.FilesError, match="'views'"):
        attribution.samples(chosen, "text", analysis.Hash1())


def test_attribution_has_a_row_for_each_block(games: analysis.Games) -> None:
    table = analysis.action_attribution(games.where(task="Pursuit", model="model-a"), trees=15, repeats=3)
    assert table["block"].tolist() == ["others", "own", "observation"]
    assert table["importance"].idxmax() == 2


def test_keywords_of_a_small_example(tmp_path: Path) -> None:
    def change(tables: Tables) -> None:
        acts = tables["acts"]
        acts["message"] = None
        own = acts["model"] == "model-a"
        acts.loc[acts.index[own][:4], "message"] = ["Hold (3,4)! HOLD", "the wall; don't", "hold slot-7b", "…"]
        acts.loc[acts.index[~own][:1], "message"] = "wall"

    games = analysis.load(swarm_tables.write(tmp_path, tasks=["Pursuit"], models=MODELS[:2], seeds=1, change=change))
    table = analysis.keywords(games)
    own = table[table["model"] == "model-a"]
    # hold 3 4 hold | the wall don t | hold slot 7b |
    assert own["word"].tolist() == ["hold", "7b", "slot", "wall"]
    assert own["count"].tolist() == [3, 1, 1, 1]
    assert own["per_1000_words"].tolist() == pytest.approx([3000 / 11, 1000 / 11, 1000 / 11, 1000 / 11])
    assert own["share"].tolist() == [0.5, 0.25, 0.25, 0.25]
    distinctive = analysis.distinctive_words(games)
    assert distinctive[distinctive["model"] == "model-a"]["word"].iloc[0] == "hold"


def test_log_odds_of_a_small_example() -> None:
    table = words.log_odds(Counter(up=8, down=2), Counter(up=5, down=5), prior_words=20).set_index("word")
    # Prior: up 13, down 7. Log-odds: log(21/9) - log(18/12), variance 1/21 + 1/18.
    difference = np.log(21 / 9) - np.log(18 / 12)
    assert table.loc["up", "log_odds"] == pytest.approx(difference)
    assert table.loc["up", "z"] == pytest.approx(difference / np.sqrt(1 / 21 + 1 / 18))
    assert table.loc["down", "z"] == pytest.approx(-difference / np.sqrt(1 / 9 + 1 / 12))


def test_silent_games_have_no_words(tmp_path: Path) -> None:
    games = analysis.load(
        swarm_tables.write(tmp_path, change=lambda tables: tables["acts"].__setitem__("message", None))
    )
    for function in (analysis.keywords, analysis.distinctive_words):
        with pytest.raises(analysis.TooLittleDataError, match="no message was sent"):
            function(games)


def test_hash_1_has_unit_vectors_and_masks_digits() -> None:
    vector = analysis.hash_1("Agent 12 holds (3,4)")
    assert vector.shape == (1024,)
    assert np.linalg.norm(vector) == pytest.approx(1)
    assert analysis.hash_1("AGENT 12 HOLDS (3,4)") is not vector
    assert analysis.hash_1("agent 12 holds 3 4") == pytest.approx(vector)
    alike = analysis.hash_1("slot (2,4)") @ analysis.hash_1("slot (3,1)")
    assert 0.5 < alike < 1
    # Without a letter or digit the text itself is the only feature.
    assert np.count_nonzero(analysis.hash_1("?!")) == 1
    assert np.count_nonzero(analysis.hash_1("")) == 1


def test_hash_1_of_one_letter_by_hand() -> None:
    # FNV-1a of "w:a" and "c: a ", computed step by step.
    def fnv(data: bytes) -> int:
        value = 14695981039346656037
        for byte in data:
            value = ((value ^ byte) * 1099511628211) & (2**64 - 1)
        return value

    expected = np.zeros(1024)
    for feature in (b"w:a", b"c: a "):
        expected[fnv(feature) & 1023] += -1 if fnv(feature) & (1 << 63) else 1
    assert analysis.hash_1("a") == pytest.approx(expected / np.linalg.norm(expected))
    assert fnv(b"foobar") == 0x85944171F73967E8


ACTS = pd.DataFrame(
    [("a", 0, "up"), ("a", 0, "up"), ("a", 1, "up"), ("a", 2, "up"), ("a", 2, "down"), ("a", 2, None), ("a", 3, None)],
    columns=["episode", "round", "message"],
)


class Encoder:
    """A stand-in for a sentence model: vectors of texts of different length are orthogonal."""

    def encode(self, texts: Sequence[str], *, show_progress_bar: bool) -> NDArray[Any]:
        assert not show_progress_bar
        return np.eye(200)[[len(text) for text in texts]] * 3


def test_another_embedder_has_its_own_name() -> None:
    table = analysis.homogeneity(ACTS, analysis.SentenceTransformers("small", Encoder()))
    assert table["homogeneity"].tolist() == pytest.approx([1.0, np.nan, 0.0, np.nan], nan_ok=True)
    assert table["round"].tolist() == [1, 2, 3, 4]
    assert set(table["embedder"]) == {"sentence-transformers:small"}
    assert analysis.homogeneity_of_games(table).iloc[0].tolist() == ["a", 0.5, 2, "sentence-transformers:small"]


def test_embedders_are_compared_by_rank(games: analysis.Games) -> None:
    acts = games.table("acts", ["round", "message"])
    a, b = (
        analysis.homogeneity(acts, e) for e in (analysis.Hash1(), analysis.SentenceTransformers("small", Encoder()))
    )
    found = analysis.compare_embedders(a, b)
    both = a.merge(b, on=["episode", "round"]).dropna()
    assert found["n"] == len(both)
    assert found["spearman"] == pytest.approx(both["homogeneity_x"].rank().corr(both["homogeneity_y"].rank()))
    with pytest.raises(analysis.MixedMeasuresError, match="both tables are of the embedder hash-1"):
        analysis.compare_embedders(a, a)
    with pytest.raises(analysis.MixedMeasuresError, match="one embedder, and this one has 2"):
        analysis.compare_embedders(pd.concat([a, b]), b)
    with pytest.raises(analysis.TooLittleDataError):
        analysis.compare_embedders(a[:1], b[:1])


def test_homogeneity_is_related_to_edits(games: analysis.Games) -> None:
    found = analysis.relate_to_edits(games)
    rounds = games.table("rounds").dropna(subset=["homogeneity", "edit_consistency"])
    every = found.query("by == 'all' and over == 'rounds'").iloc[0]
    assert every["n"] == len(rounds) == 36 * swarm_tables.ROUNDS
    assert every["spearman"] == pytest.approx(rounds["homogeneity"].rank().corr(rounds["edit_consistency"].rank()))
    own = games.where(task="Pursuit").episodes
    pursuit = found.query("group == 'Pursuit' and over == 'games'").iloc[0]
    assert pursuit["pearson"] == pytest.approx(own["homogeneity"].corr(own["edit_consistency"]))
    assert found.query("by == 'digits' and over == 'rounds'")["n"].sum() == len(rounds)


def test_rounds_of_one_text_are_apart(tmp_path: Path) -> None:
    def change(tables: Tables) -> None:
        same = tables["rounds"]["round"] % 2 == 0
        tables["rounds"].loc[same, ["homogeneity", "edit_consistency"]] = 1.0

    games = analysis.load(swarm_tables.write(tmp_path / "same", change=change))
    n = analysis.relate_to_edits(games).query("by == 'all'").set_index("over")["n"]
    assert n["rounds with several texts"] == 36 * swarm_tables.ROUNDS / 2
    assert n["rounds"] == n["rounds with several texts"] + 36 * (swarm_tables.ROUNDS / 2 + 1)


def test_score_trends_are_means_over_games(games: analysis.Games) -> None:
    own = games.where(model="model-a", task="Pursuit")
    last = analysis.score_trends(own).iloc[-1]
    scores = own.table("rounds", ["round", "score"]).query(f"round == {swarm_tables.ROUNDS}")["score"]
    assert last.tolist() == ["Pursuit", "model-a", swarm_tables.ROUNDS, scores.mean(), np.std(scores), 6]


def test_a_game_that_ended_early_keeps_its_score(tmp_path: Path) -> None:
    def short(tables: Tables) -> None:
        tables["rounds"] = tables["rounds"].query("round <= 5")
        tables["episodes"]["rounds"] = 5

    games = analysis.load(swarm_tables.write(tmp_path, change=short))
    trends = analysis.score_trends(games)
    own = trends[(trends["task"] == "Pursuit") & (trends["model"] == "model-a")]
    assert own["round"].tolist() == list(range(swarm_tables.ROUNDS + 1))
    assert set(own["mean"][5:]) == {own["mean"].iloc[5]}
    table = analysis.dynamics(games, "Pursuit", "model-a")
    score, pushes = (table[table["metric"] == name] for name in ("score", "pushes"))
    assert score["mean"].tolist() == own["mean"].tolist()
    assert score["best"][5:].nunique() == 1
    assert pushes["round"].tolist() == list(range(6))


ROUNDS_BAD: list[tuple[Callable[[Tables], Any], str]] = [
    (lambda t: t["rounds"].__setitem__("score", -t["rounds"]["round"]), "falls in round 1"),
    (lambda t: t.update(rounds=t["rounds"].query("round != 3")), "has 12 states .*and played 12 of 12 rounds"),
    (lambda t: t.update(rounds=t["rounds"].query("round <= 5")), "has 6 states"),
    (lambda t: t.update(rounds=t["rounds"][:0]), "has 0 states"),
    (lambda t: t["episodes"].__setitem__("max_round", 11), "played 12 of 11 rounds"),
]


@pytest.mark.parametrize(("change", "says"), ROUNDS_BAD)
def test_rounds_that_are_missing_or_damaged_are_found(
    change: Callable[[Tables], object], says: str, tmp_path: Path
) -> None:
    games = analysis.load(swarm_tables.write(tmp_path, change=change))
    with pytest.raises(analysis.FilesError, match=says):
        analysis.score_trends(games)
    with pytest.raises(analysis.FilesError, match=says):
        analysis.dynamics(games, "Pursuit", "model-a")


def test_several_exports_are_one_and_a_game_in_two_of_them_counts_once(folder: Path, tmp_path: Path) -> None:
    part = swarm_tables.write(tmp_path / "part", tasks=["Pursuit"])
    other = swarm_tables.write(tmp_path / "other", tasks=["Pursuit"], models=["d"], change=lambda t: _rename(t, "more"))
    games = analysis.load([folder, part, other])
    assert len(games) == 36 + 6
    assert len(games.table("acts", ["round"])) == 42 * swarm_tables.ROUNDS * swarm_tables.AGENTS
    assert analysis.score_trends(games).query("task == 'Pursuit' and model == 'model-a'")["n"].unique() == [6]


def _rename(tables: Tables, prefix: str) -> None:
    for table in tables.values():
        table["episode"] = prefix + table["episode"]


def test_figures_are_functions_of_the_data(games: analysis.Games, tmp_path: Path) -> None:
    for name in ("a.svg", "b.svg", "a.png", "b.png", "a.pdf", "b.pdf"):
        analysis.save(analysis.plot_scores(games), tmp_path / name)
    for kind in ("svg", "png", "pdf"):
        assert (tmp_path / f"a.{kind}").read_bytes() == (tmp_path / f"b.{kind}").read_bytes()
    ET.parse(tmp_path / "a.svg")


def test_the_sensitivity_is_that_of_one_model(tmp_path: Path) -> None:
    def change(tables: Tables) -> None:
        tables["episodes"]["num_agents"] = [8, 12, 16] * 12
        tables["episodes"]["view_size"] = [3, 5] * 18

    games = analysis.load(swarm_tables.write(tmp_path, change=change))
    with pytest.raises(analysis.TooLittleDataError, match="choose it"):
        analysis.plot_sensitivity(games)
    figure = analysis.plot_sensitivity(games.where(model="model-a"))
    assert [axes.get_title() for axes in figure.axes] == ["Foraging", "Pursuit"]
    other = analysis.plot_sensitivity(games.where(model="model-a"), across="view_size", lines="num_agents")
    assert [text.get_text() for text in other.legends[0].get_texts()] == [f"num agents {n}" for n in (8, 12, 16)]
    with pytest.raises(analysis.AnalysisError, match="no column 'size'"):
        analysis.plot_sensitivity(games.where(model="model-a"), across="size")
    made = reporting.report(games, tmp_path / "out", quick=True)
    assert made.missing["Scores by number of agents and view size"].startswith("the sensitivity is that of one model")
    assert made.missing["Foraging: Metrics and the score"].startswith("Foraging: games with num_agents")


def test_the_command_writes_everything(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert reporting.main(["report", str(folder), "--out", str(out), "--quick", "--formats", "svg"]) == 0
    shown = capsys.readouterr()
    assert shown.out == f"{out / 'report.html'}\n"
    assert shown.err.startswith("[ 1/15] Scores by task and model\n")
    # No game of these tables has a cost.
    assert shown.err.count("not made") == shown.err.count("not made: Score and cost: no game has a known cost") == 1
    page = (out / "report.html").read_text()
    assert reporting.CAUTION in page
    drawn = {f"figures/{path.name}" for path in (out / "figures").iterdir()}
    assert len(drawn) == 18
    assert all(name in page for name in drawn)
    assert r"\toprule" in (out / "tables" / "blocks.tex").read_text()
    assert len(pd.read_csv(out / "tables" / "correlations-Pursuit.csv")) == len(TWELVE)
    # Nothing is overwritten.
    assert reporting.main(["report", str(folder), "--out", str(out)]) == 1
    assert "nothing is overwritten" in capsys.readouterr().err


def test_one_game_gives_a_report_that_says_what_is_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = swarm_tables.write(tmp_path / "games", tasks=["Pursuit"], models=["only"], seeds=1)
    assert reporting.main(["report", str(folder), "--out", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr().err
    assert "not made: Pursuit: Metrics and the score: a correlation needs 3 games of a task" in shown
    assert "needs 3 games" in (tmp_path / "out" / "report.html").read_text()
    assert (tmp_path / "out" / "figures" / "trends.png").is_file()


def test_only_chosen_games_are_reported(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["report", str(folder), "--out", str(tmp_path / "out"), "--quick", "--formats", "svg"]
    assert reporting.main([*arguments, "--where", "task=Pursuit", "--where", "num_agents=3"]) == 0
    assert "18 games, 3 models, 1 tasks" in (tmp_path / "out" / "report.html").read_text()
    for wrong in (["--where", "task"], ["--formats", "gif"]):
        with pytest.raises(SystemExit):
            reporting.main([*arguments, *wrong])
    assert "is not COLUMN=VALUE" in capsys.readouterr().err


def test_an_interrupt_ends_it(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(pieces, "keywords", interrupt)
    assert reporting.main(["report", str(folder), "--out", str(tmp_path / "out"), "--quick", "--formats", "svg"]) == 130
    assert "stopped: what was made until then" in capsys.readouterr().err
    assert not (tmp_path / "out" / "report.html").exists()


def test_each_piece_is_one_command(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    small = functools.partial(analysis.action_attribution, trees=5, repeats=2)
    monkeypatch.setattr(pieces, "action_attribution", small)
    one_task = ["--where", "task=Pursuit"]
    one_model = ["--where", "model=model-a"]
    chosen = {"task": one_task, "model": one_task + one_model}
    few = {"attribution": ["--acts", "200", *one_task], "keywords": one_task, "sensitivity": one_model}
    # Teams and costs have games, and tests, of their own.
    usual = {name: piece for name, piece in pieces.PIECES.items() if name not in {"costs", *pieces.OF_TEAMS}}
    for name, piece in usual.items():
        arguments = [name, str(folder), *chosen.get(piece.of, []), *few.get(name, [])]
        written = [
            end for end in ("csv", "svg") if reporting.main([*arguments, "--out", f"{tmp_path}/{name}.{end}"]) == 0
        ]
        assert written, capsys.readouterr().err
        assert all((tmp_path / f"{name}.{end}").stat().st_size > 100 for end in written)
    capsys.readouterr()
    # Without a file the table is shown.
    assert reporting.main(["correlations", str(folder), "--metrics", "pushes,stillness"]) == 0
    shown = capsys.readouterr().out.splitlines()
    assert len(shown) == 5
    assert shown[0].split()[:2] == ["task", "metric"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["scores"], "scores is a figure: name a file with --out that ends in .png, .svg, .pdf"),
        (["failure-modes", "--out", "modes.svg"], "failure-modes is a table: name a file with --out that ends in .csv"),
        (["blocks", "--out", "blocks.txt"], "blocks.txt must end in .csv, .tex, .html, .png, .svg, .pdf"),
        (["matrix"], "this is about one task: choose it with --where task=…, of Foraging, Pursuit"),
        (["dynamics", "--where", "task=Pursuit"], "this is about one model"),
        (["correlations", "--metrics", "size"], "has no metric size"),
        (["trends", "--where", "void_reason=lost"], "no game has void_reason lost"),
    ],
)
def test_what_a_command_cannot_write_is_a_sentence(
    arguments: list[str], says: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert reporting.main([arguments[0], str(folder), *arguments[1:]]) == 1
    assert says in capsys.readouterr().err


def test_conditions_of_the_command(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(tmp_path / "trends.csv")
    assert reporting.main(["trends", str(folder), "--out", out, "--where", 'model=model-a,"model_b$1"']) == 0
    assert set(pd.read_csv(out)["model"]) == {"model-a", "model_b$1"}
    assert reporting.main(["trends", str(folder), "--out", out, "--where", "run=none", "--where", "mixed=false"]) == 0
    assert not capsys.readouterr().err


def test_text_of_players_is_escaped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = pd.DataFrame({"model": ["<b>|a_b$&%#{}~^\\"], "n": [1.23456789], "none": [None]})
    for end in ("html", "tex"):
        reporting.write_table(table, tmp_path / f"table.{end}")
    assert "<b>" not in (tmp_path / "table.html").read_text()
    latex = (tmp_path / "table.tex").read_text()
    escaped = r"|a\_b\$\&\%\#\{\}\textasciitilde \textasciicircum \textbackslash"
    assert escaped in latex.replace("{}", " ").replace("  ", " ")
    assert "1.235" in latex
    table["model"] = "\x1b[31m\u202emodel"
    folder = swarm_tables.write(
        tmp_path / "games", change=lambda t: t["episodes"].__setitem__("model", table["model"][0])
    )
    assert reporting.main(["convergence-by-model", str(folder)]) == 0
    shown = capsys.readouterr().out
    assert "\ufffd[31m\ufffdmodel" in shown
    assert "\x1b" not in shown


def test_without_the_extra_it_is_said_what_to_install() -> None:
    program = """
import importlib.util, sys
find = importlib.util.find_spec
importlib.util.find_spec = lambda name, *more: None if name == "pandas" else find(name, *more)
import swarmseat
try:
    swarmseat.analysis
except ModuleNotFoundError as error:
    print(error)
"""
    shown = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True).stdout
    assert (
        shown
        == "swarmseat.analysis needs pandas: install this package with its extra `analysis` (docs/play/python.md)\n"
    )


SETTINGS: dict[str, Any] = {"num_agents": 5, "width": 8, "height": 8, "max_round": 6, "view_size": 5}


@pytest.mark.parametrize("rules", ["paper", "reference"])
@pytest.mark.parametrize("control", ["decentralized", "centralized"])
def test_a_server_is_read_and_windows_are_what_agents_saw(
    client: Client, server: Server, rules: Any, control: Any
) -> None:
    seen: dict[tuple[str, int, int], list[list[str]]] = {}
    tasks: Any = ("Foraging", "Synchronization", "Transport")
    model = f"{rules} {control}"
    for task in tasks:
        episode = client.create_episode(task=task, seed=4, rules=rules, control=control, model=model, **SETTINGS)
        swarm = client.with_token(episode["swarm_token"])
        while not (now := swarm.swarm_obs(wait=30))["finished"]:
            acts: Any = []
            for seat in now["observations"]:
                view: Any = seat["view"]
                seen[episode["id"], seat["round"], int(seat["agent"].split("_")[1])] = view["cells"]
                action = ["UP", "RIGHT", "DOWN", "SWITCH" if task == "Synchronization" else "LEFT"][
                    (seat["round"] + len(acts)) % 4
                ]
                acts.append(
                    {
                        "episode": seat["episode"],
                        "agent": seat["agent"],
                        "round": seat["round"],
                        "action": action,
                        "message": "on",
                    }
                )
            swarm.swarm_act(acts)
    games = analysis.load(server.url, model=model)
    assert len(games) == len(tasks)
    acts = games.table("acts", ["round", "agent", "i", "j", "message"])
    acts = acts.merge(games.episodes[["episode", "task", "rules", "control", "view_size"]], on="episode")
    maps = views.maps_of(games.table("rounds", ["round", "grid"]))
    keys = list(zip(acts["episode"], acts["round"], acts["agent"], strict=True))
    for task, own in acts.groupby("task"):
        rebuilt = views.windows(views.seats_of(own), maps)
        expected = ["\n".join(" ".join(row) for row in seen[keys[at]]) for at in own.index]
        assert (rebuilt == views.encode_views(expected, own["agent"])).all(), task
    # The server measured with the same embedder.
    if "homogeneity" in games.table("rounds"):
        ours = analysis.homogeneity(acts, analysis.Hash1())
        both = ours.merge(games.table("rounds", ["round", "homogeneity"]), on=["episode", "round"])
        np.testing.assert_allclose(both["homogeneity_x"], both["homogeneity_y"], atol=1e-12)


def test_a_server_that_cannot_be_reached_is_an_error(tmp_path: Path) -> None:
    from swarmseat import ConnectionFailedError, Retry

    with Client("http://127.0.0.1:9", retry=Retry(times=0)) as client, pytest.raises(ConnectionFailedError):
        client.export("rounds.parquet", tmp_path / "rounds.parquet")
    assert not list(tmp_path.iterdir())


def test_an_export_is_downloaded_completely(client: Client, tmp_path: Path) -> None:
    episode = client.create_episode(task="Foraging", num_agents=1, max_round=1, model="to export")
    with client.with_token(episode["swarm_token"]) as swarm:
        swarm.swarm_act([{"episode": episode["id"], "agent": "Agent_0", "round": 0, "action": "STAY"}])
    client.export("episodes.jsonl", tmp_path / "episodes.jsonl", model="to export", mixed=False)
    rows = [json.loads(line) for line in (tmp_path / "episodes.jsonl").read_text().splitlines()]
    assert [row["model"] for row in rows] == ["to export"]
    assert [path.name for path in tmp_path.iterdir()] == ["episodes.jsonl"]


def test_the_page_works(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    swarm_tables.write(tmp_path / "games")
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs" / "evaluate" / "analysis.md").read_text()
    names: dict[str, Any] = {}
    blocks = re.findall(r"^(<!-- needs a model -->\n)?```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    for needs_model, code in blocks:
        if needs_model:
            monkeypatch.setattr("swarmseat.analysis.texts._sentence_transformer", lambda _: Encoder())
        exec(code, names)
    assert len(blocks) == 2
    assert (tmp_path / "pursuit.svg").is_file()
    assert "sentence-transformers:all-mpnet-base-v2" in capsys.readouterr().out
    functions = set(re.findall(r"`(\w+)\(", page[page.index("| function |") : page.index("### Another embedder")]))
    assert functions == {name for name in functions if hasattr(analysis, name)}


def held(model: str, seats: int, **declared: Any) -> dict[str, Any]:
    """A holder of a team, as an export has it."""
    prompt = None if model.startswith("built-in/") else declared.pop("prompt", "default")
    return {"model": model, "seats": seats, "prompt": prompt, "agent_meta": declared}


def games_of_teams(folder: Path, teams: Sequence[tuple[list[dict[str, Any]], list[float]]]) -> Path:
    """Writes the games of teams: the holders of each, and its scores on the seeds 0, 1, 2 …"""
    names = [f"team {number}" for number in range(len(teams))]

    def change(tables: Tables) -> None:
        episodes = tables["episodes"]
        played = [teams[names.index(model)] for model in episodes["model"]]
        episodes["team_holders"] = [json.dumps(holders) for holders, _ in played]
        episodes["team"] = [json.dumps({holder["model"]: holder["seats"] for holder in team}) for team, _ in played]
        episodes["mixed"] = [len(holders) > 1 for holders, _ in played]
        episodes["score"] = [dict(enumerate(of)).get(at) for (_, of), at in zip(played, episodes["seed"], strict=True)]

    most = max(len(scores) for _, scores in teams)
    return swarm_tables.write(folder, tasks=["Foraging"], models=names, seeds=most, change=change)


def test_substitution_is_paired_by_seed(tmp_path: Path) -> None:
    folder = games_of_teams(
        tmp_path / "teams",
        [
            ([held("a", 3)], [1.0, 11.0, 21.0]),
            ([held("a", 2), held("b", 1)], [2.0, 12.0, 22.0]),
            ([held("b", 3)], [4.0, 15.0, 23.0, 99.0]),
            ([held("a", 1), held("b", 1), held("c", 1)], [7.0]),
        ],
    )
    table = analysis.substitution(analysis.load(folder, mixed=[True, False]))
    told = table[table["of"] == "a"][["by", "replaced", "score", "contribution", "low", "high", "pairs"]]
    # Layouts differ by 10 points each, and yet a constant gain has no uncertainty.
    assert told.iloc[1].tolist() == ["b", 1, 12.0, 1.0, 1.0, 1.0, 3]
    # The fourth seed has no pair, but counts in the mean score.
    assert (told.iloc[2]["replaced"], told.iloc[2]["score"], told.iloc[2]["pairs"]) == (3, 35.25, 3)
    half = 6.205346816570706 * np.std([3, 4, 2], ddof=1) / np.sqrt(3)
    assert told.iloc[2][["contribution", "low", "high"]].tolist() == pytest.approx([3, 3 - half, 3 + half])
    assert (told.iloc[0]["score"], told.iloc[0]["pairs"]) == (11.0, 0)
    assert np.isnan(told.iloc[0]["contribution"])
    assert table[table["of"] == "b"]["replaced"].tolist() == [0, 2, 3]
    assert len(table) == 6, "three players are no substitution"
    for out in ("substitution.svg", "substitution.csv"):
        assert reporting.main(["substitution", str(folder), "--out", str(tmp_path / out)]) == 0
    assert "seats replaced" in (tmp_path / "substitution.svg").read_text()
    with pytest.raises(analysis.TooLittleDataError, match="no player replaced another"):
        analysis.substitution(analysis.load(folder))


def test_a_focal_player_is_judged_over_several_backgrounds(tmp_path: Path) -> None:
    teams = [
        ([held("f", 1), held("x", 3)], [4.0, 6.0, 8.0]),
        ([held("f", 1), held("y", 3)], [2.0, 2.0, 2.0, 50.0]),
        ([held("f", 2), held("y", 2)], [9.0]),
        ([held("x", 4)], [1.0, 3.0, 5.0]),
        ([held("y", 4)], [3.0, 3.0, 3.0]),
    ]
    folder = games_of_teams(tmp_path / "teams", teams)
    table = analysis.focal(analysis.load(folder, mixed=[True, False]))
    [row] = table.to_dict("records")
    assert (row["focal"], row["seats"], row["backgrounds"], row["task"]) == ("f", 1, "x, y", "Foraging")
    # Means over the backgrounds are 3, 4 and 5, and 2, 3 and 4 without the focal player.
    assert (row["score"], row["contribution"], row["low"], row["high"], row["pairs"]) == (4.0, 1.0, 1.0, 1.0, 3)
    for out in ("focal.svg", "focal.csv"):
        assert reporting.main(["focal", str(folder), "--out", str(tmp_path / out)]) == 0
    assert "among x, y" in (tmp_path / "focal.svg").read_text()
    # A background that did not play alone leaves nothing to compare with.
    folder = games_of_teams(tmp_path / "less", teams[:4])
    games = analysis.load(folder, mixed=[True, False])
    assert analysis.focal(games)[["score", "pairs"]].to_numpy().tolist() == [[4.0, 0]]
    with pytest.raises(analysis.TooLittleDataError, match="nothing to compare with"):
        analysis.plot_focal(analysis.focal(games))
    with pytest.raises(analysis.TooLittleDataError, match="swarms of two others"):
        analysis.focal(games.where(model=["team 0", "team 2", "team 3"]))


def test_players_of_one_model_that_were_asked_differently_stay_apart(tmp_path: Path) -> None:
    low, high = ({"eval": {"effort": effort, "identity": "0"}, "prompt": "default"} for effort in ("low", "high"))
    remembers = {"prompt": "default+harness:history=2", "eval": {"effort": "low", "harness": {"history": 2}}}
    folder = games_of_teams(
        tmp_path / "teams",
        [
            ([held("built-in/random", 3)], [1.0, 2.0, 3.0]),
            *(
                ([held("built-in/random", 2), held("m", 1, **declared)], [1.0 + gain, 2.0 + gain, 3.0 + gain])
                for gain, declared in enumerate([low, high, remembers], 1)
            ),
            ([held("x", 3)], [0.0, 0.0, 0.0]),
            ([held("x", 2), held("m", 1, **low)], [1.0, 1.0, 1.0]),
        ],
    )
    games = analysis.load(folder, mixed=[True, False])
    table = analysis.substitution(games)
    gains = table[(table["of"] == "built-in/random") & (table["replaced"] == 1)].set_index("by")["contribution"]
    names = [
        'm (eval.effort "low", prompt "default")',
        'm (eval.effort "high", prompt "default")',
        'm (eval.effort "low", prompt "default+harness:history=2")',
    ]
    assert gains.to_dict() == dict(zip(names, [1.0, 2.0, 3.0], strict=True))
    # The two others have one background each.
    assert set(analysis.focal(games)["focal"]) == {"built-in/random", names[0]}


def test_the_example_comes_to_a_curve_and_a_table_of_strangers(tmp_path: Path) -> None:
    def swarmbench(*arguments: str) -> str:
        command = [str(find_binary()), *arguments]
        done = subprocess.run(command, check=True, capture_output=True, text=True, cwd=tmp_path)
        return done.stdout + done.stderr

    example = ROOT / "examples" / "eval" / "teams.toml"
    shown = swarmbench("eval", str(example), "--verify", "--max-round", "12", "--num-agents", "6", "--db", "teams.db")
    assert all(part in shown for part in ("built-in/default", "verified:", "6 built-in/random"))
    swarmbench("export", "teams", "--db", "teams.db", "--format", "parquet")
    games = analysis.load(tmp_path / "teams", mixed=[True, False])
    table = analysis.substitution(games)
    curve = table[(table["of"] == "built-in/default") & (table["by"] == "built-in/random")]
    assert curve["replaced"].tolist() == [0, 1, 2, 3, 4, 5, 6]
    gains = curve[curve["replaced"] > 0]
    assert (gains["contribution"] - (gains["score"] - curve.iloc[0]["score"])).tolist() == pytest.approx([0] * 6)
    assert ((gains["low"] <= gains["contribution"]) & (gains["contribution"] <= gains["high"])).all()
    assert gains["pairs"].tolist() == [3] * 6
    strangers = analysis.focal(games)
    own = strangers[(strangers["focal"] == "built-in/default") & (strangers["seats"] == 4)].iloc[0]
    assert own["backgrounds"] == "built-in/random, built-in/wander-and-carry"
    assert own["low"] <= own["high"]


def test_costs_stand_beside_scores(tmp_path: Path) -> None:
    prices = {"model-a": 0.02, "model_b$1": 0.5}

    def change(tables: Tables) -> None:
        episodes = tables["episodes"]
        episodes["cost_usd"] = episodes["model"].map(prices)
        episodes["acts"] = 36
        episodes["priced"] = episodes["model"].map({"model-a": 36, "model_b$1": 27}).fillna(0).astype(int)

    folder = swarm_tables.write(tmp_path / "costs", seeds=3, change=change)
    table = analysis.costs(analysis.load(folder))
    # Built-in players have no cost.
    assert list(zip(table["task"], table["model"], strict=True)) == [
        (task, model) for task in ("Foraging", "Pursuit") for model in prices
    ]
    assert table["cost_usd"].tolist() == pytest.approx([0.02, 0.5] * 2)
    assert table["unpriced"].tolist() == pytest.approx([0, 0.25] * 2)
    for out in ("costs.svg", "costs.csv"):
        assert reporting.main(["costs", str(folder), "--out", str(tmp_path / out)]) == 0
    drawn = (tmp_path / "costs.svg").read_text()
    assert "US dollars a game" in drawn
    # Formulas are switched off: a label of a logarithmic axis would show its source.
    assert "mathdefault" not in drawn
    with pytest.raises(analysis.TooLittleDataError, match="no game has a known cost"):
        analysis.costs(analysis.load(swarm_tables.write(tmp_path / "free", seeds=2)))

//! `GET /api/v1/episodes/{id}/scores`.

use axum::Json;
use serde::Deserialize;
use utoipa::IntoParams;

use super::super::page::items;
use super::super::prelude::*;
use crate::store::port::StoredEpisode;
use swarmbench_protocol::replay::Scores;

/// Scores of an episode, where the query does not say.
const POINTS_USUAL: u32 = 200;

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct ScoresParams {
    /// Maximum number of scores besides the first and the newest, up to 1,000; 200 by default.
    #[param(minimum = 1, maximum = 1000)]
    points: Option<u32>,
}

impl ScoresParams {
    /// The number of scores that the query asks for, checked.
    pub(in super::super) fn points(&self, app: &App) -> Result<u32, ApiError> {
        items(app, "points", self.points.unwrap_or(POINTS_USUAL))
    }
}

/// Number of rounds between two scores, and the rounds of all scores but the first.
pub(in super::super) fn places(rounds: u32, points: u32) -> (u32, Vec<u32>) {
    let every = rounds.div_ceil(points).max(1);
    let mut places: Vec<u32> = (1..=rounds / every).map(|place| place * every).collect();
    if !rounds.is_multiple_of(every) {
        places.push(rounds);
    }
    (every, places)
}

/// Show the score of an episode in equal steps of rounds.
#[utoipa::path(
    get,
    path = "/api/v1/episodes/{id}/scores",
    operation_id = "show_scores",
    tag = "episodes",
    params(ScoresParams),
    responses(
        (status = 200, description = "The scores", body = Scores),
        (status = 403, description = "`forbidden`: only the creator may read them before the end"),
    )
)]
pub(in super::super) async fn show_scores(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    Params(params): Params<ScoresParams>,
) -> Result<Json<Scores>, ApiError> {
    let points = params.points(&app)?;
    let stored = app.readable_episode(&caller, id).await?;
    Ok(Json(app.scores(&stored, points).await?))
}

impl App {
    /// The scores of an episode as far as `stored` tells of it.
    pub(in super::super) async fn scores(
        &self,
        stored: &StoredEpisode,
        points: u32,
    ) -> Result<Scores, ApiError> {
        let (every, places) = places(stored.rounds, points);
        let mut scores = vec![0.0];
        scores.extend(self.store.scores_after(stored.episode, &places).await?);
        Ok(Scores { episode: stored.id.to_string(), rounds: stored.rounds, every, scores })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scores_are_in_equal_steps_up_to_the_newest() {
        assert_eq!(places(0, 200), (1, vec![]));
        assert_eq!(places(3, 200), (1, vec![1, 2, 3]));
        assert_eq!(places(10, 3), (4, vec![4, 8, 10]));
        assert_eq!(places(12, 3), (4, vec![4, 8, 12]));
        for rounds in [1, 7, 99, 100, 101, 100_000] {
            for points in [1, 2, 50, 1000] {
                let (_, places) = places(rounds, points);
                assert!(places.len() <= points as usize + 1 && places.last() == Some(&rounds));
            }
        }
    }
}

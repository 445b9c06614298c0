//! Pages for browsers. All are one HTML document, whose scripts read their data from the same routes as every other client.

mod assets;
mod shell;

use axum::Router;
use axum::extract::Path;
use axum::extract::State;
use axum::response::Response;
use axum::routing::get;

pub use assets::Source;
use shell::Framing;
pub(super) use shell::{Shell, wants_page};

use super::App;
use super::auth::Caller;

pub(super) fn routes() -> Router<App> {
    let page = |shell: fn() -> Shell| {
        get(move |State(app): State<App>| async move { shell().response(&app) })
    };
    Router::new()
        .route("/assets/{version}/{*name}", get(assets::asset))
        .route(
            "/",
            page(|| Shell::new("swarmbench").links(&["/api/v1/leaderboard", "/api/v1/episodes"])),
        )
        .route("/episodes", page(|| Shell::new("Games").links(&["/api/v1/episodes"])))
        .route("/runs", page(|| Shell::new("Runs").links(&["/api/v1/runs"])))
        .route("/imports", page(|| Shell::new("Imported games").links(&["/api/v1/imports"])))
        .route("/boards", page(|| Shell::new("Boards").links(&["/api/v1/leaderboard"])))
        .route(
            "/competitions",
            page(|| Shell::new("Competitions").links(&["/api/v1/competitions"])),
        )
        .route("/compare", page(|| Shell::new("Compare two games")))
        .route("/play", page(|| Shell::new("Play")))
        .route("/desk", page(|| Shell::new("Organizer's desk")))
        .route("/tasks/{task}", get(task))
        .route("/board/{suite}", get(board))
        .route("/board/{suite}/{row}", get(player))
        .route("/runs/{id}", get(run))
        .route("/imports/{id}", get(import))
        .route("/competitions/{id}", get(competition))
        .route("/play/{id}", get(play))
        .route("/episodes/{id}", get(episode))
        .route("/embed/episodes/{id}", get(embedded_episode))
}

async fn task(State(app): State<App>, Path(task): Path<String>) -> Response {
    Shell::new(&task).link("/api/v1/episodes", &[("task", &task)]).response(&app)
}

async fn board(State(app): State<App>, Path(suite): Path<String>) -> Response {
    let shell = Shell::new(&format!("Board {suite}"));
    shell.link("/api/v1/leaderboard", &[("suite", &suite)]).response(&app)
}

async fn player(State(app): State<App>, Path((suite, row)): Path<(String, String)>) -> Response {
    let shell = Shell::new(&format!("{row} on the board {suite}"));
    shell.link("/api/v1/leaderboard", &[("suite", &suite)]).response(&app)
}

async fn run(State(app): State<App>, Path(id): Path<String>) -> Response {
    Shell::new("Run").below("/api/v1/runs", &id, &["", "/scores", "/metrics"]).response(&app)
}

async fn import(State(app): State<App>, Path(id): Path<String>) -> Response {
    let parts = ["", "/state", "/replay", "/metrics"];
    Shell::new("Imported game").below("/api/v1/imports", &id, &parts).response(&app)
}

async fn competition(State(app): State<App>, Path(id): Path<String>) -> Response {
    let parts = ["", "/board", "/entrants"];
    Shell::new("Competition").below("/api/v1/competitions", &id, &parts).response(&app)
}

async fn play(State(app): State<App>, Path(id): Path<String>) -> Response {
    Shell::new("Play").below("/api/v1/episodes", &id, &["", "/claims"]).response(&app)
}

async fn episode(State(app): State<App>, caller: Caller, Path(id): Path<String>) -> Response {
    episode_shell(&app, &caller, &id).await.response(&app)
}

/// Page of a game that other sites may embed in a frame, where its scripts have no tokens.
async fn embedded_episode(
    State(app): State<App>,
    caller: Caller,
    Path(id): Path<String>,
) -> Response {
    episode_shell(&app, &caller, &id).await.framing(Framing::Anyone).response(&app)
}

/// Page of a game, with title and description for link previews if the caller may read the game.
async fn episode_shell(app: &App, caller: &Caller, id: &str) -> Shell {
    let parts = ["", "/state", "/replay", "/metrics", "/journal"];
    let shell = match app.readable_summary(caller, id).await {
        Ok(shown) => {
            let title = format!("{} · {}", shown.task, shown.model);
            let status = serde_json::to_value(shown.status).unwrap_or_default();
            let status = status.as_str().unwrap_or_default();
            let (round, score) = (shown.round, shown.score);
            let seen = format!("{status} after {round} rounds with a score of {score:.2}");
            Shell::new(&title).description(&seen)
        }
        Err(_) => Shell::new("Game"),
    };
    shell.below("/api/v1/episodes", id, &parts)
}

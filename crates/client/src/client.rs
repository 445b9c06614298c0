//! Client of the wire contract, as far as the built-in players need it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use backon::{ExponentialBuilder, Retryable};
use reqwest::header::RETRY_AFTER;
use reqwest::{Method, RequestBuilder, Response, StatusCode, Url};
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::{http, page};
use swarmbench_boards::collection::Question;
use swarmbench_protocol::act::{
    ActRequest, Receipt, SeatActs, SwarmAct, SwarmActRequest, SwarmActResponse, SwarmObsResponse,
};
use swarmbench_protocol::board::{CrossPlay, Leaderboard};
use swarmbench_protocol::episode::{CreatedEpisode, EpisodeRequest, EpisodeSummary, VoidRequest};
use swarmbench_protocol::key::{CreatedKey, KeyList, KeyRequest, KeySummary};
use swarmbench_protocol::problem::Problem;
use swarmbench_protocol::run::{CreatedRun, RunDetail, RunRequest, RunToken};

/// Time of a request beyond its `wait`, which is at most 60 s: the timeout of all requests is three times this.
const PATIENCE: Duration = Duration::from_secs(30);

/// Maximum retries of a repeatable request after temporary errors.
const REPEATS_MAX: usize = 5;

/// Timeout of a health check, which a server answers before all else.
const HEALTH_PATIENCE: Duration = Duration::from_secs(10);

/// Failure of a request.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The server did not answer.
    #[error(
        "{url} does not answer: {}; does a server run there? `swarmbench serve` starts one{}",
        cause(error),
        if url.scheme() == "https" && error.is_connect() { ", which speaks http://" } else { "" }
    )]
    Transport {
        /// Requested address.
        url: Url,
        /// Cause.
        error: reqwest::Error,
    },
    /// The server refused.
    #[error("{url} answered {status}: {}", problem.detail)]
    Refused {
        /// Requested address.
        url: Url,
        /// Status of the answer.
        status: StatusCode,
        /// Problem in the body.
        problem: Box<Problem>,
    },
    /// A proxy answered in place of the server, as when the server dies during a request.
    #[error("{url}: {} of a proxy: {said}", status.as_u16())]
    Proxy {
        /// Requested address.
        url: Url,
        /// Status of the answer.
        status: StatusCode,
        /// First text of the page.
        said: Box<str>,
        /// Seconds after which to retry.
        retry_after_s: Option<u32>,
    },
    /// The answer does not follow the contract.
    #[error("{url} answered {status} with something that is not of the contract: {what}")]
    Strange {
        /// Requested address.
        url: Url,
        /// Status of the answer.
        status: StatusCode,
        /// Violation of the contract.
        what: String,
    },
    /// The text is no address of a server.
    #[error(
        "{0:?} is not the address of a server; it looks like http://127.0.0.1:8080, without a path"
    )]
    Address(String),
    /// The answer cannot be written to the output.
    #[error(transparent)]
    Write(#[from] std::io::Error),
}

impl ClientError {
    /// A temporary error may be gone at a retry.
    #[must_use]
    pub fn is_temporary(&self) -> bool {
        match self {
            Self::Transport { error, .. } => !error.is_builder(),
            Self::Refused { status, .. } => matches!(
                *status,
                StatusCode::TOO_MANY_REQUESTS
                    | StatusCode::BAD_GATEWAY
                    | StatusCode::SERVICE_UNAVAILABLE
                    | StatusCode::GATEWAY_TIMEOUT
            ),
            Self::Proxy { .. } => true,
            Self::Strange { .. } | Self::Address(_) | Self::Write(_) => false,
        }
    }

    /// Pause that the server asked for.
    fn retry_after(&self) -> Option<Duration> {
        match self {
            Self::Refused { problem, .. } => problem.retry_after_ms.map(Duration::from_millis),
            Self::Proxy { retry_after_s, .. } => {
                retry_after_s.map(|seconds| Duration::from_secs(seconds.into()))
            }
            Self::Transport { .. } | Self::Strange { .. } | Self::Address(_) | Self::Write(_) => {
                None
            }
        }
    }
}

/// Innermost cause: the errors around it repeat the address.
fn cause(error: &reqwest::Error) -> String {
    let mut cause: &dyn std::error::Error = error;
    while let Some(inner) = cause.source() {
        cause = inner;
    }
    cause.to_string()
}

/// Head of an answer.
struct Head {
    url: Url,
    status: StatusCode,
    retry_after_s: Option<u32>,
}

impl Head {
    fn of(url: Url, answer: &Response) -> Self {
        let seconds = answer.headers().get(RETRY_AFTER).and_then(|text| text.to_str().ok());
        let retry_after_s = seconds.and_then(|text| text.parse().ok());
        Self { url, status: answer.status(), retry_after_s }
    }

    fn refused(self, body: &[u8]) -> ClientError {
        let Self { url, status, retry_after_s } = self;
        if let Ok(problem) = serde_json::from_slice(body) {
            return ClientError::Refused { url, status, problem: Box::new(problem) };
        }
        let said = page::first_text(body);
        let is_late = matches!(status, StatusCode::REQUEST_TIMEOUT | StatusCode::TOO_MANY_REQUESTS);
        if status.is_server_error() || is_late {
            ClientError::Proxy { url, status, said: said.into(), retry_after_s }
        } else {
            ClientError::Strange { url, status, what: said }
        }
    }
}

/// An answer that is no error.
struct Answer {
    url: Url,
    status: StatusCode,
    body: Vec<u8>,
}

impl Answer {
    fn read<T: DeserializeOwned>(self) -> Result<T, ClientError> {
        let Self { url, status, body } = self;
        serde_json::from_slice(&body).map_err(|error| {
            let what = error.to_string();
            ClientError::Strange { url, status, what }
        })
    }
}

/// Function that adds headers, query and body to a request. It is no type parameter, so that requests are compiled once.
type Fill<'a> = &'a (dyn Fn(RequestBuilder) -> RequestBuilder + Sync);

/// Client of one server. Clones share its connections.
#[derive(Clone, Debug)]
pub struct Client {
    http: reqwest::Client,
    base: Url,
    key: Option<Secret>,
    /// True if the server has answered at least once. A server that never did is more likely absent than restarting.
    answered: Arc<AtomicBool>,
}

/// Key, which `Debug` does not show.
#[derive(Clone)]
struct Secret(String);

impl std::fmt::Debug for Secret {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Secret(…)")
    }
}

#[expect(
    clippy::missing_errors_doc,
    reason = "every method fails as the variants of `ClientError` say"
)]
impl Client {
    /// Client of the server at `base`, such as `http://127.0.0.1:8080`.
    pub fn new(base: &str) -> Result<Self, ClientError> {
        let is_server = |url: &Url| {
            let has_more = url.path() != "/" || url.query().is_some() || url.fragment().is_some();
            url.has_host() && matches!(url.scheme(), "http" | "https") && !has_more
        };
        let parsed = Url::parse(base).ok().filter(is_server);
        let base = parsed.ok_or_else(|| ClientError::Address(base.to_owned()))?;
        let failed = |error| ClientError::Transport { url: base.clone(), error };
        let http = http::builder(base.host_str()).build().map_err(failed)?;
        Ok(Self { http, base, key: None, answered: Arc::default() })
    }

    /// Client that sends this key with requests that have no token.
    #[must_use]
    pub fn with_key(self, key: String) -> Self {
        Self { key: Some(Secret(key)), ..self }
    }

    fn signed(&self, call: RequestBuilder) -> RequestBuilder {
        self.signed_with(call, None)
    }

    /// True if the client has a key.
    #[must_use]
    pub const fn has_key(&self) -> bool {
        self.key.is_some()
    }

    /// Adds the token, or else the key, if there is one.
    fn signed_with(&self, call: RequestBuilder, token: Option<&str>) -> RequestBuilder {
        match token.or(self.key.as_ref().map(|Secret(key)| key.as_str())) {
            Some(token) => call.bearer_auth(token),
            None => call,
        }
    }

    /// Address of the server.
    #[must_use]
    pub const fn base(&self) -> &Url {
        &self.base
    }

    /// Writes an answer to `out` piece by piece, and returns the cursor of the next page, if there is one. A truncated answer
    /// is an error.
    pub async fn download(
        &self,
        path: &str,
        query: &[(&str, &String)],
        out: &mut (dyn std::io::Write + Send),
    ) -> Result<Option<String>, ClientError> {
        let mut url = self.base.clone();
        url.set_path(path);
        let transport = |error| ClientError::Transport { url: url.clone(), error };
        let begin = async || {
            let call = self.signed(self.http.get(url.clone())).query(query);
            let answer = call.send().await.map_err(transport)?;
            let head = Head::of(url.clone(), &answer);
            if head.status.is_success() {
                return Ok(answer);
            }
            Err(head.refused(&answer.bytes().await.map_err(transport)?))
        };
        let mut answer = self.again(begin).await?;
        let next = answer.headers().get("x-next-cursor").and_then(|next| next.to_str().ok());
        let next = next.map(str::to_owned);
        while let Some(piece) = answer.chunk().await.map_err(transport)? {
            out.write_all(&piece)?;
        }
        out.flush()?;
        Ok(next)
    }

    /// Creates an episode. A retry after a lost answer returns the same one.
    pub async fn create_episode(
        &self,
        request: &EpisodeRequest,
    ) -> Result<CreatedEpisode, ClientError> {
        self.create("/api/v1/episodes", request).await
    }

    /// Shows an episode.
    pub async fn episode(&self, id: &str) -> Result<EpisodeSummary, ClientError> {
        let path = format!("/api/v1/episodes/{id}");
        self.ask(Method::GET, &path, |call| self.signed(call)).await
    }

    /// Creates a run. A retry after a lost answer returns the same one.
    pub async fn create_run(&self, request: &RunRequest) -> Result<CreatedRun, ClientError> {
        self.create("/api/v1/runs", request).await
    }

    /// Creates an object at a path that accepts an `Idempotency-Key`: a retry after a lost answer returns the same one.
    pub async fn create<T: DeserializeOwned>(
        &self,
        path: &str,
        body: &(impl Serialize + Sync),
    ) -> Result<T, ClientError> {
        let key = uuid_text();
        self.ask(Method::POST, path, |call| {
            self.signed(call).header("Idempotency-Key", &key).json(body)
        })
        .await
    }

    /// Shows a run, with its own token or else with the key.
    pub async fn run(&self, id: &str, token: Option<&str>) -> Result<RunDetail, ClientError> {
        let path = format!("/api/v1/runs/{id}");
        self.ask(Method::GET, &path, |call| self.signed_with(call, token)).await
    }

    /// Has an ended game of a run played again, with the token of the run or else with the key. A repetition changes nothing.
    pub async fn repeat_episode(
        &self,
        id: &str,
        reason: &str,
        token: Option<&str>,
    ) -> Result<EpisodeSummary, ClientError> {
        let path = format!("/api/v1/episodes/{id}/repeat");
        let body = VoidRequest { reason: reason.to_owned() };
        self.ask(Method::POST, &path, |call| self.signed_with(call, token).json(&body)).await
    }

    /// Replaces the token of a run.
    pub async fn replace_run_token(
        &self,
        id: &str,
        holder: Option<&str>,
    ) -> Result<RunToken, ClientError> {
        let path = format!("/api/v1/runs/{id}/token");
        let query = holder.map(|holder| ("holder", holder));
        self.ask(Method::POST, &path, |call| self.signed(call).query(query.as_slice())).await
    }

    /// Current observation of a seat as raw JSON, with the text for a language model if `prompt` is set. With `after` the
    /// server answers once the round is past that one, the episode is over, or `wait` has passed.
    pub async fn obs(
        &self,
        token: &str,
        after: Option<u32>,
        wait: Duration,
        prompt: bool,
    ) -> Result<Vec<u8>, ClientError> {
        let wait = after.map(|_| wait.as_secs_f64());
        let fill = |call: RequestBuilder| {
            call.bearer_auth(token)
                .query(&[("after", after)])
                .query(&[("wait", wait)])
                .query(&[("prompt", prompt)])
        };
        self.ask_bytes("/obs", fill).await
    }

    /// Acts for a seat. A retry after a lost answer gets the same receipt.
    pub async fn act(&self, token: &str, act: &ActRequest) -> Result<Receipt, ClientError> {
        self.ask(Method::POST, "/act", |call| call.bearer_auth(token).json(act)).await
    }

    /// Observations that wait for an act and were opened since `after`, at most `limit`; with the texts for language models if
    /// `prompt` is set.
    pub async fn swarm_obs(
        &self,
        token: &str,
        after: Option<&str>,
        wait_s: u32,
        limit: usize,
        prompt: bool,
    ) -> Result<SwarmObsResponse, ClientError> {
        self.ask(Method::GET, "/swarm/obs", |call| {
            let call = call.bearer_auth(token).query(&[("wait", wait_s)]);
            let call = call.query(&[("limit", limit)]).query(&[("prompt", prompt)]);
            call.query(&[("after", after)])
        })
        .await
    }

    /// Acts of a seat of the token in some rounds, at most 20, with their prompts if asked for; fewer where these are long.
    pub async fn swarm_acts(
        &self,
        token: &str,
        episode: &str,
        agent: &str,
        rounds: std::ops::Range<u32>,
        prompt: bool,
    ) -> Result<SeatActs, ClientError> {
        self.ask(Method::GET, "/swarm/acts", |call| {
            let call = call.bearer_auth(token).query(&[("episode", episode), ("agent", agent)]);
            let call = call.query(&[("last", rounds.len()), ("before", rounds.end as usize)]);
            call.query(&[("prompt", prompt)])
        })
        .await
    }

    /// Journal of an episode. Reading requires a token of its creator before the end, and none after it.
    pub async fn journal(&self, id: &str, token: Option<&str>) -> Result<Vec<u8>, ClientError> {
        let path = format!("/api/v1/episodes/{id}/journal");
        self.ask_bytes(&path, |call| self.signed_with(call, token)).await
    }

    /// Acts for several seats.
    pub async fn swarm_act(
        &self,
        token: &str,
        acts: Vec<SwarmAct>,
    ) -> Result<SwarmActResponse, ClientError> {
        let body = SwarmActRequest { acts };
        self.ask(Method::POST, "/swarm/act", |call| call.bearer_auth(token).json(&body)).await
    }

    /// Creates a key. It is not retried: a second attempt would create a second key.
    pub async fn create_key(&self, request: &KeyRequest) -> Result<CreatedKey, ClientError> {
        self.once(Method::POST, "/api/v1/keys", |call| self.signed(call).json(request)).await
    }

    /// All keys, including revoked ones.
    pub async fn keys(&self) -> Result<KeyList, ClientError> {
        self.ask(Method::GET, "/api/v1/keys", |call| self.signed(call)).await
    }

    /// Revokes a key.
    pub async fn revoke_key(&self, id: &str) -> Result<KeySummary, ClientError> {
        self.delete(&format!("/api/v1/keys/{id}")).await
    }

    /// Sends a GET request.
    pub async fn get<T: DeserializeOwned>(&self, path: &str) -> Result<T, ClientError> {
        self.get_with(path, &[]).await
    }

    /// Sends a GET request with a query.
    pub async fn get_with<T: DeserializeOwned>(
        &self,
        path: &str,
        query: &[(&str, &str)],
    ) -> Result<T, ClientError> {
        self.ask(Method::GET, path, |call| self.signed(call).query(query)).await
    }

    /// Sends a POST request. It is not retried: a second attempt would create a second object.
    pub async fn post<T: DeserializeOwned>(
        &self,
        path: &str,
        body: &(impl Serialize + Sync),
    ) -> Result<T, ClientError> {
        self.once(Method::POST, path, |call| self.signed(call).json(body)).await
    }

    /// Sends a DELETE request; returns the remaining state of the object.
    ///
    /// # Errors
    /// See [`ClientError`].
    pub async fn delete<T: DeserializeOwned>(&self, path: &str) -> Result<T, ClientError> {
        self.ask(Method::DELETE, path, |call| self.signed(call)).await
    }

    /// Sends a PATCH request. It is not retried: a change of a competition with `if_revision` is refused after itself, and a
    /// second attempt could undo what somebody else changed in between.
    pub async fn patch<T: DeserializeOwned>(
        &self,
        path: &str,
        body: &(impl Serialize + Sync),
    ) -> Result<T, ClientError> {
        self.once(Method::PATCH, path, |call| self.signed(call).json(body)).await
    }

    /// Whole board, read page by page.
    pub async fn leaderboard(&self, question: &Question) -> Result<Leaderboard, ClientError> {
        let Question { suite, rules, task, sort, pick, no_reference, no_people, imported } =
            question;
        let (reference, imported) = (Some((!no_reference).to_string()), Some(imported.to_string()));
        // Servers of earlier versions do not know this field.
        let people = no_people.then(|| false.to_string());
        let query = [
            ("suite", suite),
            ("rules", rules),
            ("task", task),
            ("sort", sort),
            ("pick", pick),
            ("reference", &reference),
            ("imported", &imported),
            ("people", &people),
        ];
        let mut board: Leaderboard = self.page("/api/v1/leaderboard", &query, None).await?;
        while let Some(cursor) = board.next_cursor {
            let next: Leaderboard = self.page("/api/v1/leaderboard", &query, Some(cursor)).await?;
            board.items.extend(next.items);
            board.next_cursor = next.next_cursor;
        }
        Ok(board)
    }

    /// All pairs of models that played together, read page by page.
    pub async fn cross_play(
        &self,
        task: Option<&str>,
        rules: Option<&str>,
    ) -> Result<CrossPlay, ClientError> {
        let asked = [("task", task), ("rules", rules)];
        let mut found: CrossPlay = self.page("/api/v1/cross-play", &asked, None).await?;
        while let Some(cursor) = found.next_cursor {
            let next: CrossPlay = self.page("/api/v1/cross-play", &asked, Some(cursor)).await?;
            found.items.extend(next.items);
            found.next_cursor = next.next_cursor;
        }
        Ok(found)
    }

    /// A page of the maximum size.
    async fn page<T: DeserializeOwned>(
        &self,
        path: &str,
        query: &(impl Serialize + Sync + ?Sized),
        cursor: Option<String>,
    ) -> Result<T, ClientError> {
        self.ask(Method::GET, path, |call| {
            let call = self.signed(call).query(&[("limit", 1000)]);
            call.query(query).query(&[("cursor", &cursor)])
        })
        .await
    }

    /// Health of the server.
    pub async fn health(&self) -> Result<serde_json::Value, ClientError> {
        self.once(Method::GET, "/healthz", |call| call.timeout(HEALTH_PATIENCE)).await
    }

    /// Sends a repeatable request, and retries it after temporary errors: a read, an act, a creation with an `Idempotency-Key`, or
    /// the deletion of what stays deleted.
    async fn ask<T: DeserializeOwned>(
        &self,
        method: Method,
        path: &str,
        fill: impl Fn(RequestBuilder) -> RequestBuilder + Sync,
    ) -> Result<T, ClientError> {
        self.repeat(method, path, &fill).await?.read()
    }

    /// Sends a GET request; returns the raw body.
    async fn ask_bytes(
        &self,
        path: &str,
        fill: impl Fn(RequestBuilder) -> RequestBuilder + Sync,
    ) -> Result<Vec<u8>, ClientError> {
        Ok(self.repeat(Method::GET, path, &fill).await?.body)
    }

    async fn repeat(
        &self,
        method: Method,
        path: &str,
        fill: Fill<'_>,
    ) -> Result<Answer, ClientError> {
        self.again(|| self.answer(method.clone(), path, fill)).await
    }

    async fn again<T, F: Future<Output = Result<T, ClientError>>>(
        &self,
        ask: impl FnMut() -> F,
    ) -> Result<T, ClientError> {
        ask.retry(ExponentialBuilder::default().with_jitter().with_max_times(REPEATS_MAX))
            .when(|error| error.is_temporary() && !self.is_absent(error))
            .adjust(|error, pause| pause.map(|pause| pause_after(error.retry_after(), pause)))
            .await
    }

    /// True if this client has found no server at the address so far.
    fn is_absent(&self, error: &ClientError) -> bool {
        let ClientError::Transport { error, .. } = error else { return false };
        error.is_connect() && !self.answered.load(Ordering::Relaxed)
    }

    async fn once<T: DeserializeOwned>(
        &self,
        method: Method,
        path: &str,
        fill: impl Fn(RequestBuilder) -> RequestBuilder + Sync,
    ) -> Result<T, ClientError> {
        self.answer(method, path, &fill).await?.read()
    }

    async fn answer(
        &self,
        method: Method,
        path: &str,
        fill: Fill<'_>,
    ) -> Result<Answer, ClientError> {
        let mut url = self.base.clone();
        url.set_path(path);
        let failed = |error| ClientError::Transport { url: url.clone(), error };
        let call = self.http.request(method, url.clone()).timeout(PATIENCE * 3);
        let response = fill(call).send().await.map_err(failed)?;
        self.answered.store(true, Ordering::Relaxed);
        let head = Head::of(url.clone(), &response);
        let body = response.bytes().await.map_err(failed)?;
        if head.status.is_success() {
            return Ok(Answer { url: head.url, status: head.status, body: body.into() });
        }
        Err(head.refused(&body))
    }
}

/// Pause before a retry: as long as the server `asked`, but after about two retries at least about as long as pauses have
/// `grown`. The server does not know how often it has asked, nor how many clients it has.
fn pause_after(asked: Option<Duration>, grown: Duration) -> Duration {
    const AT_ITS_WORD: Duration = Duration::from_secs(2);
    asked.map_or(grown, |asked| asked.max(grown.saturating_sub(AT_ITS_WORD)))
}

/// Unique idempotency key.
fn uuid_text() -> String {
    use swarmbench_clock::{Entropy, SystemEntropy};
    let mut bytes = [0; 16];
    SystemEntropy.fill(&mut bytes);
    data_encoding::HEXLOWER.encode(&bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_server_is_taken_at_its_word_at_first_and_then_left_alone_for_longer() {
        let [short, long] = [Duration::from_millis(50), Duration::from_mins(1)];
        let grown = [1, 2, 4, 8, 16].map(Duration::from_secs);
        assert_eq!(grown.map(|grown| pause_after(None, grown)), grown);
        assert_eq!(
            grown.map(|grown| pause_after(Some(short), grown)),
            [short, short, Duration::from_secs(2), Duration::from_secs(6), Duration::from_secs(14)]
        );
        assert_eq!(grown.map(|grown| pause_after(Some(long), grown)), [long; 5]);
    }
}

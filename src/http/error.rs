//! The only error type that leaves the server.
//!
//! Choice of a code: `malformed` for what cannot be read; `invalid` for what was read and is not allowed; `unauthorized` for an
//! unknown caller, `forbidden` for a known one without the right; `not_found` for what does not exist or may not be known to exist;
//! one of the conflicts (409) for what comes at the wrong time. The server's own faults are `unavailable` (the journal) and
//! `internal` (everything that should not happen); both are logged here, once.

use std::time::Duration;

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};

use swarmbench_engine::SettingErrors;

use super::auth::unknown_token;
use super::forward::IsElsewhere;
use crate::budget::Exhausted;
use crate::episode::actor::{ActError, ClaimError, StartError};
use crate::episode::in_flight::SEAT_ACTS_WAITING_MAX;
use crate::episode::lockstep::Refusal;
use crate::episode::quota::Full;
use crate::episode::recovery::RecoveryError;
use crate::episode::registry::{CreateError, FindError};
use crate::fair::{Busy, HEAVY_AT_ONCE, HEAVY_AT_ONCE_MAX, WAITING_MAX};
use crate::run::{RunError, manager};
use crate::store::StoreError;
use crate::telemetry::Lost;
use crate::work::WorkError;
use swarmbench_boards::collection::Unknown;
use swarmbench_clock::millis;
use swarmbench_prompt::TemplateError;
use swarmbench_protocol::problem::{FieldProblem, Limit, Problem};

/// The kind of an error, stable on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "the table below says what each is for")]
pub enum Code {
    Malformed,
    Unauthorized,
    Forbidden,
    NotFound,
    MethodNotAllowed,
    RoundOver,
    RoundAhead,
    AlreadyActed,
    EpisodeOver,
    SeatTaken,
    SeatsOpen,
    Closed,
    Changed,
    TooLarge,
    UnsupportedMediaType,
    Invalid,
    TemplateFailed,
    RateLimited,
    Internal,
    Overloaded,
    Unavailable,
}

impl Code {
    pub const ALL: [Self; 21] = [
        Self::Malformed,
        Self::Unauthorized,
        Self::Forbidden,
        Self::NotFound,
        Self::MethodNotAllowed,
        Self::RoundOver,
        Self::RoundAhead,
        Self::AlreadyActed,
        Self::EpisodeOver,
        Self::SeatTaken,
        Self::SeatsOpen,
        Self::Closed,
        Self::Changed,
        Self::TooLarge,
        Self::UnsupportedMediaType,
        Self::Invalid,
        Self::TemplateFailed,
        Self::RateLimited,
        Self::Internal,
        Self::Overloaded,
        Self::Unavailable,
    ];

    /// Name, status and title of a code: the table of all errors.
    pub(super) const fn row(self) -> (&'static str, u16, &'static str) {
        match self {
            Self::Malformed => ("malformed", 400, "The request cannot be read"),
            Self::Unauthorized => ("unauthorized", 401, "No token, or an unknown one"),
            Self::Forbidden => ("forbidden", 403, "The token is for something else"),
            Self::NotFound => ("not_found", 404, "There is no such thing"),
            Self::MethodNotAllowed => ("method_not_allowed", 405, "The route has no such method"),
            Self::RoundOver => ("round_over", 409, "The round is over"),
            Self::RoundAhead => ("round_ahead", 409, "The round is not open yet"),
            Self::AlreadyActed => ("already_acted", 409, "The seat has acted in this round"),
            Self::EpisodeOver => ("episode_over", 409, "The episode, or the agent's part, is over"),
            Self::SeatTaken => ("seat_taken", 409, "The seat has a holder"),
            Self::SeatsOpen => ("seats_open", 409, "Seats are open still"),
            Self::Closed => ("closed", 409, "It is not open now"),
            Self::Changed => ("changed", 409, "It was changed meanwhile"),
            Self::TooLarge => ("too_large", 413, "The request is too large"),
            Self::UnsupportedMediaType => ("unsupported_media_type", 415, "The body is not JSON"),
            Self::Invalid => ("invalid", 422, "The request is not allowed"),
            Self::TemplateFailed => ("template_failed", 422, "The prompt template failed"),
            Self::RateLimited => ("rate_limited", 429, "Too many requests"),
            Self::Internal => ("internal", 500, "The server has a fault"),
            Self::Overloaded => ("overloaded", 503, "The server is busy"),
            Self::Unavailable => ("unavailable", 503, "The journal is not available"),
        }
    }

    pub const fn name(self) -> &'static str {
        self.row().0
    }
}

/// An error that will be sent to the client.
#[derive(Clone, Debug)]
pub struct ApiError {
    code: Code,
    detail: String,
    round: Option<u32>,
    retry_after: Option<Duration>,
    limit: Option<Limit>,
    fields: Vec<FieldProblem>,
    /// Another server of the cluster must answer.
    is_elsewhere: bool,
}

impl ApiError {
    /// An error of a kind, with what happened and what to do.
    pub fn new(code: Code, detail: impl Into<String>) -> Self {
        Self {
            code,
            detail: detail.into(),
            round: None,
            retry_after: None,
            limit: None,
            fields: Vec::new(),
            is_elsewhere: false,
        }
    }

    /// An error for what does not exist or may not be known to exist.
    pub fn not_found(what: &str) -> Self {
        Self::new(Code::NotFound, format!("{what} is not known here"))
    }

    pub fn field(field: &str, problem: impl Into<String>) -> Self {
        Self::fields(vec![FieldProblem { field: field.to_owned(), problem: problem.into() }])
    }

    pub fn fields(fields: Vec<FieldProblem>) -> Self {
        let named: Vec<String> =
            fields.iter().map(|field| format!("{} {}", field.field, field.problem)).collect();
        Self { fields, ..Self::new(Code::Invalid, named.join("; ")) }
    }

    /// Refused settings; `prefix` is their path in the body.
    pub fn settings(errors: SettingErrors, prefix: &str) -> Self {
        let named = errors.0.into_iter().map(|error| FieldProblem {
            field: format!("{prefix}{}", error.field),
            problem: error.problem,
        });
        Self::fields(named.collect())
    }

    pub fn limit(code: Code, name: &str, value: usize, detail: impl Into<String>) -> Self {
        let limit = Limit { name: name.to_owned(), value: value as u64 };
        Self { limit: Some(limit), ..Self::new(code, detail) }
    }

    /// Refusal because no permit was free in time, or too many requests wait for one.
    pub fn no_permit(busy: Busy, detail: &str) -> Self {
        Self::limit(Code::Overloaded, busy.name, busy.slots, detail)
            .retry_after(Duration::from_secs(1))
    }

    /// The journal cannot be used. Logs the error.
    fn no_journal(error: &dyn std::fmt::Display) -> Self {
        tracing::error!(%error, "a request failed");
        let detail = "the journal cannot be used; the operator has to look at the log";
        Self::new(Code::Unavailable, detail).retry_after(Duration::from_secs(5))
    }

    /// Refusal of creations while too little of the disk is free.
    pub fn disk_full(least: u32) -> Self {
        let detail = format!(
            "less than {least} % of the server's disk, and less than 2 GiB, is free: what is running continues, nothing new is created"
        );
        Self::limit(Code::Overloaded, "disk_free_percent_min", least as usize, detail)
            .retry_after(Duration::from_mins(1))
    }

    /// Refusal of an `Idempotency-Key` that was used with another body.
    pub fn other_body() -> Self {
        Self::new(
            Code::Invalid,
            "this Idempotency-Key was used with another body; send that body, or another key",
        )
    }

    /// Adds the limit that was reached.
    fn with_limit(self, full: Full) -> Self {
        Self { limit: Some(full.into()), ..self }
    }

    /// Adds the current round of the episode.
    #[must_use]
    pub fn at_round(self, round: u32) -> Self {
        Self { round: Some(round), ..self }
    }

    /// Adds the time after which a retry is worthwhile.
    #[must_use]
    pub fn retry_after(self, after: Duration) -> Self {
        Self { retry_after: Some(after), ..self }
    }

    pub const fn code(&self) -> Code {
        self.code
    }

    pub fn problem(&self) -> Problem {
        let (code, status, title) = self.code.row();
        Problem {
            r#type: format!("urn:swarmbench:problem:{code}"),
            title: title.to_owned(),
            status,
            detail: self.detail.clone(),
            code: code.to_owned(),
            round: self.round,
            retry_after_ms: self.retry_after.map(millis),
            limit: self.limit.clone(),
            fields: self.fields.clone(),
        }
    }
}

impl ApiError {
    /// The problem that is sent. Counts faults of the server.
    pub fn sent(&self) -> Problem {
        let problem = self.problem();
        if problem.status >= 500 {
            metrics::counter!("swarmbench_errors_total", "code" => self.code.name()).increment(1);
        }
        problem
    }
}

impl IntoResponse for ApiError {
    fn into_response(self) -> Response {
        let problem = self.sent();
        let status = StatusCode::from_u16(problem.status).expect("the table has valid statuses");
        let body = serde_json::to_vec(&problem).expect("a problem has string keys");
        let mut response = (status, body).into_response();
        if self.is_elsewhere {
            response.extensions_mut().insert(IsElsewhere);
        }
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/problem+json"));
        if let Some(after) = self.retry_after {
            // Whole seconds, rounded up, so that clients do not come back too early.
            let seconds = after.as_millis().div_ceil(1000);
            headers.insert(
                header::RETRY_AFTER,
                HeaderValue::from(u64::try_from(seconds).unwrap_or(60)),
            );
        }
        if self.code == Code::Unauthorized {
            headers.insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        }
        response
    }
}

impl From<Unknown> for ApiError {
    fn from(unknown: Unknown) -> Self {
        Self::new(Code::Malformed, unknown.to_string())
    }
}

impl From<StoreError> for ApiError {
    fn from(error: StoreError) -> Self {
        if matches!(error, StoreError::Busy) {
            let detail = "too many requests read the database; try again later";
            return Self::limit(Code::Overloaded, HEAVY_AT_ONCE, HEAVY_AT_ONCE_MAX, detail)
                .retry_after(Duration::from_secs(1));
        }
        if matches!(error, StoreError::NoRights) {
            return unknown_token();
        }
        if matches!(error, StoreError::Elsewhere) {
            let detail = "another server of the cluster plays this, or takes it over at this moment: send the same request again";
            let error = Self::new(Code::Unavailable, detail).retry_after(Duration::from_secs(1));
            return Self { is_elsewhere: true, ..error };
        }
        Self::no_journal(&error)
    }
}

impl From<Lost> for ApiError {
    fn from(lost: Lost) -> Self {
        Self::new(Code::Internal, lost.to_string())
    }
}

impl From<RunError> for ApiError {
    fn from(error: RunError) -> Self {
        match error {
            RunError::Store(error) => error.into(),
            RunError::Over(_) => Self::new(Code::EpisodeOver, error.to_string()),
            RunError::GameOpen | RunError::RepeatedOften => {
                Self::new(Code::Changed, error.to_string())
            }
            error => Self::no_journal(&error),
        }
    }
}

impl From<Exhausted> for ApiError {
    fn from(full: Exhausted) -> Self {
        let (name, value) = full.limit();
        Self::limit(Code::Overloaded, name, value, full.to_string())
            .retry_after(Duration::from_secs(5))
    }
}

impl From<FindError> for ApiError {
    fn from(error: FindError) -> Self {
        match error {
            FindError::NoMemory(full) => full.into(),
            FindError::Recovery(error) => error.into(),
        }
    }
}

impl From<WorkError> for ApiError {
    fn from(error: WorkError) -> Self {
        match error {
            WorkError::Busy => {
                let detail = format!("{error}; try again later");
                Self::limit(Code::Overloaded, "waiting_max", WAITING_MAX, detail)
                    .retry_after(Duration::from_secs(1))
            }
            WorkError::BrokeOff => Self::new(Code::Internal, error.to_string()),
        }
    }
}

impl From<RecoveryError> for ApiError {
    fn from(error: RecoveryError) -> Self {
        match error {
            RecoveryError::Journal(error) => error.into(),
            RecoveryError::Work(error) => error.into(),
            RecoveryError::Broken { .. } => {
                tracing::error!(%error, "a request failed");
                Self::new(Code::Internal, "the journal of this episode cannot be replayed")
            }
        }
    }
}

impl From<TemplateError> for ApiError {
    fn from(error: TemplateError) -> Self {
        Self::new(
            Code::TemplateFailed,
            format!(
                "the episode's prompt template fails on this observation: {error}; the round is still open, act without the prompt"
            ),
        )
    }
}

impl From<Refusal> for ApiError {
    fn from(refusal: Refusal) -> Self {
        let (code, round) = match refusal {
            Refusal::RoundAhead { round, .. } => (Code::RoundAhead, round),
            Refusal::AlreadyActed { round, .. } => (Code::AlreadyActed, round),
            Refusal::EpisodeOver { round, .. } => (Code::EpisodeOver, round),
            Refusal::RoundOver { round, .. } => (Code::RoundOver, round),
            Refusal::NoRoom { full: Full::BytesPerSecond { .. }, round } => {
                (Code::RateLimited, round)
            }
            Refusal::NoRoom { round, .. } => (Code::TooLarge, round),
        };
        metrics::counter!("swarmbench_act_refusals_total", "code" => code.name()).increment(1);
        let error = Self::new(code, refusal.to_string()).at_round(round);
        match refusal {
            Refusal::NoRoom { full: full @ Full::BytesPerSecond { after_ms, .. }, .. } => {
                error.with_limit(full).retry_after(Duration::from_millis(after_ms))
            }
            Refusal::NoRoom { full, .. } => error.with_limit(full),
            _ => error,
        }
    }
}

impl From<ActError> for ApiError {
    fn from(error: ActError) -> Self {
        match error {
            ActError::Refused(refusal) => refusal.into(),
            ActError::Busy => {
                let detail = format!("{error}; send the same act again later");
                let most = SEAT_ACTS_WAITING_MAX as usize;
                Self::limit(Code::Overloaded, "seat_acts_waiting_max", most, detail)
                    .retry_after(Duration::from_secs(1))
            }
            ActError::Journal(error) => error.into(),
        }
    }
}

impl From<StartError> for ApiError {
    fn from(error: StartError) -> Self {
        match error {
            StartError::SeatsOpen(_) => {
                Self::new(Code::SeatsOpen, format!("{error}; it can start when all have holders"))
            }
            StartError::Journal(error) => error.into(),
        }
    }
}

impl From<ClaimError> for ApiError {
    fn from(error: ClaimError) -> Self {
        match error {
            ClaimError::SeatTaken(taken) => Self::new(Code::SeatTaken, taken.to_string()),
            ClaimError::Over => {
                Self::new(Code::EpisodeOver, "the episode has ended; its seats cannot be claimed")
            }
            ClaimError::Journal(error) => error.into(),
        }
    }
}

impl From<Full> for Limit {
    fn from(full: Full) -> Self {
        let (name, value) = full.limit();
        Self { name: name.to_owned(), value }
    }
}

impl From<Full> for ApiError {
    fn from(full: Full) -> Self {
        match full {
            Full::BytesOf { .. } => Self::new(Code::Forbidden, full.to_string()).with_limit(full),
            Full::Episodes(_)
            | Full::EpisodesOfKey(_)
            | Full::EpisodesOfShare { .. }
            | Full::BytesOfEpisode(_) => Self::new(Code::Overloaded, full.to_string())
                .with_limit(full)
                .retry_after(Duration::from_secs(10)),
            Full::BytesPerSecond { after_ms, .. } => Self::new(Code::RateLimited, full.to_string())
                .with_limit(full)
                .retry_after(Duration::from_millis(after_ms)),
        }
    }
}

impl From<CreateError> for ApiError {
    fn from(error: CreateError) -> Self {
        match error {
            CreateError::Full(full) => full.into(),
            CreateError::NoMemory(full) => full.into(),
            error @ CreateError::Closed(_) => Self::new(Code::Closed, error.to_string()),
            CreateError::Work(error) => error.into(),
            CreateError::Journal(error) => error.into(),
        }
    }
}

impl From<manager::CreateError> for ApiError {
    fn from(error: manager::CreateError) -> Self {
        match error {
            manager::CreateError::Full(full) => full.into(),
            manager::CreateError::DiskFull(least) => Self::disk_full(least),
            manager::CreateError::Definition(problem) => Self::new(Code::Invalid, problem),
            manager::CreateError::Run(error) => error.into(),
        }
    }
}

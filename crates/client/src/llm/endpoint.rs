//! One request to an endpoint, and its outcome.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use clap::ValueEnum;
use futures::FutureExt;
use futures::future::pending;
use jiff::Timestamp;
use reqwest::header::{CONTENT_TYPE, HeaderMap, HeaderValue, LOCATION, RETRY_AFTER};
use reqwest::{Client, StatusCode, Url, redirect};
use serde_json::{Map, Value, json};

use super::Chat;
use super::api::Api;
use super::completion::{Completion, Refusal, error_of, one_line, parse, refusal};
use super::key::{NoKey, PLACEHOLDER};
use super::settings::Settings;
use super::stop::{Said, Stop};
use super::stream::{Fault, Reader, STREAM_BYTES_MAX};
use crate::http;
use swarmbench_clock::{Clock, after, millis, until};

/// Timeout of a connection attempt.
const CONNECT: Duration = Duration::from_secs(30);

/// Maximum bytes that are read of an answer. A book has fewer.
const BODY_BYTES_MAX: usize = 8 * 1024 * 1024;

/// Part of the timeout for which a stream may pause after its first token. Before it a model may think for as long as the timeout
/// allows, without a byte.
const IDLE_SHARE: u32 = 4;

/// Maximum bytes that are read of a refusal.
const REFUSAL_BYTES_MAX: usize = 64 * 1024;

/// A model at its address.
#[derive(Debug)]
pub(super) struct Endpoint {
    http: Client,
    url: Url,
    /// Address for messages: without query and fragment, which may hold a secret.
    pub(super) shown: String,
    pub(super) settings: Settings,
    /// Fields of all requests.
    pub(super) body: Map<String, Value>,
    /// True once streams are asked for: as it is set, or as the endpoint answers in no other way.
    streams: AtomicBool,
    /// True once the endpoint has refused to count the tokens of a stream.
    refuses_counts: AtomicBool,
}

/// Way in which a request asks for its answer.
#[derive(Clone, Copy, PartialEq)]
struct Mode {
    streams: bool,
    counts_tokens: bool,
}

/// Course of a request, as far as it came.
#[derive(Debug, Default)]
pub(super) struct Course {
    /// Bytes of a stream that were read.
    read: AtomicUsize,
    /// True if the endpoint charges nothing: it was not reached, or has refused.
    is_free: AtomicBool,
}

impl Course {
    pub(super) fn is_free(&self) -> bool {
        self.is_free.load(Ordering::Relaxed)
    }

    fn set_free(&self, is_free: bool) {
        self.is_free.store(is_free, Ordering::Relaxed);
    }
}

/// Reason why there is no answer.
#[derive(Debug)]
pub(super) enum Trouble {
    /// A retry cannot help.
    Final(Stop),
    /// A retry may help.
    Passing(Passing),
}

/// A failure that a retry may repair.
#[derive(Debug)]
pub(super) struct Passing {
    pub(super) kind: Kind,
    /// Text for people.
    pub(super) said: String,
    /// Pause that the endpoint asks for.
    pub(super) wait: Option<Duration>,
    /// True if a gateway without any model may have failed so.
    pub(super) is_strange: bool,
}

/// Kind of a failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// The endpoint is overloaded.
    Load,
    /// No answer in time.
    TimeOut,
    /// No connection, or one that broke.
    Connection,
    /// An error of the server.
    Server,
    /// Something that is no answer.
    Unreadable,
}

impl Passing {
    fn trouble(kind: Kind, said: String) -> Trouble {
        Trouble::Passing(Self { kind, said, wait: None, is_strange: true })
    }
}

impl Endpoint {
    /// # Errors
    /// [`Stop::Settings`] or [`Stop::WrongKey`] for settings that cannot work.
    pub(super) fn new(settings: Settings) -> Result<Self, Stop> {
        let url = settings.url()?;
        let body = settings.body()?;
        let mut shown = url.clone();
        shown.set_query(None);
        shown.set_fragment(None);
        let shown = shown.to_string();
        let mut headers = HeaderMap::new();
        let (key_header, prefix) = settings.api.key_header();
        match settings.key.header(prefix) {
            None => {}
            Some(Ok(header)) => {
                headers.insert(key_header, header);
            }
            Some(Err(NoKey)) => {
                return Err(Stop::Settings(format!(
                    "the key in {} has characters that no key has: a line break, perhaps, two keys in one, or a letter \
                     that is not ASCII",
                    settings.key.variable()
                )));
            }
        }
        if let Some((name, version)) = settings.api.version_header() {
            headers.insert(name, HeaderValue::from_static(version));
        }
        for (name, value) in settings.headers.values() {
            headers.insert(name, value.clone());
        }
        let http = http::builder(url.host_str())
            .default_headers(headers)
            .connect_timeout(CONNECT)
            // The key is sent to the named address only.
            .redirect(redirect::Policy::none())
            .user_agent(concat!("swarmbench/", env!("CARGO_PKG_VERSION")))
            .build()
            .map_err(|error| Stop::Settings(format!("no HTTP client: {error}")))?;
        let streams = AtomicBool::new(settings.streams);
        Ok(Self {
            http,
            url,
            shown,
            settings,
            body,
            streams,
            refuses_counts: AtomicBool::new(false),
        })
    }

    /// Origin of the server. Limits of concurrent requests apply to the whole server.
    pub(super) fn origin(&self) -> String {
        self.url.origin().ascii_serialization()
    }

    /// Sends one request. Returns the answer with its times.
    pub(super) async fn ask(
        &self,
        chat: &Chat<'_>,
        clock: &dyn Clock,
        course: &Course,
    ) -> Result<Completion, Trouble> {
        let began = clock.now();
        let timeout = self.settings.timeout;
        let exchange = async {
            // A refusal changes a mode at most once, so this ends.
            loop {
                if let Some(answered) = self.exchange(chat, clock, began, course).await? {
                    return Ok(answered);
                }
            }
        };
        let (mut completion, first_token) = tokio::select! {
            result = exchange => result?,
            () = clock.sleep_until(after(began, timeout)) => {
                let begun = match course.read.load(Ordering::Relaxed) {
                    0 => String::new(),
                    bytes => format!("; its stream had begun, with {bytes} bytes"),
                };
                let said = format!("no whole answer within {} s{begun}", timeout.as_secs_f64());
                return Err(Passing::trouble(Kind::TimeOut, said));
            }
        };
        let usage = &mut completion.answer.usage;
        usage.latency_ms = Some(millis(until(began, clock.now())));
        usage.first_token_ms = first_token.map(millis);
        Ok(completion)
    }

    fn mode(&self) -> Mode {
        let is_set = |flag: &AtomicBool| flag.load(Ordering::Relaxed);
        Mode { streams: is_set(&self.streams), counts_tokens: !is_set(&self.refuses_counts) }
    }

    /// Sends one request in the current mode. `None` if the endpoint wants another mode, which is set then.
    async fn exchange(
        &self,
        chat: &Chat<'_>,
        clock: &dyn Clock,
        began: Timestamp,
        course: &Course,
    ) -> Result<Option<(Completion, Option<Duration>)>, Trouble> {
        course.set_free(false);
        let mode = self.mode();
        let mut body = chat.fields();
        if mode.streams {
            body.extend(self.settings.api.stream(mode.counts_tokens));
        }
        for (name, value) in &self.body {
            match (body.get_mut(name), value) {
                // A schema and an effort may share an object.
                (Some(Value::Object(own)), Value::Object(more)) => own.extend(more.clone()),
                _ => drop(body.insert(name.clone(), value.clone())),
            }
        }
        let request = self.http.post(self.url.clone()).json(&body);
        let mut response = request.send().await.map_err(|error| {
            course.set_free(error.is_connect());
            self.broken(error)
        })?;
        let (status, headers) = (response.status(), response.headers().clone());
        course.set_free(!status.is_success());
        if status.is_redirection() {
            return Err(Trouble::Final(self.elsewhere(status, &headers)));
        }
        let wait = wait_of(&headers, clock.now());
        if !status.is_success() {
            let body = self.body_of(response, Vec::new(), REFUSAL_BYTES_MAX).await;
            let refusal = refusal(&body.unwrap_or_default().bytes);
            if self.adapts(mode, status.as_u16(), &refusal) {
                return Ok(None);
            }
            let excused = self.refused(chat, status.as_u16(), &refusal, wait)?;
            return Ok(Some((excused, None)));
        }
        let first = response.chunk().await.map_err(|error| self.broken(error))?;
        let first = first.unwrap_or_default().to_vec();
        let (value, first_token) = if is_event_stream(&headers) || Reader::is_stream(&first) {
            course.read.store(first.len(), Ordering::Relaxed);
            let streamed = self.stream(response, &first, clock, &course.read).await?;
            (streamed.0, streamed.1.map(|at| until(began, at)))
        } else {
            let body = self.body_of(response, first, BODY_BYTES_MAX).await?;
            if body.is_cut {
                let said = format!("an answer of more than {BODY_BYTES_MAX} bytes");
                return Err(Passing::trouble(Kind::Unreadable, said));
            }
            let value = parse(&body.bytes);
            let shown = || self.unreadable(status, &headers, &body.bytes);
            (value.ok_or_else(shown)?, None)
        };
        if let Some(refusal) = error_of(&value) {
            // A router that has begun to answer cannot change its status, and reports an error in the body.
            let status = refusal.status.filter(|status| *status >= 400);
            return match status {
                Some(status) => Ok(Some((self.refused(chat, status, &refusal, wait)?, None))),
                None => Err(Passing::trouble(Kind::Server, self.quoted(&refusal.said))),
            };
        }
        let unreadable = || self.unreadable(status, &headers, value.to_string().as_bytes());
        Ok(Some((chat.read(&value).ok_or_else(unreadable)?, first_token)))
    }

    /// Reads a stream to its end. Returns the body that a whole answer would have, or the error that the stream reports, and
    /// the time of the first token.
    async fn stream(
        &self,
        mut response: reqwest::Response,
        first: &[u8],
        clock: &dyn Clock,
        read: &AtomicUsize,
    ) -> Result<(Value, Option<Timestamp>), Trouble> {
        let broken = |what: String| {
            let said = self.quoted(&format!("a stream that {what}"));
            Passing::trouble(Kind::Unreadable, said)
        };
        let mut reader = Reader::new(self.settings.api);
        let mut first_token = None;
        let mut outcome = reader.read(first);
        loop {
            let is_over = match outcome {
                Ok(is_over) => is_over,
                Err(Fault::Error(body)) => return Ok((self.reported(body), None)),
                Err(Fault::Broken(what)) => return Err(broken(what)),
            };
            if first_token.is_none() && reader.has_token() {
                first_token = Some(clock.now());
            }
            if is_over {
                // The connection can be used again if its last bytes are here.
                drop(response.chunk().now_or_never());
                break;
            }
            let idle = self.settings.timeout / IDLE_SHARE;
            let idles = async {
                match first_token {
                    Some(_) => clock.sleep_until(after(clock.now(), idle)).await,
                    None => pending().await,
                }
            };
            let piece = tokio::select! {
                piece = response.chunk() => piece.map_err(|error| self.broken(error))?,
                () = idles => {
                    let (bytes, idle) = (read.load(Ordering::Relaxed), idle.as_secs_f64());
                    let said = format!("a stream that stalled: nothing for {idle} s after {bytes} bytes");
                    return Err(Passing::trouble(Kind::TimeOut, said));
                }
            };
            let Some(piece) = piece else { break };
            if read.fetch_add(piece.len(), Ordering::Relaxed) + piece.len() > STREAM_BYTES_MAX {
                return Err(broken(format!("had more than {STREAM_BYTES_MAX} bytes")));
            }
            outcome = reader.read(&piece);
        }
        match reader.body() {
            Ok(body) => Ok((body, first_token)),
            Err(Fault::Error(body)) => Ok((self.reported(body), None)),
            Err(Fault::Broken(what)) => Err(broken(what)),
        }
    }

    /// Changes the mode, and returns true, if a refusal demands another than that of the request.
    fn adapts(&self, mode: Mode, status: u16, refusal: &Refusal) -> bool {
        if ![400, 422].contains(&status) {
            return false;
        }
        let said = refusal.said.to_ascii_lowercase();
        if !mode.streams && wants_stream(&said) {
            self.streams.store(true, Ordering::Relaxed);
        } else if mode.streams && mode.counts_tokens && said.contains("stream_options") {
            self.refuses_counts.store(true, Ordering::Relaxed);
        } else {
            return false;
        }
        true
    }

    /// Failure of a success that is no answer.
    fn unreadable(&self, status: StatusCode, headers: &HeaderMap, body: &[u8]) -> Trouble {
        let kind = headers.get(CONTENT_TYPE).and_then(|kind| kind.to_str().ok());
        let kind = self.quoted(kind.unwrap_or("no type"));
        let kind = kind.split(';').next().unwrap_or_default();
        let status = status.as_u16();
        let shown = self.quoted(&String::from_utf8_lossy(body));
        let said = if kind.contains("json") {
            format!("{status} with {kind} that is no {}: {shown}", self.settings.api.answer())
        } else {
            format!("{status} with {kind}, is the address right? It begins: {shown}")
        };
        Passing::trouble(Kind::Unreadable, said)
    }

    /// Outcome of a failed request, by its status.
    fn refused(
        &self,
        chat: &Chat<'_>,
        status: u16,
        refusal: &Refusal,
        wait: Option<Duration>,
    ) -> Result<Completion, Trouble> {
        let url = self.shown.clone();
        let key = self.settings.credential();
        let (variable, state) = (key.variable().to_owned(), key.state());
        let model = self.settings.model.clone();
        let said = Said(self.quoted(&refusal.said));
        if status == 400 && refusal.said.contains("credit balance is too low") {
            return Err(Trouble::Final(Stop::NoCredit { url, status, said }));
        }
        if let Some(completion) = chat.excuse(status, refusal, &said) {
            return Ok(completion);
        }
        let passing = |kind| {
            let Said(said) = &said;
            let said =
                if said.is_empty() { status.to_string() } else { format!("{status}, {said}") };
            // Gateways without a model behind them say 503, but count no requests and name no time.
            let is_model = status == 429 || wait.is_some() || refusal.has_error;
            let is_strange = kind != Kind::Load || !is_model;
            Err(Trouble::Passing(Passing { kind, said, wait, is_strange }))
        };
        let stop = match status {
            429 if refusal.names.iter().any(|name| is_about_credit(name)) => {
                Stop::NoCredit { url, status, said }
            }
            429 | 503 | 529 => return passing(Kind::Load),
            408 | 409 | 425 | 500.. => return passing(Kind::Server),
            401 => Stop::WrongKey { url, variable, state, said },
            402 => Stop::NoCredit { url, status, said },
            403 => Stop::Forbidden { url, variable, state, model, said },
            404 | 405 => Stop::NotFound { url, status, model, hint: self.not_found(refusal), said },
            _ => Stop::BadRequest { url, status, hint: self.hint(refusal), said },
        };
        Err(Trouble::Final(stop))
    }

    /// Hint for an address or model that was not found.
    fn not_found(&self, refusal: &Refusal) -> String {
        let base = self.shown.trim_end_matches(self.settings.api.path());
        let names_model = refusal.names.iter().any(|name| name.contains("model"))
            || refusal.said.contains(&self.settings.model);
        let hint = if names_model {
            format!("{base}/models lists the models that the endpoint has")
        } else if base.ends_with("/v1") {
            "see whether the api base is right, and whether the endpoint has that model".to_owned()
        } else {
            format!("many endpoints want /v1 at the end of the api base: {base}/v1")
        };
        let others = Api::value_variants().iter().filter(|api| **api != self.settings.api);
        let others: Vec<_> = others.map(|api| format!("--api {}", api.name())).collect();
        format!(
            "{hint}. Some models are asked by another interface only: try {}",
            others.join(" or ")
        )
    }

    /// Hint for a refused request, if the refusal names the fault.
    fn hint(&self, refusal: &Refusal) -> String {
        if let Some(field) = self.settings.extra.keys().find(|field| refusal.said.contains(*field))
        {
            return format!(": leave {field} out of --extra, or of `extra` in the file");
        }
        let is_meant = |words: &[&str]| words.iter().all(|word| refusal.said.contains(word));
        let found = HINTS.iter().find(|(words, _)| is_meant(words));
        found.map(|(_, hint)| format!(": {hint}")).unwrap_or_default()
    }

    fn elsewhere(&self, status: StatusCode, headers: &HeaderMap) -> Stop {
        let to = headers.get(LOCATION).and_then(|to| to.to_str().ok()).and_then(|to| {
            let (plain, mut to) = (to.split(['?', '#']).next()?, self.url.join(to).ok()?);
            to.set_query(None);
            to.set_fragment(None);
            to.set_username("").ok()?;
            to.set_password(None).ok()?;
            let base = to.path().strip_suffix(self.settings.api.path()).map(str::to_owned);
            to.set_path(&base.unwrap_or_else(|| to.path().to_owned()));
            let shown = self.quoted(to.as_str());
            // Parsed, an address may write characters of a key in another way.
            let is_hidden = self.settings.redacted(plain) != plain && !shown.contains(PLACEHOLDER);
            (!is_hidden).then_some(shown)
        });
        let to = to.unwrap_or_else(|| "an address that cannot be read".to_owned());
        Stop::Elsewhere { url: self.shown.clone(), status: status.as_u16(), to }
    }

    /// Failure to connect, or a broken connection.
    fn broken(&self, error: reqwest::Error) -> Trouble {
        let kind = if error.is_timeout() { Kind::TimeOut } else { Kind::Connection };
        // The innermost error names the cause; the outermost one names the address, which may contain a secret.
        let error = error.without_url();
        let mut cause: &dyn std::error::Error = &error;
        while let Some(deeper) = cause.source() {
            cause = deeper;
        }
        let said = self.quoted(&cause.to_string());
        Passing::trouble(kind, said)
    }

    /// The rest of a body after its first bytes.
    async fn body_of(
        &self,
        mut response: reqwest::Response,
        first: Vec<u8>,
        most: usize,
    ) -> Result<Body, Trouble> {
        let mut body = Body { bytes: first, is_cut: false };
        while let Some(piece) = response.chunk().await.map_err(|error| self.broken(error))? {
            let room = most.saturating_sub(body.bytes.len());
            body.bytes.extend_from_slice(&piece[..piece.len().min(room)]);
            if piece.len() > room {
                body.is_cut = true;
                break;
            }
        }
        Ok(body)
    }

    /// Quotation without secrets. They are removed before the text is cut, as a cut could leave a part of one.
    fn quoted(&self, text: &str) -> String {
        one_line(&self.settings.redacted(text))
    }

    /// Body with the error that a stream reports. One without a message is quoted.
    fn reported(&self, body: Value) -> Value {
        match error_of(&body) {
            Some(_) => body,
            None => json!({ "error": { "message": self.quoted(&body.to_string()) } }),
        }
    }
}

#[derive(Default)]
struct Body {
    bytes: Vec<u8>,
    is_cut: bool,
}

/// True if the answer is a stream of events.
fn is_event_stream(headers: &HeaderMap) -> bool {
    let kind = headers.get(CONTENT_TYPE).and_then(|kind| kind.to_str().ok());
    kind.is_some_and(|kind| kind.trim_start().to_ascii_lowercase().starts_with("text/event-stream"))
}

/// A refusal, in lower case, asks for `"stream": true`. One that names `stream_options` concerns another field.
fn wants_stream(said: &str) -> bool {
    let demands = ["true", "only", "must", "require"].iter().any(|word| said.contains(word));
    said.contains("stream") && demands && !said.contains("stream_options")
}

/// True if a 429 concerns the credit of the account.
fn is_about_credit(name: &str) -> bool {
    [
        "insufficient_quota",
        "billing_hard_limit_reached",
        "billing_not_active",
        "insufficient_credits",
    ]
    .contains(&name)
}

/// Hints for refused requests, by the words that all stand in the refusal.
const HINTS: &[(&[&str], &str)] = &[
    (
        &["max_completion_tokens", "max_tokens"],
        "leave --max-tokens out and say --max-completion-tokens in its place",
    ),
    (&["max_completion_tokens"], "say --max-tokens in place of --max-completion-tokens"),
    (&["max_tokens"], "say another --max-tokens, or leave it out"),
    (&["max_output_tokens"], "say another --max-completion-tokens, or leave it out"),
    (&["budget_tokens"], "say another --thinking-budget, or an --effort in its place"),
    (&["summary"], "leave --reasoning-summary out"),
    (&["effort"], "say another --effort, or leave it out"),
    (&["temperature"], "say another --temperature, or leave it out"),
    (&["top_p"], "say another --top-p, or leave it out"),
    (&["context"], "the prompt is too long for this model: try a smaller --view-size or --memory"),
    (&["valid model"], "see whether the endpoint has a model of this name"),
];

/// Pause that the endpoint asks for, in milliseconds, in seconds, or until a date.
fn wait_of(headers: &HeaderMap, now: Timestamp) -> Option<Duration> {
    let text = |name: &str| Some(headers.get(name)?.to_str().ok()?.trim().to_owned());
    let number = |text: String, unit: f64| {
        text.parse().ok().and_then(|value: f64| Duration::try_from_secs_f64(value * unit).ok())
    };
    if let Some(wait) = text("retry-after-ms").and_then(|ms| number(ms, 1e-3)) {
        return Some(wait);
    }
    let asked = text(RETRY_AFTER.as_str())?;
    let date = |text: &str| {
        let at = Timestamp::try_from(httpdate::parse_http_date(text).ok()?).ok()?;
        Some(until(now, at))
    };
    number(asked.clone(), 1.0).or_else(|| date(&asked))
}

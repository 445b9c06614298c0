//! One request to an endpoint, and its outcome.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use jiff::Timestamp;
use reqwest::header::{CONTENT_TYPE, HeaderMap, HeaderValue, LOCATION, RETRY_AFTER};
use reqwest::{Client, StatusCode, Url, redirect};
use serde_json::{Map, Value};

use super::Chat;
use super::completion::{Completion, Refusal, error_of, one_line, parse, refusal};
use super::key::NoKey;
use super::settings::Settings;
use super::stop::{Said, Stop};
use crate::http;
use swarmbench_clock::{Clock, after, until};

/// Timeout of a connection attempt.
const CONNECT: Duration = Duration::from_secs(30);

/// Maximum bytes that are read of an answer. A book has fewer.
const BODY_BYTES_MAX: usize = 8 * 1024 * 1024;

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
    /// True if the endpoint has answered at least once.
    has_spoken: AtomicBool,
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
    /// True if the endpoint never answered, so the address may be wrong.
    pub(super) is_nobody: bool,
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
        Trouble::Passing(Self { kind, said, wait: None, is_nobody: false })
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
        Ok(Self { http, url, shown, settings, body, has_spoken: AtomicBool::new(false) })
    }

    /// Origin of the server. Limits of concurrent requests apply to the whole server.
    pub(super) fn origin(&self) -> String {
        self.url.origin().ascii_serialization()
    }

    /// Sends one request. Returns the answer and its latency.
    pub(super) async fn ask(
        &self,
        chat: &Chat<'_>,
        clock: &dyn Clock,
    ) -> Result<(Completion, Duration), Trouble> {
        let began = clock.now();
        let timeout = self.settings.timeout;
        let completion = tokio::select! {
            result = self.exchange(chat, clock) => result?,
            () = clock.sleep_until(after(began, timeout)) => {
                let said = format!("no whole answer within {} s", timeout.as_secs_f64());
                return Err(Passing::trouble(Kind::TimeOut, said));
            }
        };
        Ok((completion, until(began, clock.now())))
    }

    async fn exchange(&self, chat: &Chat<'_>, clock: &dyn Clock) -> Result<Completion, Trouble> {
        let mut body = self.body.clone();
        body.extend(chat.fields());
        let request = self.http.post(self.url.clone()).json(&body);
        let response = request.send().await.map_err(|error| self.broken(error))?;
        self.has_spoken.store(true, Ordering::Relaxed);
        let (status, headers) = (response.status(), response.headers().clone());
        if status.is_redirection() {
            return Err(Trouble::Final(self.elsewhere(status, &headers)));
        }
        let wait = wait_of(&headers, clock.now());
        if status.is_success() && is_event_stream(&headers) {
            // The stream is not read, as it may never end.
            return Err(Trouble::Final(self.only_streams(Said::default())));
        }
        if !status.is_success() {
            let body = self.body_of(response, REFUSAL_BYTES_MAX).await.unwrap_or_default();
            return self.refused(chat, status.as_u16(), &refusal(&body.bytes), wait);
        }
        let body = self.body_of(response, BODY_BYTES_MAX).await?;
        if body.bytes.starts_with(b"data: ") || body.bytes.starts_with(b"event: ") {
            return Err(Trouble::Final(self.only_streams(Said::default())));
        }
        if body.is_cut {
            let said = format!("an answer of more than {BODY_BYTES_MAX} bytes");
            return Err(Passing::trouble(Kind::Unreadable, said));
        }
        let unreadable = || {
            let shown = self.quoted(&String::from_utf8_lossy(&body.bytes));
            let kind =
                headers.get(CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or("no type");
            let said = format!(
                "{} ({}) that is no {}: {shown}",
                status.as_u16(),
                one_line(kind),
                self.settings.api.answer()
            );
            Passing::trouble(Kind::Unreadable, said)
        };
        let value = parse(&body.bytes).ok_or_else(unreadable)?;
        if let Some(refusal) = error_of(&value) {
            // A router that has begun to answer cannot change its status, and reports an error in the body.
            let status = refusal.status.filter(|status| *status >= 400);
            return match status {
                Some(status) => self.refused(chat, status, &refusal, wait),
                None => Err(Passing::trouble(Kind::Server, self.quoted(&refusal.said))),
            };
        }
        chat.read(&value).ok_or_else(unreadable)
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
        if [400, 422].contains(&status) && wants_stream(&refusal.said) {
            return Err(Trouble::Final(self.only_streams(said)));
        }
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
            Err(Trouble::Passing(Passing { kind, said, wait, is_nobody: false }))
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
            _ => Stop::BadRequest { url, status, hint: hint(refusal), said },
        };
        Err(Trouble::Final(stop))
    }

    fn only_streams(&self, said: Said) -> Stop {
        Stop::OnlyStreams { url: self.shown.clone(), said }
    }

    /// Hint for an address or model that was not found.
    fn not_found(&self, refusal: &Refusal) -> String {
        let base = self.shown.trim_end_matches(self.settings.api.path());
        let names_model = refusal.names.iter().any(|name| name.contains("model"))
            || refusal.said.contains(&self.settings.model);
        if names_model {
            format!("{base}/models lists the models that the endpoint has")
        } else if base.ends_with("/v1") {
            "see whether the api base is right, and whether the endpoint has that model".to_owned()
        } else {
            format!("many endpoints want /v1 at the end of the api base: {base}/v1")
        }
    }

    fn elsewhere(&self, status: StatusCode, headers: &HeaderMap) -> Stop {
        let to = headers.get(LOCATION).and_then(|to| to.to_str().ok()).and_then(|to| {
            let mut to = self.url.join(to).ok()?;
            to.set_query(None);
            to.set_fragment(None);
            to.set_username("").ok()?;
            to.set_password(None).ok()?;
            let base = to.path().strip_suffix(self.settings.api.path()).map(str::to_owned);
            to.set_path(&base.unwrap_or_else(|| to.path().to_owned()));
            Some(self.quoted(to.as_str()))
        });
        let to = to.unwrap_or_else(|| "an address that cannot be read".to_owned());
        Stop::Elsewhere { url: self.shown.clone(), status: status.as_u16(), to }
    }

    /// Failure to connect, or a broken connection.
    fn broken(&self, error: reqwest::Error) -> Trouble {
        let kind = if error.is_timeout() { Kind::TimeOut } else { Kind::Connection };
        let is_nobody = error.is_connect() && !self.has_spoken.load(Ordering::Relaxed);
        // The innermost error names the cause; the outermost one names the address, which may contain a secret.
        let error = error.without_url();
        let mut cause: &dyn std::error::Error = &error;
        while let Some(deeper) = cause.source() {
            cause = deeper;
        }
        let said = self.quoted(&cause.to_string());
        Trouble::Passing(Passing { kind, said, wait: None, is_nobody })
    }

    async fn body_of(&self, mut response: reqwest::Response, most: usize) -> Result<Body, Trouble> {
        let mut body = Body::default();
        while let Some(piece) = response.chunk().await.map_err(|error| self.broken(error))? {
            let room = most - body.bytes.len();
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

/// A refusal asks for `"stream": true`. One that names `stream_options` concerns another field.
fn wants_stream(said: &str) -> bool {
    let said = said.to_ascii_lowercase();
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

/// Hint for a refused request, if the refusal names the fault.
fn hint(refusal: &Refusal) -> String {
    let hints: &[(&[&str], &str)] = &[
        (
            &["max_completion_tokens", "max_tokens"],
            "leave --max-tokens out and say --extra '{\"max_completion_tokens\": …}' in its place",
        ),
        (&["max_completion_tokens"], "say --max-tokens in place of max_completion_tokens"),
        (&["max_tokens"], "say another --max-tokens, or leave it out"),
        (&["temperature"], "say another --temperature, or leave it out"),
        (&["top_p"], "say another --top-p, or leave it out"),
        (
            &["context"],
            "the prompt is too long for this model: try a smaller --view-size or --memory",
        ),
        (&["valid model"], "see whether the endpoint has a model of this name"),
    ];
    let is_meant = |words: &[&str]| words.iter().all(|word| refusal.said.contains(word));
    let found = hints.iter().find(|(words, _)| is_meant(words));
    found.map(|(_, hint)| format!(": {hint}")).unwrap_or_default()
}

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

//! The HTML document of all pages, and its content security policy.

use axum::extract::Request;
use axum::http::header::{
    ACCEPT, CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HeaderName, REFERRER_POLICY,
};
use axum::http::{HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use percent_encoding::{NON_ALPHANUMERIC, utf8_percent_encode};

use super::super::App;
use crate::pages::escape;

const DOCUMENT: &str = include_str!("../../../static/page.html");

/// Policy: scripts, styles and requests from this server only, nothing inline, and no conversion of text to markup. The one
/// policy of trusted types names the script of the shared worker (`static/assets/parts/events.js`).
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; \
    connect-src 'self'; font-src 'self'; base-uri 'none'; form-action 'none'; \
    require-trusted-types-for 'script'; trusted-types streams; frame-ancestors ";

const OPENER_POLICY: HeaderName = HeaderName::from_static("cross-origin-opener-policy");

const DESCRIPTION: &str =
    "Language models play as a swarm: each sees a small window, and talks to its neighbours only.";

/// Sites that may show a page in a frame.
#[derive(Clone, Copy)]
pub(in super::super) enum Framing {
    Nobody,
    Anyone,
}

/// Differences between the documents of pages.
pub(in super::super) struct Shell {
    title: String,
    description: String,
    /// Routes with the same data, for browsers without scripts.
    links: Vec<String>,
    framing: Framing,
    status: StatusCode,
}

impl Shell {
    pub(super) fn new(title: &str) -> Self {
        Self {
            title: title.to_owned(),
            description: DESCRIPTION.to_owned(),
            links: Vec::new(),
            framing: Framing::Nobody,
            status: StatusCode::OK,
        }
    }

    /// Page of an unknown address.
    pub(in super::super) fn not_found() -> Self {
        Self { status: StatusCode::NOT_FOUND, ..Self::new("No such page") }
    }

    pub(super) fn description(mut self, text: &str) -> Self {
        text.clone_into(&mut self.description);
        self
    }

    pub(super) fn framing(mut self, framing: Framing) -> Self {
        self.framing = framing;
        self
    }

    pub(super) fn links(mut self, routes: &[&str]) -> Self {
        self.links.extend(routes.iter().map(|&route| route.to_owned()));
        self
    }

    pub(super) fn link(mut self, route: &str, query: &[(&str, &str)]) -> Self {
        let query = query.iter().map(|(name, value)| format!("{name}={}", escape_url(value)));
        self.links.push(format!("{route}?{}", query.collect::<Vec<_>>().join("&")));
        self
    }

    /// Adds links to the sub-routes of one object.
    pub(super) fn below(mut self, route: &str, id: &str, parts: &[&str]) -> Self {
        let id = escape_url(id);
        self.links.extend(parts.iter().map(|part| format!("{route}/{id}{part}")));
        self
    }

    pub(in super::super) fn response(&self, app: &App) -> Response {
        let ancestors = match self.framing {
            Framing::Nobody => "'none'",
            Framing::Anyone => "*",
        };
        let policy = HeaderValue::try_from(format!("{POLICY}{ancestors}"));
        let headers = [
            (CONTENT_TYPE, HeaderValue::from_static("text/html; charset=utf-8")),
            (CONTENT_SECURITY_POLICY, policy.expect("it is plain text")),
            (REFERRER_POLICY, HeaderValue::from_static("no-referrer")),
            (OPENER_POLICY, HeaderValue::from_static("same-origin")),
            (CACHE_CONTROL, HeaderValue::from_static("no-cache")),
        ];
        (self.status, headers, self.document(app.pages.version())).into_response()
    }

    fn document(&self, version: &str) -> String {
        let link = |route: &String| {
            let route = escape(route);
            format!("<li><a href=\"{route}\">{route}</a></li>")
        };
        let values = [
            ("{version}", version.to_owned()),
            ("{title}", escape(&self.title)),
            ("{description}", escape(&self.description)),
            ("{links}", self.links.iter().map(link).collect()),
        ];
        fill(DOCUMENT, &values)
    }
}

/// Replaces placeholders by values. Placeholders in values are not replaced.
fn fill(template: &str, values: &[(&str, String)]) -> String {
    let mut filled = String::with_capacity(template.len() + 1024);
    let mut rest = template;
    while let Some(start) = rest.find('{') {
        let (before, from) = rest.split_at(start);
        filled.push_str(before);
        if let Some((name, value)) = values.iter().find(|(name, _)| from.starts_with(name)) {
            filled.push_str(value);
            rest = &from[name.len()..];
        } else {
            filled.push('{');
            rest = &from[1..];
        }
    }
    filled.push_str(rest);
    filled
}

/// Browsers accept HTML; other clients get the answer for programs.
pub(in super::super) fn wants_page(request: &Request) -> bool {
    let accept = request.headers().get(ACCEPT).and_then(|accept| accept.to_str().ok());
    accept.is_some_and(|accept| accept.contains("text/html"))
        && !request.uri().path().starts_with("/api/")
}

fn escape_url(text: &str) -> String {
    utf8_percent_encode(text, NON_ALPHANUMERIC).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_text_and_fill_their_places_once() {
        let shell = Shell::new("<script>{links}\u{202e}").below("/api/v1/runs", "\"><b>/é", &[""]);
        let document = shell.document("abc");
        assert!(document.contains("&lt;script&gt;{links}\u{fffd}"), "{document}");
        assert!(!document.contains("<script>{links}"));
        assert!(document.contains("href=\"/api/v1/runs/%22%3E%3Cb%3E%2F%C3%A9\""), "{document}");
        assert!(document.contains("/assets/abc/app.js"), "{document}");
        assert!(!document.contains("{version}"));
    }
}

//! Requests and answers.

use std::sync::LazyLock;

use reqwest::{Method, RequestBuilder, StatusCode};
use serde_json::Value;

/// A request that is being built.
pub(crate) struct Call(pub(super) RequestBuilder);

impl Call {
    pub(crate) fn token(self, token: &str) -> Self {
        Self(self.0.bearer_auth(token))
    }

    pub(crate) fn header(self, name: &str, value: &str) -> Self {
        Self(self.0.header(name, value))
    }

    pub(crate) fn json(self, body: &Value) -> Self {
        Self(self.0.json(body))
    }

    /// A body that says that it is JSON.
    pub(crate) fn body(self, body: impl Into<Vec<u8>>) -> Self {
        Self(self.0.header("content-type", "application/json").body(body.into()))
    }

    /// The answer before its body has come.
    pub(crate) async fn open(self) -> reqwest::Response {
        self.0.send().await.expect("an answer")
    }

    pub(crate) async fn send(self) -> HttpAnswer {
        HttpAnswer::of(self.open().await).await
    }

    /// The body of an answer that is no error.
    pub(crate) async fn ok(self) -> Value {
        let answer = self.send().await;
        let good = [StatusCode::OK, StatusCode::CREATED].map(|status| status.as_u16());
        assert!(good.contains(&answer.status), "{} {}", answer.status, answer.text());
        answer.json()
    }

    /// The problem that is expected; the OpenAPI document must have announced it.
    pub(crate) async fn problem(self, status: u16, code: &str) -> Value {
        let (client, request) = self.0.build_split();
        let request = request.expect("a request");
        let (method, path) = (request.method().clone(), request.url().path().to_owned());
        let answer = HttpAnswer::of(client.execute(request).await.expect("an answer")).await;
        assert_eq!(answer.header("content-type"), "application/problem+json", "{}", answer.text());
        let problem = answer.json();
        check_problem(&problem, status, code);
        assert_eq!(answer.status, status, "{problem}");
        if let Some(said) = announced(&method, &path, status) {
            assert!(said.contains(&format!("`{code}`")), "{method} {path} {status}: {said:?}");
        }
        problem
    }
}

/// The OpenAPI document.
pub(crate) static DOCUMENT: LazyLock<Value> =
    LazyLock::new(|| serde_json::from_str(&swarmbench::http::openapi::document()).expect("JSON"));

/// The description of a status of a route in the OpenAPI document, if it has the route.
fn announced(method: &Method, path: &str, status: u16) -> Option<String> {
    let fits = |route: &str| {
        let same = |(part, sent): (&str, &str)| part.starts_with('{') || part == sent;
        let count = |text: &str| text.split('/').count();
        count(route) == count(path) && route.split('/').zip(path.split('/')).all(same)
    };
    let paths = DOCUMENT["paths"].as_object().expect("paths");
    let (_, item) = paths.iter().find(|(route, _)| fits(route))?;
    let operation = item.get(method.as_str().to_lowercase())?;
    let said = operation["responses"][status.to_string()]["description"].as_str();
    Some(said.unwrap_or("nothing").to_owned())
}

/// Checks that a problem has all members that every problem has.
pub(crate) fn check_problem(problem: &Value, status: u16, code: &str) {
    assert_eq!(problem["code"], code, "{problem}");
    assert_eq!(problem["status"], status, "{problem}");
    assert_eq!(problem["type"], format!("urn:swarmbench:problem:{code}"), "{problem}");
    for member in ["title", "detail"] {
        assert!(problem[member].as_str().is_some_and(|text| !text.is_empty()), "{problem}");
    }
}

/// The fields that a problem names.
pub(crate) fn fields(problem: &Value) -> Vec<String> {
    let name = |field: &Value| field["field"].as_str().expect("a name").to_owned();
    list(&problem["fields"]).iter().map(name).collect()
}

pub(crate) struct HttpAnswer {
    pub(crate) status: u16,
    headers: reqwest::header::HeaderMap,
    pub(crate) body: Vec<u8>,
}

impl HttpAnswer {
    async fn of(response: reqwest::Response) -> Self {
        let (status, headers) = (response.status().as_u16(), response.headers().clone());
        let body = response.bytes().await.expect("a whole body").to_vec();
        Self { status, headers, body }
    }

    /// An answer whose body does not end.
    pub(crate) fn without_body(response: &reqwest::Response) -> Self {
        let (status, headers) = (response.status().as_u16(), response.headers().clone());
        Self { status, headers, body: Vec::new() }
    }

    pub(crate) fn header(&self, name: &str) -> &str {
        self.headers.get(name).map_or("", |value| value.to_str().expect("ASCII"))
    }

    pub(crate) fn text(&self) -> String {
        String::from_utf8(self.body.clone()).expect("UTF-8")
    }

    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body)
            .unwrap_or_else(|error| panic!("{error}: {}", self.text()))
    }
}

/// The items of a list.
pub(crate) fn list(value: &Value) -> Vec<Value> {
    value.as_array().unwrap_or_else(|| panic!("not a list: {value}")).clone()
}

/// A number of a kind that JSON has only one of.
pub(crate) fn number(value: &Value) -> u64 {
    value.as_u64().unwrap_or_else(|| panic!("not a whole number: {value}"))
}

/// One field of all items.
pub(crate) fn texts(items: &[Value], field: &str) -> Vec<String> {
    items.iter().map(|item| item[field].as_str().unwrap_or("-").to_owned()).collect()
}

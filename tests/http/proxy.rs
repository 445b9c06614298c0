//! The client behind a proxy whose server dies: what may be repeated is, and no page of the proxy reaches an error.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::State;
use axum::http::{HeaderMap, Method, Response, StatusCode, Uri};
use serde_json::json;
use swarmbench_client::client::{Client, ClientError};
use swarmbench_protocol::act::{ActRequest, SwarmAct};
use swarmbench_testkit::needs;
use tokio::net::TcpListener;
use tokio_util::task::AbortOnDropHandle;

use crate::app::{TestApp, game};
use crate::cup::{Cup, server};

const PAGE: &str =
    "<html><body><h1>Bad Gateway</h1>\nThe server returned an invalid answer.\n</body></html>\n";

/// Fate of a request.
#[derive(Clone, Copy, Debug)]
enum Fault {
    /// The server does it, and its answer is lost.
    AfterIt(u16),
    /// The server never sees it.
    BeforeIt(u16),
}

/// A proxy that answers with a page of its own as often as it is told.
struct Proxy {
    faults: Arc<Mutex<VecDeque<Fault>>>,
    client: Client,
    _serving: AbortOnDropHandle<()>,
}

#[derive(Clone)]
struct Behind {
    server: String,
    http: reqwest::Client,
    faults: Arc<Mutex<VecDeque<Fault>>>,
}

impl Proxy {
    async fn before(app: &TestApp) -> Self {
        let faults = Arc::default();
        let behind = Behind {
            server: app.base().to_owned(),
            http: reqwest::Client::new(),
            faults: Arc::clone(&faults),
        };
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let address = listener.local_addr().expect("an address");
        let router = Router::new().fallback(pass).with_state(behind);
        let serving =
            tokio::spawn(async move { axum::serve(listener, router).await.expect("a proxy") });
        Self {
            faults,
            client: Client::new(&format!("http://{address}")).expect("a client"),
            _serving: AbortOnDropHandle::new(serving),
        }
    }

    fn fail(&self, fault: Fault) {
        self.faults.lock().expect("the faults").push_back(fault);
    }

    fn faults_left(&self) -> usize {
        self.faults.lock().expect("the faults").len()
    }
}

async fn pass(
    State(behind): State<Behind>,
    method: Method,
    uri: Uri,
    headers: HeaderMap,
    body: Bytes,
) -> Response<Body> {
    let fault = behind.faults.lock().expect("the faults").pop_front();
    if let Some(Fault::BeforeIt(status)) = fault {
        return page(status);
    }
    let call = behind.http.request(method, format!("{}{uri}", behind.server));
    let answer = call.headers(headers).body(body).send().await.expect("an answer");
    let status = answer.status();
    let body = answer.bytes().await.expect("a body");
    match fault {
        Some(Fault::AfterIt(status)) => page(status),
        _ => Response::builder().status(status).body(body.into()).expect("a response"),
    }
}

fn page(status: u16) -> Response<Body> {
    let page = Response::builder().status(status).header("retry-after", "0");
    page.header("content-type", "text/html").body(PAGE.into()).expect("a response")
}

const FAULTS: [Fault; 4] =
    [Fault::AfterIt(502), Fault::AfterIt(504), Fault::BeforeIt(502), Fault::BeforeIt(503)];

#[tokio::test]
async fn acts_are_sent_again_and_stored_once() {
    let app = TestApp::start().await;
    let episode = app.create(game(2, 10)).await;
    let proxy = Proxy::before(&app).await;
    let stay =
        |round| ActRequest { round, action: Some("STAY".to_owned()), ..ActRequest::default() };
    for (round, fault) in (0..).zip(FAULTS) {
        proxy.fail(fault);
        let receipt = proxy.client.act(episode.seat(0), &stay(round)).await.expect("a receipt");
        assert_eq!(receipt.round, round);
        assert_eq!(receipt.duplicate, matches!(fault, Fault::AfterIt(_)), "{fault:?}");

        proxy.fail(fault);
        let act = SwarmAct::of(episode.id.clone(), "Agent_1".to_owned(), stay(round));
        let answer = proxy.client.swarm_act(&episode.swarm, vec![act]).await.expect("receipts");
        assert_eq!(json!(answer)["receipts"][0]["round"], round, "{answer:?}");

        proxy.fail(fault);
        let seen = proxy.client.obs(episode.seat(0), None, Duration::ZERO, false).await;
        let seen: serde_json::Value = serde_json::from_slice(&seen.expect("a look")).expect("JSON");
        assert_eq!(seen["round"], round + 1);
    }
    assert_eq!(proxy.faults_left(), 0);
    let journal = app.get(&episode.path("/journal")).token(&episode.swarm);
    let journal = journal.send().await.text();
    assert_eq!(journal.matches("\"action\":\"STAY\"").count(), 2 * FAULTS.len());
}

#[tokio::test]
async fn a_creation_is_sent_again_and_done_once() {
    let app = TestApp::start().await;
    let proxy = Proxy::before(&app).await;
    for fault in FAULTS {
        proxy.fail(fault);
        let request = serde_json::from_value(game(1, 5)).expect("a request");
        proxy.client.create_episode(&request).await.expect("an episode");
    }
    let list = app.get("/api/v1/episodes").ok().await;
    assert_eq!(list["items"].as_array().map(Vec::len), Some(FAULTS.len()));
}

#[needs(own_server)]
#[tokio::test]
async fn an_error_says_that_a_proxy_answered_and_shows_no_markup() {
    let app = TestApp::builder().keys().start().await;
    let proxy = Proxy::before(&app).await;
    let client = proxy.client.clone().with_key(app.organizer.clone());
    let request = serde_json::from_value(json!({ "name": "red" })).expect("a request");
    for fault in [Fault::AfterIt(502), Fault::BeforeIt(599), Fault::BeforeIt(404)] {
        proxy.fail(fault);
        // A second creation would make a second key.
        let error = client.create_key(&request).await.expect_err("no key");
        let (Fault::AfterIt(status) | Fault::BeforeIt(status)) = fault;
        let text = error.to_string();
        assert!(text.contains("Bad Gateway The server returned an invalid answer."), "{text}");
        assert!(!text.contains('<'), "{text}");
        let is_proxy = matches!(&error, ClientError::Proxy { .. });
        assert_eq!(is_proxy, status != StatusCode::NOT_FOUND.as_u16(), "{error:?}");
        assert_eq!(is_proxy, text.contains(&format!(": {status} of a proxy: ")), "{text}");
        assert_eq!(is_proxy, error.is_temporary());
    }
    let red = |list: &serde_json::Value| list.to_string().matches("\"name\":\"red\"").count();
    assert_eq!(red(&app.get("/api/v1/keys").token(&app.organizer).ok().await), 1);
}

/// A second change would be refused because of the first one, as if somebody else had made that.
#[tokio::test]
async fn a_change_is_sent_once() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let proxy = Proxy::before(&app).await;
    let client = proxy.client.clone().with_key(app.organizer.clone());
    let path = cup.path("");
    for (fault, done) in [(Fault::BeforeIt(502), false), (Fault::AfterIt(502), true)] {
        proxy.fail(fault);
        let shown: serde_json::Value = client.get(&path).await.expect("after a retry");
        let change = json!({ "description": "corrected", "if_revision": shown["revision"] });
        proxy.fail(fault);
        let answer = client.patch::<serde_json::Value>(&path, &change).await;
        let error = answer.expect_err("it is not known whether it was done");
        assert!(matches!(error, ClientError::Proxy { .. }), "{error:?}");
        let shown: serde_json::Value = client.get(&path).await.expect("the competition");
        assert_eq!(shown["description"] == "corrected", done, "{fault:?}");
    }
}

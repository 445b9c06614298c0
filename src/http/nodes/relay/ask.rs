//! The side that asks.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard};

use axum::body::Body;
use axum::http::{HeaderName, HeaderValue, StatusCode};
use axum::response::Response;
use futures::StreamExt as _;
use hyper_util::client::legacy::Client as HttpClient;
use hyper_util::client::legacy::connect::HttpConnector;
use tokio::sync::oneshot;

use super::super::links::Question;
use super::{Ask, Pushed, Queue, Reply, header, headers_of, headers_to, messages};

/// A connection to another server. It is open until either of them ends it.
pub(in super::super) struct Relay {
    asks: Arc<Queue>,
    waiting: Mutex<Waiting>,
}

/// Who waits for an answer.
#[derive(Default)]
struct Waiting {
    last_id: u64,
    /// What is sent to each is the answer, or `None` where the request is to be sent by itself.
    replies: HashMap<u64, oneshot::Sender<Option<Response>>>,
    /// The other server takes no further requests.
    is_closing: bool,
}

impl Relay {
    /// Opens a connection with this request, whose body is replaced; `gone` completes when it is to be closed.
    pub(in super::super) fn open(
        http: HttpClient<HttpConnector, Body>,
        request: hyper::Request<()>,
        gone: impl Future<Output = ()> + Send + 'static,
    ) -> Arc<Self> {
        let relay = Arc::new(Self { asks: Arc::default(), waiting: Mutex::default() });
        let request = request.map(|()| relay.asks.body());
        let opened = Arc::clone(&relay);
        tokio::spawn(async move {
            tokio::select! {
                () = opened.receive(http, request) => {}
                () = gone => {}
            }
            opened.close();
        });
        relay
    }

    pub(in super::super) fn is_open(&self) -> bool {
        !self.waiting().is_closing
    }

    /// Sends a request with these headers beside its own; `None` where it is to be sent by itself: as there is no room for it or for
    /// its answer, or the connection has ended before the answer.
    pub(in super::super) async fn ask(
        &self,
        question: &Question,
        more: &[(HeaderName, HeaderValue)],
    ) -> Option<Response> {
        let (reply, replied) = oneshot::channel();
        let id = {
            let mut waiting = self.waiting();
            if waiting.is_closing {
                return None;
            }
            waiting.last_id += 1;
            let id = waiting.last_id;
            waiting.replies.insert(id, reply);
            id
        };
        let _cancelled = CancelledOnDrop { relay: self, id };
        let mut headers = headers_to(&question.headers);
        headers.extend(more.iter().map(|(name, value)| header(name, value)));
        let ask = Ask::Request {
            id,
            method: question.method.as_str(),
            path: question.path.as_str(),
            headers,
            body: serde_bytes::Bytes::new(&question.body),
        };
        if self.asks.push(&ask) != Pushed::Queued {
            return None;
        }
        replied.await.ok()?
    }

    fn waiting(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().expect("nothing panics while it holds this")
    }

    async fn receive(&self, http: HttpClient<HttpConnector, Body>, request: hyper::Request<Body>) {
        let answered = match http.request(request).await {
            Ok(answered) => answered,
            Err(error) => return tracing::debug!(%error, "a server did not answer another one"),
        };
        if answered.status() != StatusCode::OK {
            return;
        }
        let mut replies = messages(Body::new(answered.into_body()));
        while let Some(Ok(message)) = replies.next().await {
            let (id, response) = match postcard::from_bytes(&message) {
                Ok(Reply::Answered { id, status, headers, body }) => {
                    let response = || {
                        let mut response = Response::new(Body::from(message.slice_ref(body)));
                        *response.status_mut() = StatusCode::from_u16(status).ok()?;
                        *response.headers_mut() = headers_of(&message, &headers)?;
                        Some(response)
                    };
                    (id, response())
                }
                Ok(Reply::ByHttp { id }) => (id, None),
                Ok(Reply::Closing) => {
                    self.waiting().is_closing = true;
                    self.asks.close();
                    continue;
                }
                Err(_) => return,
            };
            let reply = self.waiting().replies.remove(&id);
            if let Some(reply) = reply {
                // Where nobody waits any more, the answer came as that was noticed.
                drop(reply.send(response));
            }
        }
    }

    /// Nobody waits any longer, and nobody asks any more.
    pub(in super::super) fn close(&self) {
        self.asks.close();
        let mut waiting = self.waiting();
        waiting.is_closing = true;
        waiting.replies.clear();
    }
}

/// Says that nobody waits for an answer any more, where it has not come.
struct CancelledOnDrop<'a> {
    relay: &'a Relay,
    id: u64,
}

impl Drop for CancelledOnDrop<'_> {
    fn drop(&mut self) {
        let waited = self.relay.waiting().replies.remove(&self.id);
        if waited.is_some() {
            self.relay.asks.push(&Ask::Cancelled { id: self.id });
        }
    }
}

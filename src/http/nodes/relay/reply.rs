//! The side that answers.

use std::pin::pin;
use std::sync::Arc;

use axum::body::{Body, HttpBody as _, to_bytes};
use axum::extract::Request;
use axum::http::Method;
use axum::response::Response;
use futures::StreamExt as _;
use tokio_util::sync::CancellationToken;
use tokio_util::task::JoinMap;

use super::super::super::body::LIGHT_BODY_BYTES_MAX;
use super::super::super::client::Peer;
use super::super::super::front::{Answered, Front};
use super::{
    ANSWERING_MAX, Ask, MESSAGE_BYTES_MAX, Queue, Reply, headers_of, headers_to, messages,
};

/// Answers the requests in the body of another server's, until that ends it or is gone.
pub(in super::super::super) fn answer(
    front: Front,
    peer: Peer,
    request: Request,
    stop: CancellationToken,
    gone: impl Future<Output = ()> + Send + 'static,
) -> Response {
    let replies = Arc::new(Queue::default());
    let response = Response::new(replies.body());
    tokio::spawn(async move {
        tokio::select! {
            () = answer_all(front, peer, request.into_body(), &replies, stop) => {}
            // Nobody reads the answers.
            () = replies.closed.cancelled() => {}
            () = gone => {}
        }
        replies.close();
    });
    response
}

/// Where the other server has ended the connection, and not only its requests, what is being answered is dropped.
async fn answer_all(
    front: Front,
    peer: Peer,
    asks: Body,
    replies: &Arc<Queue>,
    stop: CancellationToken,
) {
    let (mut asks, mut answering) = (messages(asks), JoinMap::new());
    let (mut stopped, mut is_closing) = (pin!(stop.cancelled()), false);
    loop {
        let message = tokio::select! {
            message = asks.next() => message,
            Some(_) = answering.join_next() => continue,
            () = stopped.as_mut(), if !is_closing => {
                is_closing = true;
                replies.send(&Reply::Closing).await;
                continue;
            }
        };
        let message = match message {
            Some(Ok(message)) => message,
            Some(Err(_)) => return,
            None => break,
        };
        match postcard::from_bytes(&message) {
            Ok(Ask::Request { id, .. }) if answering.len() >= ANSWERING_MAX => {
                replies.send(&Reply::ByHttp { id }).await;
            }
            Ok(Ask::Request { id, method, path, headers, body }) => {
                let request = || {
                    let mut request = Request::new(Body::from(message.slice_ref(body)));
                    *request.method_mut() = Method::from_bytes(method.as_bytes()).ok()?;
                    *request.uri_mut() = path.parse().ok()?;
                    *request.headers_mut() = headers_of(&message, &headers)?;
                    Some(request)
                };
                let Some(request) = request() else { return };
                let (front, replies) = (front.clone(), Arc::clone(replies));
                answering.spawn(id, Box::pin(answer_one(front, peer, id, request, replies)));
            }
            Ok(Ask::Cancelled { id }) => {
                answering.abort(&id);
            }
            Err(_) => return,
        }
    }
    while answering.join_next().await.is_some() {}
}

async fn answer_one(front: Front, peer: Peer, id: u64, request: Request, replies: Arc<Queue>) {
    // What only reads can be sent again where its answer is long: others need not wait behind it.
    let most = if request.method() == Method::GET {
        LIGHT_BODY_BYTES_MAX
    } else {
        MESSAGE_BYTES_MAX - LIGHT_BODY_BYTES_MAX
    };
    let Answered { response, context: _context } = front.answer(request, peer).await;
    let (parts, body) = response.into_parts();
    let is_short = body.size_hint().lower() <= most as u64;
    let bytes = if is_short { to_bytes(body, most).await.ok() } else { None };
    let reply = match &bytes {
        Some(body) => Reply::Answered {
            id,
            status: parts.status.as_u16(),
            headers: headers_to(&parts.headers),
            body: serde_bytes::Bytes::new(body),
        },
        None => Reply::ByHttp { id },
    };
    replies.send(&reply).await;
}

//! Requests that wait, and event streams: nothing is sent any more once the token with which they came was revoked.

use axum::body::Body;
use axum::extract::Request;
use axum::http::{HeaderValue, header};
use axum::response::Response;
use futures::StreamExt as _;

use super::App;
use super::auth::{bearer, unknown_token};
use super::error::ApiError;
use super::feed::is_event_stream;
use crate::store::tokens::Grant;

/// The token of a request, to be looked at again when the answer is there.
pub(super) struct SentToken {
    value: HeaderValue,
    /// Number of revocations when the request arrived.
    revocations: u64,
}

impl SentToken {
    pub(super) fn of(app: &App, request: &Request) -> Option<Self> {
        let value = request.headers().get(header::AUTHORIZATION)?.clone();
        Some(Self { value, revocations: app.tokens.revocations() })
    }

    /// The answer to the request, or the refusal of a token that was revoked meanwhile. A stream of events ends when the token is
    /// revoked later.
    pub(super) async fn check(self, app: &App, response: Response) -> Result<Response, ApiError> {
        if is_event_stream(&response) {
            Box::pin(self.until_revoked(app, response)).await
        } else if self.revocations == app.tokens.revocations() || Box::pin(self.is_good(app)).await
        {
            Ok(response)
        } else {
            Err(unknown_token())
        }
    }

    async fn until_revoked(self, app: &App, response: Response) -> Result<Response, ApiError> {
        let mut followed = app.tokens.follow_revocations();
        let now = *followed.borrow_and_update();
        if self.revocations != now && !self.is_good(app).await {
            return Err(unknown_token());
        }
        let app = app.clone();
        let revoked = async move {
            while followed.changed().await.is_ok() {
                if !self.is_good(&app).await {
                    return;
                }
            }
        };
        Ok(response
            .map(|body| Body::from_stream(body.into_data_stream().take_until(Box::pin(revoked)))))
    }

    /// A token that the store cannot check counts as good.
    async fn is_good(&self, app: &App) -> bool {
        let Some(token) = self.value.to_str().ok().and_then(|value| bearer(value).ok()) else {
            return false;
        };
        match app.tokens.grant(token).await {
            Ok(Some(Grant::Key(key))) => key.is_good(app.clock.wall()),
            Ok(grant) => grant.is_some(),
            Err(_) => true,
        }
    }
}

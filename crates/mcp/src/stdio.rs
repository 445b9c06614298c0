//! A client that started this program and talks to it over standard input and output.

use std::sync::Arc;

use rmcp::service::{ServerInitializeError, ServiceExt};
use tokio_util::sync::CancellationToken;

use crate::SeatAccess;
use crate::player::Player;

/// The reason why the conversation with a client broke off.
#[derive(Debug, thiserror::Error)]
pub enum StdioError {
    /// The input does not begin a conversation.
    #[error(
        "the standard input is no client of the Model Context Protocol: {0}; an assistant starts this command itself"
    )]
    Start(String),
    /// The conversation broke off.
    #[error("the conversation broke off: {0}")]
    BrokeOff(String),
}

/// Serves one client over standard input and output until it closes them.
///
/// # Errors
///
/// [`StdioError`] if the input is not of the protocol, or the conversation breaks off.
pub async fn serve(seat: Arc<dyn SeatAccess>) -> Result<(), StdioError> {
    let player = Player::new(seat, CancellationToken::new());
    let streams = (tokio::io::stdin(), tokio::io::stdout());
    let service = match player.serve(streams).await {
        Ok(service) => service,
        // The client closed the streams without a request.
        Err(ServerInitializeError::ConnectionClosed(_)) => return Ok(()),
        Err(error) => return Err(StdioError::Start(error.to_string())),
    };
    match service.waiting().await {
        Ok(_) => Ok(()),
        Err(error) => Err(StdioError::BrokeOff(error.to_string())),
    }
}

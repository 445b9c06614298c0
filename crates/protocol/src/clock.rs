//! Clock of the server.

use serde::{Deserialize, Serialize};

use crate::time::Timestamp;

/// Time of day of the server after a confirmation.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ConfirmedClock {
    /// Time of day that the server uses from now on: that of the host.
    pub now: Timestamp,
    /// Milliseconds by which the server's time of day was moved; negative if it was set back.
    pub moved_ms: i64,
    /// Reason for which the time of day was in doubt; null if it was not.
    pub doubt: Option<String>,
}

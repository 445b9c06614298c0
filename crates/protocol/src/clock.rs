//! The server's clock.

use serde::{Deserialize, Serialize};

use crate::time::Timestamp;

/// The time of day that the server goes by.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ConfirmedClock {
    /// The time of day from now on: that of the host.
    pub now: Timestamp,
    /// By how many milliseconds the server's time of day was set; negative where it was set back.
    pub moved_ms: i64,
    /// Why the time of day was in doubt; null where it was not.
    pub doubt: Option<String>,
}

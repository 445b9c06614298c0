//! Unanswered requests by address.

use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use super::client::ByNetwork;
use super::error::{ApiError, Code};
use crate::fair::Origin;

/// Counts of unanswered requests by client address, which a proxy on its own connections names for each request.
#[derive(Debug)]
pub(super) struct InFlight {
    requests: Mutex<ByNetwork>,
    most: usize,
}

/// Data attached to a request until its response is sent.
#[derive(Clone, Debug)]
pub(super) struct RequestContext {
    /// Party and rank for which the request is answered.
    pub(super) origin: Origin,
    /// None if this client's requests are not limited.
    pub(super) _in_flight: Option<Arc<InFlightPermit>>,
}

/// Keeps a request counted until dropped.
#[derive(Debug)]
pub(super) struct InFlightPermit {
    all: Arc<InFlight>,
    address: IpAddr,
}

impl InFlight {
    /// Allows at most `most` requests of each address.
    pub(super) fn new(most: usize) -> Self {
        Self { requests: Mutex::default(), most }
    }

    fn requests(&self) -> MutexGuard<'_, ByNetwork> {
        self.requests.lock().expect("nothing panics while it holds this")
    }

    /// Counts a request of an address. Requests from this machine are not limited.
    pub(super) fn take(
        self: &Arc<Self>,
        address: IpAddr,
    ) -> Result<Option<Arc<InFlightPermit>>, ApiError> {
        if address.is_loopback() {
            return Ok(None);
        }
        let (mut requests, most) = (self.requests(), self.most);
        if !requests.has_room(address, most) {
            let name = "connections_per_address_max";
            let detail = format!("{most} requests of this address wait for their answers already");
            return Err(ApiError::limit(Code::Overloaded, name, most, detail)
                .retry_after(Duration::from_secs(1)));
        }
        requests.add(address);
        drop(requests);
        Ok(Some(Arc::new(InFlightPermit { all: Arc::clone(self), address })))
    }
}

impl Drop for InFlightPermit {
    fn drop(&mut self) {
        self.all.requests().remove(self.address);
    }
}

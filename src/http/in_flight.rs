//! Requests that are not answered yet, by address.

use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use super::client::ByNetwork;
use super::error::{ApiError, Code};
use crate::fair::Origin;

/// How many requests are not answered yet, by address. A proxy forwards those of many on its own connections: here it
/// shows whose they are.
#[derive(Debug)]
pub(super) struct InFlight {
    requests: Mutex<ByNetwork>,
    most: usize,
}

/// What accompanies a request until its answer is sent.
#[derive(Clone, Debug)]
pub(super) struct RequestContext {
    /// The party and the rank for which the answer is made.
    pub(super) origin: Origin,
    /// None if requests of this client are not limited.
    pub(super) _in_flight: Option<Arc<InFlightPermit>>,
}

/// A request that is counted until this is dropped.
#[derive(Debug)]
pub(super) struct InFlightPermit {
    all: Arc<InFlight>,
    address: IpAddr,
}

impl InFlight {
    /// At most `most` requests of each address.
    pub(super) fn new(most: usize) -> Self {
        Self { requests: Mutex::default(), most }
    }

    fn requests(&self) -> MutexGuard<'_, ByNetwork> {
        self.requests.lock().expect("nothing panics while it holds this")
    }

    /// Counts a request of an address. Those of this machine itself are not limited.
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

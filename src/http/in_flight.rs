//! Requests that are not answered yet, by address.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use super::client::network;
use super::error::{ApiError, Code};
use crate::fair::Origin;

/// How many requests are not answered yet, by address. A proxy forwards those of many on its own connections: here it
/// shows whose they are.
#[derive(Debug)]
pub(super) struct InFlight {
    requests: Mutex<HashMap<IpAddr, usize>>,
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
    network: IpAddr,
}

impl InFlight {
    /// At most `most` requests of each address.
    pub(super) fn new(most: usize) -> Self {
        Self { requests: Mutex::default(), most }
    }

    fn requests(&self) -> MutexGuard<'_, HashMap<IpAddr, usize>> {
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
        let (network, most) = (network(address), self.most);
        let mut requests = self.requests();
        let here = requests.entry(network).or_default();
        if *here >= most {
            let name = "requests_per_address_max";
            let detail = format!("{most} requests of this address wait for their answers already");
            return Err(ApiError::limit(Code::Overloaded, name, most, detail)
                .retry_after(Duration::from_secs(1)));
        }
        *here += 1;
        drop(requests);
        Ok(Some(Arc::new(InFlightPermit { all: Arc::clone(self), network })))
    }
}

impl Drop for InFlightPermit {
    fn drop(&mut self) {
        let mut requests = self.all.requests();
        if let Entry::Occupied(mut here) = requests.entry(self.network) {
            *here.get_mut() -= 1;
            if *here.get() == 0 {
                here.remove();
            }
        }
    }
}

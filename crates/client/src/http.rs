//! HTTP clients, of servers and of endpoints of language models.

use reqwest::ClientBuilder;
use swarmbench_protocol::loopback::is_loopback;

/// Builder of an HTTP client for this host. Its TLS is that of ring, which takes a quarter of the time to compile that the default
/// of reqwest takes.
pub(crate) fn builder(host: Option<&str>) -> ClientBuilder {
    // An error means that the process has chosen a provider already.
    drop(rustls::crypto::ring::default_provider().install_default());
    let http = reqwest::Client::builder();
    if host.is_some_and(is_loopback) {
        // A proxy of the network would look for the host on its own machine.
        return http.no_proxy();
    }
    http
}

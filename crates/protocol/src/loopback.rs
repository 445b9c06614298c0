//! Addresses of the machine itself, in one place as the server and its clients have to agree.

use std::net::IpAddr;

/// Whether an address names this machine: `localhost`, or a loopback address, that of IPv6 with brackets or without.
#[must_use]
pub fn is_loopback(name: &str) -> bool {
    let bare = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
    name.eq_ignore_ascii_case("localhost")
        || bare.parse::<IpAddr>().is_ok_and(|address| address.to_canonical().is_loopback())
}

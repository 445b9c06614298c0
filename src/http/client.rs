//! The client of a connection: its address, and whether it is a program on this machine, which decides what it may do on a server
//! without keys.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::net::IpAddr;
use std::ops::Range;

use axum::extract::Request;
use axum::http::{HeaderMap, HeaderName, Uri, header};
use ipnet::IpNet;

use super::error::{ApiError, Code};
use crate::fair::{Group, Party};
use swarmbench_protocol::loopback::is_loopback;

/// Address of the connection's other end, in the extensions of every request. Behind a proxy it is the proxy's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Peer(pub(super) IpAddr);

/// The sender of a request, as far as connection and headers tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Client {
    /// Address of the client, as named by a trusted proxy if there is one.
    pub(super) address: IpAddr,
    /// A local client is a program on this machine: neither a forwarding proxy nor a page of another site in a browser.
    pub(super) is_local: bool,
}

/// Headers that proxies add.
const FORWARDED: [HeaderName; 5] = [
    HeaderName::from_static("forwarded"),
    HeaderName::from_static("x-forwarded-for"),
    HeaderName::from_static("x-forwarded-host"),
    HeaderName::from_static("x-real-ip"),
    HeaderName::from_static("via"),
];

impl Client {
    pub(super) fn of(peer: IpAddr, headers: &HeaderMap, uri: &Uri, trusted: &[IpNet]) -> Self {
        let address = address(peer, headers, trusted);
        let is_forwarded = headers.keys().any(|name| FORWARDED.contains(name));
        let is_local = address.is_loopback()
            && !is_forwarded
            && names_loopback(host(headers, uri))
            && headers.get(header::ORIGIN).is_none_or(|origin| {
                names_loopback(origin.to_str().ok().and_then(|origin| origin.split("://").nth(1)))
            });
        Self { address, is_local }
    }

    /// Party of a request without a key or a token.
    pub(super) fn party(self) -> Party {
        Party::of(Group::Address(site(self.address)))
    }
}

/// Address of the client, as named by a trusted proxy if there is one.
pub(super) fn address(peer: IpAddr, headers: &HeaderMap, trusted: &[IpNet]) -> IpAddr {
    let peer = peer.to_canonical();
    let is_trusted = |address: &IpAddr| trusted.iter().any(|net| net.contains(address));
    let address = if is_trusted(&peer) { forwarded(headers, is_trusted) } else { None };
    address.unwrap_or(peer)
}

/// The last address in `X-Forwarded-For` that is not a trusted proxy's: all entries before it may be forged.
fn forwarded(headers: &HeaderMap, is_trusted: impl Fn(&IpAddr) -> bool) -> Option<IpAddr> {
    let lines = headers.get_all("x-forwarded-for").iter().rev();
    let entries = lines.flat_map(|line| line.to_str().unwrap_or("?").rsplit(','));
    let mut nearest = None;
    for entry in entries {
        let Ok(address) = entry.trim().parse::<IpAddr>() else { break };
        let address = address.to_canonical();
        nearest = Some(address);
        if !is_trusted(&address) {
            break;
        }
    }
    nearest
}

/// Host and port that the request names.
pub(super) fn host<'a>(headers: &'a HeaderMap, uri: &'a Uri) -> Option<&'a str> {
    match uri.authority() {
        Some(authority) => Some(authority.as_str()),
        None => headers.get(header::HOST).and_then(|host| host.to_str().ok()),
    }
}

fn names_loopback(host: Option<&str>) -> bool {
    host.and_then(name_of).is_some_and(is_loopback)
}

/// Name in `host` or `host:port`; `None` if the port is invalid.
pub(super) fn name_of(host: &str) -> Option<&str> {
    let (name, port) = match host.rsplit_once(':') {
        Some((name, port)) if !host.ends_with(']') => (name, Some(port)),
        _ => (host, None),
    };
    port.is_none_or(|port| port.parse::<u16>().is_ok()).then_some(name)
}

/// Factor of the limits of a /48 of IPv6, relative to those of a single address or /64.
pub(super) const NETWORKS_PER_SITE_MAX: u32 = 8;

/// Refuses cross-site requests that change something. Many routes need no permission but the client's address, and a page of any
/// site can make a browser send a `POST` without a body. Requests with an `Authorization` header pass: the sender knows a token, as
/// a browser adds none and lets no page of another site add one here.
pub(super) fn check_site(request: &Request, hosts: &[String]) -> Result<(), ApiError> {
    let headers = request.headers();
    if request.method().is_safe() || headers.contains_key(header::AUTHORIZATION) {
        return Ok(());
    }
    let text = |name: &str| headers.get(name).map(|value| value.to_str().unwrap_or_default());
    let site = text("sec-fetch-site");
    let foreign = match (text("origin"), site) {
        // A proxy may change `Host`, but no page can change `Sec-Fetch-Site`.
        (Some(_), Some("same-origin")) => None,
        (Some(origin), _) => (!is_own(origin, request, hosts)).then_some(origin),
        (None, site) => site.filter(|site| *site == "cross-site"),
    };
    let Some(foreign) = foreign else { return Ok(()) };
    let shown: String = foreign.chars().take(100).collect();
    let detail = format!(
        "a page of another site ({shown:?}) changes nothing here without a token; if it is this server under a name that the \
         header `Host` does not have, name it with `swarmbench serve --host`"
    );
    Err(ApiError::new(Code::Forbidden, detail))
}

/// An `Origin` of this server is the host that the request names, this machine, or one of the server's names.
pub(super) fn is_own(origin: &str, request: &Request, hosts: &[String]) -> bool {
    let Some(name) = origin.split_once("://").and_then(|(_, host)| name_of(host)) else {
        return false;
    };
    let asked = host(request.headers(), request.uri()).and_then(name_of);
    is_loopback(name)
        || asked.is_some_and(|asked| asked.eq_ignore_ascii_case(name))
        || hosts.iter().any(|host| host.eq_ignore_ascii_case(name))
}

/// Network that counts as one address: a host can choose from a whole /64 of IPv6.
pub(super) fn network(address: IpAddr) -> IpAddr {
    prefix(address, 32, 64).network()
}

/// Network that has one fair share: a site has a whole /48 of IPv6.
pub(super) fn site(address: IpAddr) -> IpAddr {
    prefix(address, 32, 48).network()
}

/// Texts of the [networks](network) that count as one when competitions are entered, a /24 of IPv4 or a /48 of IPv6: a range,
/// and the first network, whose zeros IPv6 may shorten to a text before it.
pub(super) fn neighbours(address: IpAddr) -> (Range<String>, String) {
    let first = prefix(address, 24, 48).network();
    let (head, dot, next) = match first {
        IpAddr::V4(first) => {
            let [a, b, c, _] = first.octets();
            (format!("{a}.{b}.{c}"), '.', '/')
        }
        IpAddr::V6(first) => {
            let [a, b, c, ..] = first.segments();
            (format!("{a:x}:{b:x}:{c:x}"), ':', ';')
        }
    };
    (format!("{head}{dot}")..format!("{head}{next}"), first.to_string())
}

fn prefix(address: IpAddr, v4: u8, v6: u8) -> IpNet {
    let length = if address.is_ipv4() { v4 } else { v6 };
    // Loopback addresses are never merged into a network.
    if address.is_loopback() { address.into() } else { IpNet::new_assert(address, length).trunc() }
}

/// Networks in which an address counts, each with the factor of its limit. The smallest comes first, so that a refusal there uses
/// up nothing of its neighbours.
pub(super) fn networks(address: IpAddr) -> impl Iterator<Item = (IpNet, u32)> + Clone {
    let has_site = address.is_ipv6() && !address.is_loopback();
    let site = has_site.then(|| (prefix(address, 32, 48), NETWORKS_PER_SITE_MAX));
    std::iter::once((prefix(address, 32, 64), 1)).chain(site)
}

/// Counts by network.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct ByNetwork(HashMap<IpNet, usize>);

impl ByNetwork {
    /// An address has room if it may have one more when its limit is `most`.
    pub(super) fn has_room(&self, address: IpAddr, most: usize) -> bool {
        networks(address).all(|(network, times)| {
            self.0.get(&network).is_none_or(|here| *here < most.saturating_mul(times as usize))
        })
    }

    /// All counts of a new address are zero.
    pub(super) fn is_new(&self, address: IpAddr) -> bool {
        networks(address).all(|(network, _)| !self.0.contains_key(&network))
    }

    pub(super) fn add(&mut self, address: IpAddr) {
        for (network, _) in networks(address) {
            *self.0.entry(network).or_default() += 1;
        }
    }

    pub(super) fn remove(&mut self, address: IpAddr) {
        for (network, _) in networks(address) {
            if let Entry::Occupied(mut here) = self.0.entry(network) {
                *here.get_mut() -= 1;
                if *here.get() == 0 {
                    here.remove();
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::net::Ipv6Addr;

    use super::*;

    fn client(peer: &str, headers: &[(&str, &str)]) -> Client {
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            let name: HeaderName = name.parse().expect("a name");
            map.append(name, value.parse().expect("a value"));
        }
        let trusted =
            ["127.0.0.1/32".parse().expect("a net"), "10.0.0.0/8".parse().expect("a net")];
        let peer = peer.parse().expect("an address");
        Client::of(peer, &map, &Uri::from_static("/obs"), &trusted)
    }

    #[test]
    fn texts_tell_neighbours() {
        let addresses = [
            "198.51.100.0",
            "198.51.100.255",
            "198.51.10.1",
            "198.51.101.1",
            "2001:db8:1::1",
            "2001:db8:1:2::1",
            "2001:db8:1:ffff:ffff::",
            "2001:db8:10::1",
            "2001:db8::1",
            "2001:db8:0:5::1",
            "2001:db8:0:a000::1",
            "2001::1",
            "2001:0:0:5::1",
            "2001:0:1::1",
            "::2",
            "0:0:0:5::1",
            "0:0:1::1",
        ];
        let addresses = addresses.map(|address| address.parse::<IpAddr>().expect("an address"));
        for address in addresses {
            let (texts, first) = neighbours(address);
            for other in addresses {
                let text = network(other).to_string();
                let is_near = prefix(address, 24, 48).contains(&other);
                assert_eq!(texts.contains(&text) || text == first, is_near, "{address} {other}");
            }
        }
    }

    #[test]
    fn only_trusted_proxies_say_whom_they_forward() {
        for (peer, forwarded, expected) in [
            ("203.0.113.9", "198.51.100.1", "203.0.113.9"),
            ("127.0.0.1", "198.51.100.1", "198.51.100.1"),
            ("127.0.0.1", "6.6.6.6, 198.51.100.1", "198.51.100.1"),
            ("127.0.0.1", "6.6.6.6, 198.51.100.1, 10.1.2.3", "198.51.100.1"),
            ("127.0.0.1", "10.1.2.3", "10.1.2.3"),
            ("127.0.0.1", "nonsense", "127.0.0.1"),
            ("127.0.0.1", "198.51.100.1, nonsense", "127.0.0.1"),
            ("::ffff:127.0.0.1", "2001:db8::1", "2001:db8::1"),
        ] {
            let seen = client(peer, &[("x-forwarded-for", forwarded), ("host", "localhost")]);
            assert_eq!(seen.address.to_string(), expected, "{peer} {forwarded}");
            assert!(!seen.is_local, "what is forwarded is not from here");
        }
        // Repeated headers form one list.
        let lines = [("x-forwarded-for", "6.6.6.6"), ("x-forwarded-for", "198.51.100.1")];
        assert_eq!(client("127.0.0.1", &lines).address.to_string(), "198.51.100.1");
    }

    #[test]
    fn a_program_on_this_machine_is_told_from_proxies_and_pages() {
        for (peer, headers, expected) in [
            ("127.0.0.1", &[("host", "127.0.0.1:8080")][..], true),
            ("127.0.0.1", &[("host", "LocalHost")], true),
            ("::1", &[("host", "[::1]:8080")], true),
            ("127.9.9.9", &[("host", "127.9.9.9")], true),
            ("127.0.0.1", &[], false),
            ("127.0.0.1", &[("host", "evil.example:8080")], false),
            ("127.0.0.1", &[("host", "localhost.evil.example")], false),
            ("127.0.0.1", &[("host", "localhost:evil")], false),
            ("127.0.0.1", &[("host", "127.0.0.1@evil.example")], false),
            ("192.0.2.1", &[("host", "localhost")], false),
            ("127.0.0.1", &[("host", "localhost"), ("x-real-ip", "192.0.2.1")], false),
            ("127.0.0.1", &[("host", "localhost"), ("via", "1.1 proxy")], false),
            ("127.0.0.1", &[("host", "localhost"), ("origin", "https://evil.example")], false),
            ("127.0.0.1", &[("host", "localhost"), ("origin", "null")], false),
            ("127.0.0.1", &[("host", "localhost"), ("origin", "http://localhost:3000")], true),
        ] {
            assert_eq!(client(peer, headers).is_local, expected, "{peer} {headers:?}");
        }
    }

    #[test]
    fn one_host_has_many_addresses_of_ipv6() {
        let network = |text: &str| network(text.parse().expect("an address"));
        assert_eq!(network("2001:db8::1"), network("2001:db8::ffff:1"));
        assert_ne!(network("2001:db8::1"), network("2001:db8:0:1::1"));
        assert_ne!(network("192.0.2.1"), network("192.0.2.2"));
        assert_eq!(network("::1"), Ipv6Addr::LOCALHOST);
    }

    #[test]
    fn a_site_has_a_few_times_what_one_of_its_networks_has() {
        let address =
            |site: u16, network: u16| IpAddr::from([0x2001, 0xdb8, site, network, 0, 0, 0, 1]);
        let mut counted = ByNetwork::default();
        let fill = |counted: &mut ByNetwork, address: IpAddr| {
            let mut taken = 0;
            while counted.has_room(address, 3) {
                counted.add(address);
                taken += 1;
            }
            taken
        };
        assert!(counted.is_new(address(1, 0)));
        // The first /64 has the same bits as its /48.
        let taken: Vec<i32> =
            (0..10).map(|number| fill(&mut counted, address(1, number))).collect();
        assert_eq!(taken, [3, 3, 3, 3, 3, 3, 3, 3, 0, 0]);
        assert!(!counted.is_new(address(1, 99)), "its site has some");
        assert_eq!(fill(&mut counted, address(2, 0)), 3);
        // IPv4 addresses share no site.
        let taken = (0..20).map(|last| fill(&mut counted, IpAddr::from([192, 0, 2, last])));
        assert_eq!(taken.sum::<i32>(), 60);
        for (number, count) in [(0, 3), (7, 1)] {
            (0..count).for_each(|_| counted.remove(address(1, number)));
        }
        assert_eq!(fill(&mut counted, address(1, 9)), 3);
        assert_eq!(fill(&mut counted, address(1, 8)), 1);
    }
}

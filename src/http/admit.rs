//! The check that comes first for every request: the host that it names.

use axum::extract::Request;
use axum::http::uri::Authority;
use axum::http::{HeaderValue, Version, header};

use super::error::{ApiError, Code};

/// Refuses requests that name no host, or more than one: a proxy in front might take another one for the right one. HTTP/1.0 does
/// not require the header.
pub(super) fn check_host(request: &Request) -> Result<(), ApiError> {
    let mut hosts = request.headers().get_all(header::HOST).iter();
    let problem = match (hosts.next(), hosts.next()) {
        (Some(_), Some(_)) => "the request has more than one `Host` header",
        (None, _) if request.version() >= Version::HTTP_11 => "the request has no `Host` header",
        (Some(host), None) if !is_host(host) => {
            "the `Host` header is not a name, or an address, and a port"
        }
        _ => return Ok(()),
    };
    Err(ApiError::new(Code::Malformed, problem))
}

/// A `Host` may be a name with or without a port, or empty.
fn is_host(value: &HeaderValue) -> bool {
    is_plain_host(value.as_bytes())
        || value.is_empty()
        || value.to_str().is_ok_and(|host| !host.contains('@') && host.parse::<Authority>().is_ok())
}

/// Nearly every host is a name or an IPv4 address, and a port, which needs no parser.
fn is_plain_host(host: &[u8]) -> bool {
    let colon = host.iter().position(|byte| *byte == b':');
    let (name, port) = host.split_at(colon.unwrap_or(host.len()));
    let is_of_name = |byte: &u8| byte.is_ascii_alphanumeric() || matches!(byte, b'.' | b'-');
    let is_port = matches!(port.len(), 0 | 2..=5) && port.iter().skip(1).all(u8::is_ascii_digit);
    !name.is_empty() && name.iter().all(is_of_name) && is_port
}

//! A cheap client: one keep-alive connection, requests prepared as bytes, and answers parsed only as far as needed.
//! Client and server usually share a machine, so every cost of the client slows the server down, and moves the ratio
//! of server and bare program toward 1.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::io;
use std::net::SocketAddr;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use reqwest::Url;
use serde::Serialize;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::timeout;

use super::LoadError;

/// Timeout of an answer, long polls included.
const PATIENCE: Duration = Duration::from_secs(90);

/// Attempts for a request that the server answers with 429 or 503.
const TRIES_MAX: u32 = 30;

/// Errors whose texts are recorded.
const SAMPLES_MAX: usize = 5;

/// Headers of an answer that are read.
const HEADERS_MAX: usize = 32;

/// The tested server.
#[derive(Clone, Debug)]
pub(crate) struct Target {
    host: String,
    addr: SocketAddr,
    key: Option<String>,
}

impl Target {
    /// A server at `base`, such as `http://127.0.0.1:8080`, whose episodes are created with `key`.
    pub(crate) async fn new(base: &str, key: Option<String>) -> Result<Self, LoadError> {
        let (host, addr) = find(base).await?;
        Ok(Self { host, addr, key })
    }

    /// The address of the server.
    pub(crate) const fn addr(&self) -> SocketAddr {
        self.addr
    }

    /// The key that may create episodes.
    pub(crate) fn key(&self) -> Option<&str> {
        self.key.as_deref()
    }
}

/// Resolves a URL: its host with the port, and the address.
async fn find(base: &str) -> Result<(String, SocketAddr), LoadError> {
    let url = Url::parse(base).ok().filter(|url| url.scheme() == "http");
    let parts = url.as_ref().and_then(|url| Some((url.host_str()?, url.port_or_known_default()?)));
    let (name, port) = parts.ok_or_else(|| LoadError::Address(base.to_owned()))?;
    let host = format!("{name}:{port}");
    let lookup = |source| LoadError::Lookup { host: host.clone(), source };
    let addr = tokio::net::lookup_host(&host).await.map_err(lookup)?.next();
    let addr = addr.ok_or_else(|| lookup(io::Error::other("no address")))?;
    Ok((host, addr))
}

/// The bytes of a whole request.
pub(crate) fn request(
    target: &Target,
    method: &str,
    path: &str,
    token: Option<&str>,
    json: Option<&str>,
) -> Vec<u8> {
    let mut text = format!("{method} {path} HTTP/1.1\r\nhost: {}\r\n", target.host);
    let written = (|| {
        if let Some(token) = token {
            write!(text, "authorization: Bearer {token}\r\n")?;
        }
        if let Some(json) = json {
            write!(
                text,
                "content-type: application/json\r\ncontent-length: {}\r\n\r\n{json}",
                json.len()
            )
        } else {
            text.write_str("\r\n")
        }
    })();
    written.expect("a string takes all text");
    text.into_bytes()
}

/// The head of an answer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ResponseHead {
    status: u16,
    retry_after: Option<Duration>,
    closes: bool,
    /// The range of the body in the buffer.
    body: (usize, usize),
}

impl ResponseHead {
    /// True if the status is 200 to 299.
    pub(crate) const fn is_ok(&self) -> bool {
        matches!(self.status, 200..=299)
    }
}

/// A connection, which is opened at its first use, and again after the server has closed it.
#[derive(Debug)]
pub(crate) struct Connection {
    addr: SocketAddr,
    stream: Option<TcpStream>,
    buffer: Vec<u8>,
    body: (usize, usize),
}

impl Connection {
    /// A connection that is not open yet.
    pub(crate) fn new(target: &Target) -> Self {
        Self { addr: target.addr, stream: None, buffer: Vec::new(), body: (0, 0) }
    }

    /// Opens the connection.
    pub(crate) async fn open(&mut self) -> io::Result<&mut TcpStream> {
        if self.stream.is_none() {
            let stream = timeout(PATIENCE, TcpStream::connect(self.addr)).await??;
            stream.set_nodelay(true)?;
            self.stream = Some(stream);
        }
        Ok(self.stream.as_mut().expect("it was opened just now"))
    }

    /// The body of the last answer.
    pub(crate) fn body(&self) -> &[u8] {
        &self.buffer[self.body.0..self.body.1]
    }

    /// Sends a request and reads the answer.
    pub(crate) async fn ask(&mut self, request: &[u8]) -> io::Result<ResponseHead> {
        let was_open = self.stream.is_some();
        let mut result = timeout(PATIENCE, self.exchange(request)).await;
        if was_open && matches!(&result, Ok(Err(_))) && self.buffer.is_empty() {
            // A server may close an idle connection at any time; all requests here can be repeated.
            self.stream = None;
            result = timeout(PATIENCE, self.exchange(request)).await;
        }
        match result.unwrap_or_else(|_| Err(io::ErrorKind::TimedOut.into())) {
            Ok(answer) => {
                self.body = answer.body;
                if answer.closes {
                    self.stream = None;
                }
                Ok(answer)
            }
            Err(error) => {
                self.stream = None;
                Err(error)
            }
        }
    }

    async fn exchange(&mut self, request: &[u8]) -> io::Result<ResponseHead> {
        self.buffer.clear();
        self.body = (0, 0);
        self.open().await?.write_all(request).await?;
        let answer = loop {
            self.read().await?;
            if let Some(answer) = head(&self.buffer)? {
                break answer;
            }
        };
        self.buffer.reserve(answer.body.1.saturating_sub(self.buffer.len()));
        while self.buffer.len() < answer.body.1 {
            self.read().await?;
        }
        Ok(answer)
    }

    async fn read(&mut self) -> io::Result<()> {
        if self.buffer.capacity() == self.buffer.len() {
            self.buffer.reserve(4096);
        }
        let stream = self.stream.as_mut().ok_or(io::ErrorKind::NotConnected)?;
        if stream.read_buf(&mut self.buffer).await? == 0 {
            return Err(io::Error::new(
                io::ErrorKind::UnexpectedEof,
                "the connection was closed before the end of the answer",
            ));
        }
        Ok(())
    }

    /// Sends a request, and retries when the server asks for that; counts the answers. Returns whether the request
    /// succeeded.
    pub(crate) async fn call(&mut self, tally: &Tally, request: &[u8]) -> bool {
        for _ in 0..TRIES_MAX {
            match self.ask(request).await {
                Ok(answer) if answer.is_ok() => {
                    tally.ok.fetch_add(1, Ordering::Relaxed);
                    return true;
                }
                Ok(answer) if matches!(answer.status, 429 | 503) => {
                    tally.held_back.fetch_add(1, Ordering::Relaxed);
                    tokio::time::sleep(answer.retry_after.unwrap_or(Duration::from_secs(1))).await;
                }
                Ok(answer) => {
                    let body: String =
                        String::from_utf8_lossy(self.body()).chars().take(300).collect();
                    tally.error(|| format!("{}: {} {body}", first_line(request), answer.status));
                    return false;
                }
                Err(error) => {
                    tally.error(|| format!("{}: {error}", first_line(request)));
                    return false;
                }
            }
        }
        tally.error(|| format!("{}: refused {TRIES_MAX} times", first_line(request)));
        false
    }

    /// Parses the last answer as JSON; a failure is counted as an error.
    pub(crate) fn read_json<'a, T: serde::Deserialize<'a>>(&'a self, tally: &Tally) -> Option<T> {
        let read = serde_json::from_slice(self.body());
        read.inspect_err(|error| tally.error(|| format!("an answer is not as expected: {error}")))
            .ok()
    }
}

fn first_line(request: &[u8]) -> String {
    let end = request.iter().position(|&byte| byte == b'\r').unwrap_or(request.len());
    String::from_utf8_lossy(&request[..end]).into_owned()
}

/// Reads the head of an answer, if it is complete.
fn head(bytes: &[u8]) -> io::Result<Option<ResponseHead>> {
    let mut headers = [httparse::EMPTY_HEADER; HEADERS_MAX];
    let mut response = httparse::Response::new(&mut headers);
    let parsed = response.parse(bytes).map_err(io::Error::other)?;
    let httparse::Status::Complete(begin) = parsed else { return Ok(None) };
    let find = |name: &str| {
        let header = response.headers.iter().find(|header| header.name.eq_ignore_ascii_case(name));
        header.and_then(|header| std::str::from_utf8(header.value).ok())
    };
    let status = response.code.unwrap_or_default();
    let length = match find("content-length").map(str::parse::<usize>) {
        Some(Ok(length)) => length,
        None if status == 204 => 0,
        _ => return Err(io::Error::other("an answer without a content-length is not read here")),
    };
    Ok(Some(ResponseHead {
        status,
        retry_after: find("retry-after").and_then(|s| s.parse().ok()).map(Duration::from_secs),
        closes: find("connection").is_some_and(|value| value.eq_ignore_ascii_case("close")),
        body: (begin, begin + length),
    }))
}

/// Counts the answers of all connections of a scenario.
#[derive(Debug, Default)]
pub(crate) struct Tally {
    ok: AtomicU64,
    held_back: AtomicU64,
    errors: AtomicU64,
    samples: Mutex<BTreeSet<String>>,
}

/// Outcomes of all requests.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub(crate) struct Answers {
    /// Answers with a status of 200 to 299.
    pub(crate) ok: u64,
    /// Answers 429 and 503, after which the request was repeated when the server allowed it.
    pub(crate) held_back: u64,
    /// All other answers, and requests without an answer.
    pub(crate) errors: u64,
    /// The texts of some errors.
    pub(crate) samples: Vec<String>,
}

impl Tally {
    /// Counts an error.
    pub(crate) fn error(&self, text: impl FnOnce() -> String) {
        self.errors.fetch_add(1, Ordering::Relaxed);
        let mut samples = self.samples.lock().expect("nothing panics while it holds this");
        if samples.len() < SAMPLES_MAX {
            samples.insert(text());
        }
    }

    /// The counts so far.
    pub(crate) fn answers(&self) -> Answers {
        let samples = self.samples.lock().expect("nothing panics while it holds this");
        Answers {
            ok: self.ok.load(Ordering::Relaxed),
            held_back: self.held_back.load(Ordering::Relaxed),
            errors: self.errors.load(Ordering::Relaxed),
            samples: samples.iter().cloned().collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heads_are_read_when_they_are_whole() {
        let text = b"HTTP/1.1 503 Service Unavailable\r\nContent-Length: 2\r\nRetry-After: 3\r\nconnection: close\r\n\r\n{}";
        for end in 0..text.len() - 2 {
            assert!(head(&text[..end]).expect("nothing wrong").is_none(), "{end}");
        }
        let answer = head(text).expect("a head").expect("a whole one");
        assert_eq!(answer.status, 503);
        assert!(!answer.is_ok() && answer.closes);
        assert_eq!(answer.retry_after, Some(Duration::from_secs(3)));
        assert_eq!(&text[answer.body.0..answer.body.1], b"{}");
        assert!(head(b"SSH-2.0-OpenSSH\r\n\r\n").is_err());
        assert!(head(b"HTTP/1.1 200 OK\r\ntransfer-encoding: chunked\r\n\r\n").is_err());
    }
}

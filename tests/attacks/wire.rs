//! A connection that costs little: what it sends is written out beforehand, and of a large answer it keeps the
//! beginning only. It can come from several addresses.

use std::fmt::Write as _;
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::sync::Arc;
use std::time::{Duration, Instant};

use serde::de::DeserializeOwned;
use serde_json::Value;
use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::net::{TcpSocket, TcpStream};
use tokio::time::timeout;

use crate::attacks::measure::Tally;

/// Maximum time of an answer, long polls included.
const PATIENCE: Duration = Duration::from_secs(75);

/// Bytes of a line of a head, or of a chunk's size.
const LINE_BYTES_MAX: usize = 16 * 1024;

/// Bytes of an answer that are kept, unless somebody wants all of it.
const KEPT_BYTES: usize = 64 * 1024;

/// From where a connection comes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Source {
    /// The address of the connection itself: 127.0.0.1 is the trusted proxy.
    pub(crate) bind: Ipv4Addr,
    /// For whom the proxy asks.
    pub(crate) forwarded: Option<IpAddr>,
}

impl Source {
    /// A program on the server's own host.
    pub(crate) const HOST: Self = Self { bind: Ipv4Addr::new(127, 0, 0, 2), forwarded: None };

    /// A client behind the proxy.
    pub(crate) fn behind_proxy(client: impl Into<IpAddr>) -> Self {
        Self { bind: Ipv4Addr::LOCALHOST, forwarded: Some(client.into()) }
    }

    /// A client behind the proxy, in a /64 network of the one /48 network that attackers have.
    pub(crate) fn in_site(network: u16, host: u16) -> Self {
        Self::behind_proxy(Ipv6Addr::new(0x2001, 0xdb8, 5, network, 0, 0, 0, host))
    }
}

/// A request that can be sent many times.
#[derive(Clone, Debug)]
pub(crate) struct Request {
    pub(crate) method: &'static str,
    pub(crate) path: String,
    /// Further lines of the head.
    pub(crate) head: String,
    pub(crate) token: Option<String>,
    pub(crate) body: Option<String>,
}

impl Request {
    pub(crate) fn get(path: impl Into<String>) -> Self {
        Self { method: "GET", path: path.into(), head: String::new(), token: None, body: None }
    }

    pub(crate) fn post(path: impl Into<String>, body: &Value) -> Self {
        Self::post_text(path, body.to_string())
    }

    pub(crate) fn post_text(path: impl Into<String>, body: String) -> Self {
        Self { method: "POST", body: Some(body), ..Self::get(path) }
    }

    pub(crate) fn with(self, token: &str) -> Self {
        Self { token: Some(token.to_owned()), ..self }
    }

    /// Bytes of the request, for a source.
    pub(crate) fn bytes(&self, source: Source) -> Vec<u8> {
        let Self { method, path, head, .. } = self;
        // The host is an address, as `/mcp` takes no name that the server was not started with.
        let mut head = format!("{method} {path} HTTP/1.1\r\nhost: 192.0.2.1\r\n{head}");
        if let Some(address) = source.forwarded {
            write!(head, "x-forwarded-for: {address}\r\n").expect("a string takes all text");
        }
        if let Some(token) = &self.token {
            write!(head, "authorization: Bearer {token}\r\n").expect("a string takes all text");
        }
        let body = self.body.as_deref().unwrap_or_default();
        if self.body.is_some() {
            let length = body.len();
            write!(head, "content-type: application/json\r\ncontent-length: {length}\r\n")
                .expect("a string takes all text");
        }
        [head.as_bytes(), b"\r\n", body.as_bytes()].concat()
    }
}

/// An answer.
#[derive(Clone, Debug)]
pub(crate) struct WireAnswer {
    pub(crate) status: u16,
    pub(crate) retry_after: Option<Duration>,
    pub(crate) body: Vec<u8>,
}

impl WireAnswer {
    pub(crate) const fn is_ok(&self) -> bool {
        matches!(self.status, 200..=299)
    }

    /// True if the server asks to come back later.
    pub(crate) const fn is_later(&self) -> bool {
        matches!(self.status, 429 | 503)
    }

    /// True if a connection is refused, of whoever asks.
    pub(crate) fn is_of_connections(&self) -> bool {
        self.kind().contains("connections")
    }

    pub(crate) fn text(&self) -> String {
        String::from_utf8_lossy(&self.body[..self.body.len().min(300)]).into_owned()
    }

    pub(crate) fn read<T: DeserializeOwned>(&self) -> io::Result<T> {
        if !self.is_ok() {
            return Err(io::Error::other(format!("{} {}", self.status, self.text())));
        }
        serde_json::from_slice(&self.body).map_err(io::Error::other)
    }

    /// The status, and of an error its code and the limit that it names.
    pub(crate) fn kind(&self) -> String {
        let mut kind = self.status.to_string();
        if let Ok(problem) = serde_json::from_slice::<Value>(&self.body)
            && !self.is_ok()
        {
            let limit = problem.pointer("/limit/name");
            for part in [problem.get("code"), limit].into_iter().flatten() {
                kind = format!("{kind} {}", part.as_str().unwrap_or("?"));
            }
        }
        kind
    }
}

/// One connection. It is opened when it is first used, and again after it was closed.
#[derive(Debug)]
pub(crate) struct Wire {
    pub(crate) to: SocketAddr,
    pub(crate) source: Source,
    /// True if answers are kept to their end.
    pub(crate) keeps_all: bool,
    tally: Arc<Tally>,
    stream: Option<BufReader<TcpStream>>,
}

impl Wire {
    pub(crate) fn new(to: SocketAddr, source: Source, tally: &Arc<Tally>) -> Self {
        Self { to, source, keeps_all: false, tally: Arc::clone(tally), stream: None }
    }

    pub(crate) fn keeping_all(self) -> Self {
        Self { keeps_all: true, ..self }
    }

    pub(crate) fn close(&mut self) {
        self.stream = None;
    }

    /// Sends a request and reads the whole answer; counts both.
    pub(crate) async fn ask(&mut self, request: &Request) -> io::Result<WireAnswer> {
        self.ask_within(request, PATIENCE).await
    }

    pub(crate) async fn ask_within(
        &mut self,
        request: &Request,
        patience: Duration,
    ) -> io::Result<WireAnswer> {
        let began = Instant::now();
        let was_open = self.stream.is_some();
        let mut result = timeout(patience, self.exchange(request)).await;
        // A server may close a connection between two requests, which a client learns by asking.
        if was_open && began.elapsed() < patience / 2 && matches!(result, Ok(Err(_))) {
            self.close();
            result = timeout(patience, self.exchange(request)).await;
        }
        let result = result.unwrap_or_else(|_| Err(io::ErrorKind::TimedOut.into()));
        self.tally.came(result.as_ref());
        if result.is_err() {
            self.close();
        }
        result
    }

    /// Sends a request and does not wait for the answer.
    pub(crate) async fn send(&mut self, request: &Request) -> io::Result<()> {
        let bytes = request.bytes(self.source);
        timeout(PATIENCE, self.send_bytes(&bytes)).await?
    }

    /// Sends some bytes.
    pub(crate) async fn send_bytes(&mut self, bytes: &[u8]) -> io::Result<()> {
        let stream = self.open(None).await?;
        stream.get_mut().write_all(bytes).await?;
        self.tally.sent(bytes.len());
        Ok(())
    }

    /// True if the first line of an answer says that all is well.
    pub(crate) async fn is_ok(&mut self) -> io::Result<bool> {
        let mut line = String::new();
        self.open(None).await?.read_line(&mut line).await?;
        Ok(line.contains(" 200 "))
    }

    /// Reads at most this many bytes; 0 if the server has closed the connection.
    pub(crate) async fn read_some(&mut self, most: usize) -> io::Result<usize> {
        let mut buffer = [0; 4096];
        let most = most.min(buffer.len());
        let read = self.open(None).await?.read(&mut buffer[..most]).await?;
        self.tally.received(read);
        Ok(read)
    }

    /// Opens the connection, where `window` says so with a small buffer for what comes.
    pub(crate) async fn open(
        &mut self,
        window: Option<usize>,
    ) -> io::Result<&mut BufReader<TcpStream>> {
        if self.stream.is_none() {
            let socket = TcpSocket::new_v4()?;
            if let Some(window) = window {
                socket.set_recv_buffer_size(u32::try_from(window).unwrap_or(u32::MAX))?;
            }
            if self.source.bind != Ipv4Addr::LOCALHOST {
                socket.bind((self.source.bind, 0).into())?;
            }
            let stream = timeout(PATIENCE, socket.connect(self.to)).await??;
            stream.set_nodelay(true)?;
            self.stream = Some(BufReader::with_capacity(4096, stream));
        }
        Ok(self.stream.as_mut().expect("it was opened just now"))
    }

    async fn exchange(&mut self, request: &Request) -> io::Result<WireAnswer> {
        let bytes = request.bytes(self.source);
        self.send_bytes(&bytes).await?;
        let kept = if self.keeps_all { usize::MAX } else { KEPT_BYTES };
        let tally = Arc::clone(&self.tally);
        let stream = self.stream.as_mut().ok_or(io::ErrorKind::NotConnected)?;
        let (answer, closes) = Reading { stream, tally: &tally, kept }.answer().await?;
        if closes {
            self.close();
        }
        Ok(answer)
    }
}

/// Ways to find an answer's end.
enum Length {
    Known(u64),
    Chunked,
    Closed,
}

struct Reading<'a> {
    stream: &'a mut BufReader<TcpStream>,
    tally: &'a Tally,
    kept: usize,
}

impl Reading<'_> {
    /// The answer, and whether the connection ends with it.
    async fn answer(mut self) -> io::Result<(WireAnswer, bool)> {
        let first = self.line().await?;
        let status = first.split(' ').nth(1).and_then(|status| status.parse().ok());
        let status = status.ok_or_else(|| io::Error::other(format!("not HTTP: {first:?}")))?;
        let (mut length, mut retry_after, mut closes) = (Length::Closed, None, false);
        loop {
            let line = self.line().await?;
            if line.is_empty() {
                break;
            }
            let (name, value) = line.split_once(':').unwrap_or((&line, ""));
            let value = value.trim();
            match name.to_ascii_lowercase().as_str() {
                "content-length" => {
                    length = Length::Known(value.parse().map_err(io::Error::other)?);
                }
                "transfer-encoding" => length = Length::Chunked,
                "retry-after" => retry_after = value.parse().ok().map(Duration::from_secs),
                "connection" => closes = value.eq_ignore_ascii_case("close"),
                _ => {}
            }
        }
        let mut body = Vec::new();
        match length {
            Length::Known(bytes) => self.take(bytes, &mut body).await?,
            Length::Chunked => self.chunks(&mut body).await?,
            Length::Closed => {
                closes = true;
                while self.some(u64::MAX, &mut body).await? > 0 {}
            }
        }
        Ok((WireAnswer { status, retry_after, body }, closes))
    }

    async fn chunks(&mut self, body: &mut Vec<u8>) -> io::Result<()> {
        loop {
            let size = self.line().await?;
            let size = u64::from_str_radix(size.trim(), 16).map_err(io::Error::other)?;
            self.take(size, body).await?;
            self.line().await?;
            if size == 0 {
                return Ok(());
            }
        }
    }

    async fn take(&mut self, mut bytes: u64, body: &mut Vec<u8>) -> io::Result<()> {
        while bytes > 0 {
            match self.some(bytes, body).await? {
                0 => return Err(io::ErrorKind::UnexpectedEof.into()),
                read => bytes -= read,
            }
        }
        Ok(())
    }

    async fn some(&mut self, most: u64, body: &mut Vec<u8>) -> io::Result<u64> {
        let there = self.stream.fill_buf().await?;
        let used = there.len().min(usize::try_from(most).unwrap_or(usize::MAX));
        let kept = used.min(self.kept.saturating_sub(body.len()));
        body.extend_from_slice(&there[..kept]);
        self.stream.consume(used);
        self.tally.received(used);
        Ok(used as u64)
    }

    async fn line(&mut self) -> io::Result<String> {
        let mut line = Vec::new();
        let most = LINE_BYTES_MAX as u64;
        let read = (&mut self.stream).take(most).read_until(b'\n', &mut line).await?;
        if read == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        self.tally.received(read);
        let line = String::from_utf8(line).map_err(io::Error::other)?;
        Ok(line.trim_end_matches(['\r', '\n']).to_owned())
    }
}

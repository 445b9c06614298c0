//! The minimal server of `/obs`: an axum handler that always sends the same bytes.
//!
//! The handler runs in a process of its own, like the server that it is compared with, so both share the machine with the
//! client in the same way, and both report their processor time at `/metrics`.

use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, Command, Stdio};

use axum::Router;
use axum::http::header;
use axum::routing::get;
use axum::serve::ListenerExt;
use bytes::Bytes;
use tokio::net::TcpListener;

use super::LoadError;
use super::connection::Target;

/// The process of the handler, which ends when the value is dropped.
#[derive(Debug)]
pub(crate) struct BareHandler {
    child: Child,
}

impl BareHandler {
    /// Starts `command`, which must call [`serve`], and returns its address.
    pub(crate) async fn start(
        mut command: Command,
        body: &[u8],
    ) -> Result<(Self, Target), LoadError> {
        let failed = |error| LoadError::of("the bare handler cannot be started")(&error);
        let child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().map_err(failed)?;
        let mut started = Self { child };
        let address = started.hand_over(body).map_err(failed)?;
        Ok((started, Target::new(address.trim(), None).await?))
    }

    fn hand_over(&mut self, body: &[u8]) -> std::io::Result<String> {
        let input = self.child.stdin.as_mut().ok_or(std::io::ErrorKind::BrokenPipe)?;
        writeln!(input, "{}", body.len())?;
        input.write_all(body)?;
        input.flush()?;
        let output = self.child.stdout.as_mut().ok_or(std::io::ErrorKind::BrokenPipe)?;
        let mut address = String::new();
        BufReader::new(output).read_line(&mut address)?;
        Ok(address)
    }
}

impl Drop for BareHandler {
    fn drop(&mut self) {
        // The process ends when its input is closed, which also happens if this process is killed.
        drop(self.child.stdin.take());
        drop(self.child.wait());
    }
}

/// Reads the bytes to send from the standard input, prints its address, and serves until the input ends. `metrics`
/// returns the text of `/metrics`.
pub(crate) async fn serve(metrics: fn() -> String) -> std::io::Result<()> {
    let body = read_body(&mut std::io::stdin().lock())?;
    let answer = move || {
        let body = body.clone();
        async move { ([(header::CONTENT_TYPE, "application/json")], body) }
    };
    serve_until_input_ends(Router::new().route("/obs", get(answer)), metrics).await
}

/// Prints its address, and serves the routes and `/metrics` until the standard input ends.
pub(crate) async fn serve_until_input_ends(
    router: Router,
    metrics: fn() -> String,
) -> std::io::Result<()> {
    let router = router.route("/metrics", get(move || async move { metrics() }));
    let listener = TcpListener::bind(("127.0.0.1", 0)).await?;
    println!("http://{}", listener.local_addr()?);
    let (end, ended) = tokio::sync::oneshot::channel::<()>();
    std::thread::spawn(move || {
        // The input is closed when the parent process ends.
        drop(std::io::stdin().lock().read(&mut [0]));
        drop(end);
    });
    // As in the server, small answers are sent at once.
    let listener = listener.tap_io(|stream| drop(stream.set_nodelay(true)));
    let served = axum::serve(listener, router);
    tokio::select! {
        served = served.into_future() => served,
        _ = ended => Ok(()),
    }
}

pub(crate) fn read_body(input: &mut impl BufRead) -> std::io::Result<Bytes> {
    let mut length = String::new();
    input.read_line(&mut length)?;
    let length = length.trim().parse().map_err(std::io::Error::other)?;
    let mut body = vec![0; length];
    input.read_exact(&mut body)?;
    Ok(Bytes::from(body))
}

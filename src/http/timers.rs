//! Timeouts of a connection: for the head of a request, between requests, and for reading a response.
//!
//! hyper's own timer cannot tell a slow head from an idle connection, and there is none for writing. So the stream records reads
//! and writes, the service records when a request has arrived and when its response is handed over, and the task that serves the
//! connection also waits for [`ConnectionTimers::timed_out`]. The time limit of a body is in `body.rs`.

use std::io;
use std::pin::{Pin, pin};
use std::sync::{Arc, Mutex, MutexGuard};
use std::task::{Context, Poll, ready};
use std::time::Duration;

use axum::body::Body;
use bytes::Bytes;
use hyper::body::{Frame, SizeHint};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::Instant;

use super::in_flight::RequestContext;
use super::limits::Limits;

/// Time limits of a connection.
#[derive(Clone, Copy, Debug)]
pub(super) struct Timeouts {
    /// Time from the first byte of a head to its end; for the first head from the accept.
    pub(super) head: Duration,
    /// Time from the end of a response to the first byte of the next head.
    pub(super) idle: Duration,
    /// Time within which the client must take more of a pending write.
    pub(super) write: Duration,
    /// Bytes per second that the client must take while a write is pending.
    pub(super) bytes_per_s_min: u64,
}

/// Pending time over which the throughput of a client is measured.
const WINDOW: Duration = Duration::from_secs(30);

impl From<&Limits> for Timeouts {
    fn from(limits: &Limits) -> Self {
        Self {
            head: Duration::from_millis(limits.head_ms_max),
            idle: Duration::from_millis(limits.idle_ms_max),
            write: Duration::from_millis(limits.write_ms_max),
            bytes_per_s_min: limits.write_bytes_per_s_min,
        }
    }
}

/// The limit that a connection exceeded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Timeout {
    Head,
    Idle,
    Write,
}

impl Timeout {
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Head => "head",
            Self::Idle => "idle",
            Self::Write => "write",
        }
    }
}

/// Current use of a connection. The least is evicted first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Usage {
    /// No request is in flight since then: the connection is idle, or the head is incomplete.
    None(Instant),
    /// Bytes per second read and written since the head of the request arrived.
    Request(u64),
}

/// Timers of one connection. Clones share them.
#[derive(Clone, Debug)]
pub(super) struct ConnectionTimers(Arc<Mutex<State>>);

impl ConnectionTimers {
    /// Timers of a connection that was just accepted.
    pub(super) fn new(timeouts: Timeouts) -> Self {
        Self(Arc::new(Mutex::new(State::new(timeouts, Instant::now()))))
    }

    /// Completes when a limit is exceeded. The task that serves the connection must poll this after the connection: only that task
    /// moves the timers.
    pub(super) async fn timed_out(&self) -> Timeout {
        let mut timer = pin!(tokio::time::sleep(Duration::ZERO));
        std::future::poll_fn(|context| {
            let Some((at, late)) = self.state().deadline() else { return Poll::Pending };
            if timer.deadline() != at {
                timer.as_mut().reset(at);
            }
            timer.as_mut().poll(context).map(|()| late)
        })
        .await
    }

    /// Records that the head of a request was received. The request is in flight until the result is dropped.
    pub(super) fn pending(&self) -> PendingResponse {
        self.state().head_received(Instant::now());
        PendingResponse(self.clone())
    }

    pub(super) fn usage(&self) -> Usage {
        self.state().usage(Instant::now())
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().expect("nothing panics while it holds this")
    }
}

/// An unanswered request. Dropping it makes the connection idle again.
#[derive(Debug)]
pub(super) struct PendingResponse(ConnectionTimers);

impl Drop for PendingResponse {
    fn drop(&mut self) {
        self.0.state().answered(Instant::now());
    }
}

/// Body of a response; the request counts as answered when it is dropped, complete or not.
pub(super) struct TimedBody {
    pub(super) body: Body,
    pub(super) _pending: PendingResponse,
    pub(super) request: Option<RequestContext>,
}

impl hyper::body::Body for TimedBody {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let Self { body, request, .. } = &mut *self;
        let mut poll = || Pin::new(&mut *body).poll_frame(context);
        match request {
            Some(request) => request.origin.enter(poll),
            None => poll(),
        }
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

/// A stream that records reads and writes.
pub(super) struct TimedStream<S> {
    pub(super) stream: S,
    pub(super) timers: ConnectionTimers,
}

impl<S> TimedStream<S> {
    fn noted(&self, written: Poll<io::Result<usize>>) -> Poll<io::Result<usize>> {
        match &written {
            Poll::Ready(Ok(count)) => self.timers.state().wrote(Instant::now(), *count),
            Poll::Ready(Err(_)) => {}
            Poll::Pending => self.timers.state().blocked(Instant::now()),
        }
        written
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for TimedStream<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        ready!(Pin::new(&mut self.stream).poll_read(context, buffer))?;
        let count = buffer.filled().len() - before;
        if count > 0 {
            self.timers.state().read(Instant::now(), count);
        }
        Poll::Ready(Ok(()))
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for TimedStream<S> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.noted(written)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        pieces: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write_vectored(context, pieces);
        self.noted(written)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Head,
    /// The request is unanswered. Its handler bounds the time.
    Request,
    /// No byte of the next request has arrived.
    Idle,
}

/// The timers as a pure state machine.
#[derive(Debug)]
struct State {
    timeouts: Timeouts,
    phase: Phase,
    /// Start of the phase.
    since: Instant,
    /// Time since which the client has taken nothing although a write is pending.
    blocked_since: Option<Instant>,
    /// Total pending time in this window, up to `blocked_since`.
    waited: Duration,
    /// Bytes that the client has taken in this window.
    taken: u64,
    /// Bytes read and written since the head of the last request arrived.
    moved: u64,
}

impl State {
    const fn new(timeouts: Timeouts, now: Instant) -> Self {
        let (blocked_since, waited, taken) = (None, Duration::ZERO, 0);
        let (phase, since, moved) = (Phase::Head, now, 0);
        Self { timeouts, phase, since, blocked_since, waited, taken, moved }
    }

    fn read(&mut self, now: Instant, bytes: usize) {
        self.moved = self.moved.saturating_add(bytes as u64);
        if self.phase == Phase::Idle {
            self.phase = Phase::Head;
            self.since = now;
        }
    }

    fn wrote(&mut self, now: Instant, bytes: usize) {
        if let Some(since) = self.blocked_since.take() {
            self.waited += now - since;
        }
        self.moved = self.moved.saturating_add(bytes as u64);
        self.taken = self.taken.saturating_add(bytes as u64);
        let least = self.timeouts.bytes_per_s_min.saturating_mul(WINDOW.as_secs());
        if self.taken >= least {
            // A client that is fast enough starts a new window, however long it took.
            (self.waited, self.taken) = (Duration::ZERO, 0);
        }
        if self.phase != Phase::Request {
            // The end of a response that was handed over is still being written.
            self.since = now;
        }
    }

    fn blocked(&mut self, now: Instant) {
        self.blocked_since.get_or_insert(now);
    }

    const fn head_received(&mut self, now: Instant) {
        self.phase = Phase::Request;
        self.since = now;
        self.moved = 0;
    }

    const fn answered(&mut self, now: Instant) {
        self.phase = Phase::Idle;
        self.since = now;
    }

    fn usage(&self, now: Instant) -> Usage {
        if self.phase != Phase::Request {
            return Usage::None(self.since);
        }
        let seconds = (now - self.since).as_secs().saturating_add(1);
        Usage::Request(self.moved / seconds)
    }

    /// The next deadline. None while a request is being answered, unless the client does not take the response.
    fn deadline(&self) -> Option<(Instant, Timeout)> {
        let read = match self.phase {
            Phase::Head => Some((self.since + self.timeouts.head, Timeout::Head)),
            Phase::Request => None,
            Phase::Idle => Some((self.since + self.timeouts.idle, Timeout::Idle)),
        };
        let write = self.blocked_since.map(|since| (since + self.timeouts.write, Timeout::Write));
        let left = WINDOW.saturating_sub(self.waited);
        let throughput = self.blocked_since.map(|since| (since + left, Timeout::Write));
        [read, write, throughput].into_iter().flatten().min_by_key(|&(at, _)| at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PATIENCE: Timeouts = Timeouts {
        head: Duration::from_secs(10),
        idle: Duration::from_secs(75),
        write: Duration::from_secs(20),
        bytes_per_s_min: 100,
    };

    /// A connection accepted at second 0; deadlines are in seconds.
    struct Case(State, Instant);

    impl Case {
        fn new() -> Self {
            let start = Instant::now();
            Self(State::new(PATIENCE, start), start)
        }

        fn at(&self, second: u64) -> Instant {
            self.1 + Duration::from_secs(second)
        }

        fn read(&mut self, second: u64) {
            self.0.read(self.at(second), 1);
        }

        fn head_received(&mut self, second: u64) {
            self.0.head_received(self.at(second));
        }

        fn wrote(&mut self, second: u64) {
            self.took(second, 1);
        }

        fn took(&mut self, second: u64, bytes: usize) {
            self.0.wrote(self.at(second), bytes);
        }

        fn blocked(&mut self, second: u64) {
            self.0.blocked(self.at(second));
        }

        fn answered(&mut self, second: u64) {
            self.0.answered(self.at(second));
        }

        fn expect(&self, expected: Option<(u64, Timeout)>) {
            let deadline = self.0.deadline().map(|(at, late)| ((at - self.1).as_secs(), late));
            assert_eq!(deadline, expected);
        }
    }

    #[test]
    fn a_client_has_to_take_something_now_and_then() {
        let mut case = Case::new();
        case.head_received(0);
        case.blocked(5);
        case.blocked(15);
        case.expect(Some((25, Timeout::Write)));
        case.took(24, 3000);
        case.expect(None);
        case.blocked(24);
        case.expect(Some((44, Timeout::Write)));
        // Handed over does not mean taken.
        case.answered(30);
        case.expect(Some((44, Timeout::Write)));
    }

    #[test]
    fn a_client_that_takes_a_little_now_and_then_is_too_slow() {
        let mut case = Case::new();
        case.head_received(0);
        for second in (0..25).step_by(5) {
            case.blocked(second);
            case.took(second + 5, 499);
        }
        // A write was pending for 25 of 30 seconds, and 2,495 bytes were taken: 100 a second would be 3,000.
        case.expect(None);
        case.blocked(100);
        case.expect(Some((105, Timeout::Write)));
        case.took(104, 505);
        case.blocked(104);
        case.expect(Some((124, Timeout::Write)));
    }

    #[test]
    fn no_clock_of_the_next_request_runs_out_while_an_answer_is_taken() {
        let mut case = Case::new();
        case.head_received(0);
        case.answered(1);
        case.wrote(70);
        case.expect(Some((145, Timeout::Idle)));
        case.read(71);
        case.wrote(79);
        case.expect(Some((89, Timeout::Head)));
    }

    #[test]
    fn a_connection_without_a_request_is_of_less_use_than_a_slow_one() {
        let at = |case: &Case, second| case.0.usage(case.at(second));
        let mut case = Case::new();
        assert_eq!(at(&case, 5), Usage::None(case.at(0)));
        case.head_received(6);
        assert_eq!(at(&case, 6), Usage::Request(0));
        case.took(7, 300);
        case.0.read(case.at(8), 100);
        assert_eq!(at(&case, 9), Usage::Request(100));
        case.answered(10);
        assert_eq!(at(&case, 60), Usage::None(case.at(10)));
        case.read(61);
        assert_eq!(at(&case, 62), Usage::None(case.at(61)));
        case.head_received(63);
        assert_eq!(at(&case, 63), Usage::Request(0));
        assert!(Usage::None(case.at(1)) < Usage::None(case.at(2)));
        assert!(Usage::None(case.at(90)) < Usage::Request(0));
    }
}

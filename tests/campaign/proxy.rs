//! Stands between two programs, and breaks their connections, loses or delays what they send, or is not there at all.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};
use std::time::Duration;

use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;

/// Fate of bytes in one direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Way {
    #[default]
    Open,
    /// Bytes wait, and arrive when the way is open again, as over a network that loses packets for a while.
    Held,
    /// Bytes never arrive. Connections must be broken before the way is open again.
    Lost,
}

/// Fate of new connections.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Doorway {
    #[default]
    Open,
    /// Connections are accepted, and closed.
    Closed,
    /// The host refuses connections, as no program listens.
    Gone,
}

pub(crate) struct Proxy {
    pub(crate) address: SocketAddr,
    state: Arc<State>,
}

#[derive(Default)]
struct State {
    /// Counts up when all connections break.
    generation: watch::Sender<u64>,
    doorway: watch::Sender<Doorway>,
    /// From the one that connects, and to it.
    questions: watch::Sender<Way>,
    answers: watch::Sender<Way>,
    /// The server of a cluster of which everything is held; 0 for none.
    held_caller: watch::Sender<i64>,
    delay_ms: AtomicU64,
    opened: AtomicU64,
}

impl Proxy {
    pub(crate) async fn before(server: String) -> Self {
        Self::at(0, server).await
    }

    /// At a port of its own, which is the same after it was gone.
    pub(crate) async fn at(port: u16, server: String) -> Self {
        let listener = TcpListener::bind(("127.0.0.1", port)).await.expect("a free port");
        let address = listener.local_addr().expect("an address");
        let state = Arc::new(State::default());
        tokio::spawn(accept(listener, address, server, Arc::clone(&state)));
        Self { address, state }
    }

    /// Sets the fate of requests of the connecting side, and of the answers.
    pub(crate) fn set_ways(&self, questions: Way, answers: Way) {
        self.state.questions.send_replace(questions);
        self.state.answers.send_replace(answers);
    }

    /// Holds everything of one server of a cluster, in both directions, or of none.
    pub(crate) fn hold_caller(&self, incarnation: Option<i64>) {
        self.state.held_caller.send_replace(incarnation.unwrap_or(0));
    }

    /// Delays everything by this time in each direction.
    pub(crate) fn set_delay(&self, delay: Duration) {
        let delay = u64::try_from(delay.as_millis()).expect("a short time");
        self.state.delay_ms.store(delay, Ordering::SeqCst);
    }

    pub(crate) fn break_all(&self) {
        self.state.generation.send_modify(|generation| *generation += 1);
    }

    /// Closes new connections at once.
    pub(crate) fn close(&self) {
        self.state.doorway.send_replace(Doorway::Closed);
    }

    /// Does not listen any more: whoever connects is refused by the host.
    pub(crate) fn leave(&self) {
        self.state.doorway.send_replace(Doorway::Gone);
    }

    /// Passes new connections on again, and everything that is sent.
    pub(crate) fn open(&self) {
        self.set_ways(Way::Open, Way::Open);
        self.hold_caller(None);
        self.set_delay(Duration::ZERO);
        self.state.doorway.send_replace(Doorway::Open);
    }

    /// Connections so far.
    pub(crate) fn opened(&self) -> u64 {
        self.state.opened.load(Ordering::SeqCst)
    }
}

async fn accept(first: TcpListener, address: SocketAddr, server: String, state: Arc<State>) {
    let mut doorway = state.doorway.subscribe();
    let mut first = Some(first);
    loop {
        let listener = match first.take() {
            Some(listener) => listener,
            None => TcpListener::bind(address).await.expect("its port is kept free"),
        };
        loop {
            tokio::select! {
                accepted = listener.accept() => {
                    let (client, _) = accepted.expect("a connection");
                    if *state.doorway.borrow() == Doorway::Open {
                        state.opened.fetch_add(1, Ordering::SeqCst);
                        tokio::spawn(pass(client, server.clone(), Arc::clone(&state)));
                    }
                }
                left = doorway.wait_for(|doorway| *doorway == Doorway::Gone) => {
                    if left.is_err() {
                        return;
                    }
                    break;
                }
            }
        }
        drop(listener);
        if doorway.wait_for(|doorway| *doorway != Doorway::Gone).await.is_err() {
            return;
        }
    }
}

/// Passes bytes both ways until the connections break.
async fn pass(client: TcpStream, server: String, state: Arc<State>) {
    let mut broken = state.generation.subscribe();
    let caller = AtomicI64::new(0);
    let passing = async {
        // What would ask for the connection is held, too.
        state.let_pass(&state.questions, &caller).await;
        let Ok(server) = TcpStream::connect(server).await else { return };
        let (from_client, to_client) = client.into_split();
        let (from_server, to_server) = server.into_split();
        tokio::select! {
            () = copy(from_client, to_server, &state, &state.questions, &caller) => {}
            () = copy(from_server, to_client, &state, &state.answers, &caller) => {}
        }
    };
    tokio::select! {
        () = passing => {}
        _ = broken.changed() => {}
    }
}

async fn copy(
    mut from: tokio::net::tcp::OwnedReadHalf,
    mut to: tokio::net::tcp::OwnedWriteHalf,
    state: &State,
    way: &watch::Sender<Way>,
    caller: &AtomicI64,
) {
    let mut bytes = vec![0; 64 * 1024];
    loop {
        let Ok(read @ 1..) = from.read(&mut bytes).await else { return };
        if let Some(found) = caller_in(&bytes[..read]) {
            caller.store(found, Ordering::SeqCst);
        }
        let delay = Duration::from_millis(state.delay_ms.load(Ordering::SeqCst));
        if !delay.is_zero() {
            tokio::time::sleep(delay).await;
        }
        let is_lost = state.let_pass(way, caller).await;
        if !is_lost && to.write_all(&bytes[..read]).await.is_err() {
            return;
        }
    }
}

impl State {
    /// Waits while what is sent is held; whether it is lost.
    async fn let_pass(&self, way: &watch::Sender<Way>, caller: &AtomicI64) -> bool {
        let mut held = self.held_caller.subscribe();
        let caller = caller.load(Ordering::SeqCst);
        drop(held.wait_for(|held| *held == 0 || *held != caller).await);
        let mut way = way.subscribe();
        let way = way.wait_for(|way| *way != Way::Held).await;
        way.is_ok_and(|way| *way == Way::Lost)
    }
}

/// Server of a cluster that has sent a request: a header of each has its number.
fn caller_in(bytes: &[u8]) -> Option<i64> {
    const HEADER: &[u8] = b"x-swarmbench-hop: ";
    let at = bytes.windows(HEADER.len()).position(|window| window.eq_ignore_ascii_case(HEADER))?;
    let digits: String = bytes[at + HEADER.len()..]
        .iter()
        .map(|byte| char::from(*byte))
        .take_while(char::is_ascii_digit)
        .collect();
    digits.parse().ok()
}

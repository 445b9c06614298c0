//! A round of an episode, played by a connection for each seat, or by one for all seats.

use std::fmt::Write as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use futures::StreamExt;
use futures::stream::FuturesUnordered;
use serde::Deserialize;
use swarmbench_testkit::latencies::Latencies;

use super::connection::{Connection, Tally, Target, request};
use super::games::LoadGame;

/// The action of every agent.
const ACTION: &str = "SWITCH";
const MESSAGE: &str = "switch all lights on together in the next round";

/// The connections that play an episode.
#[derive(Debug)]
pub(crate) enum Player {
    /// `/act` and `/obs` for each seat.
    Seats(Vec<SeatConnection>),
    /// `/swarm/act` and `/swarm/obs`.
    Swarm(Box<Swarm>),
}

impl Player {
    /// Plays with a connection for each seat.
    pub(crate) fn by_seats(
        target: &Target,
        game: &LoadGame,
        connections: impl Iterator<Item = Connection>,
    ) -> Self {
        let seats = game.seats.iter().zip(connections);
        Self::Seats(
            seats
                .map(|(token, connection)| SeatConnection::new(target, connection, token.clone()))
                .collect(),
        )
    }

    /// Plays with one connection for all seats of some games, one game after another. One seat of the first game
    /// waits for every round at `watcher`, if there is one.
    pub(crate) fn by_swarm(
        target: &Target,
        games: &[LoadGame],
        connection: Connection,
        watcher: Option<Connection>,
    ) -> Self {
        let acting = Acting::of(target, games, connection);
        let seat = games.iter().flat_map(|game| &game.seats).next().cloned().unwrap_or_default();
        let watcher = watcher.map(|connection| SeatConnection::new(target, connection, seat));
        Self::Swarm(Box::new(Swarm { acting, watcher }))
    }

    /// Plays one round of each game, with observations if `looks` is set, and counts it. Returns false if a request
    /// failed.
    pub(crate) async fn round(&mut self, score: &Score, round: u32, looks: bool) -> bool {
        let tally = &score.tally;
        let (acts, rounds, times) = match self {
            Self::Seats(seats) => (seats.len(), 1, by_seats(seats, tally, round, looks).await),
            Self::Swarm(swarm) => {
                let games = &swarm.acting.games;
                let (acts, rounds) = (games.iter().map(|game| game.agents).sum(), games.len());
                (acts, rounds, swarm.round(tally, round, looks).await)
            }
        };
        let Some(times) = times else { return false };
        score.acts.fetch_add(acts as u64, Ordering::Relaxed);
        score.rounds.fetch_add(rounds as u64, Ordering::Relaxed);
        score.acknowledged.record(times.acknowledged);
        score.woken.record(times.woken);
        true
    }
}

/// The measurements of all players of a scenario.
#[derive(Debug, Default)]
pub(crate) struct Score {
    /// Outcomes of all requests.
    pub(crate) tally: Arc<Tally>,
    /// Durable acts.
    pub(crate) acts: AtomicU64,
    /// Resolved rounds.
    pub(crate) rounds: AtomicU64,
    /// Time from sending an act, or the acts of all seats, until the answer.
    pub(crate) acknowledged: Latencies,
    /// Time from the receipt of a round's last act until a waiting client has the next observation.
    pub(crate) woken: Latencies,
}

/// One seat at its own connection.
#[derive(Debug)]
pub(crate) struct SeatConnection {
    connection: Connection,
    target: Target,
    token: String,
}

/// The times of a seat's requests in one round.
#[derive(Clone, Copy, Debug)]
struct Turn {
    sent: Instant,
    acknowledged: Instant,
    /// The begin and the end of the wait for the next round.
    waited: Option<(Instant, Instant)>,
}

/// The durations of one round of one episode; see [`Score`].
struct RoundTimes {
    acknowledged: Vec<Duration>,
    woken: Vec<Duration>,
}

/// The part of an observation that shows whether it is the expected one.
#[derive(Deserialize)]
struct Seen {
    round: u32,
}

impl SeatConnection {
    /// A seat at an open connection.
    pub(crate) fn new(target: &Target, connection: Connection, token: String) -> Self {
        Self { connection, target: target.clone(), token }
    }

    /// Acts, and waits for the next round if `waits` is set.
    async fn turn(&mut self, tally: &Tally, round: u32, waits: bool) -> Option<Turn> {
        let json = format!(r#"{{"round":{round},"action":"{ACTION}","message":"{MESSAGE}"}}"#);
        let act = request(&self.target, "POST", "/act", Some(&self.token), Some(&json));
        let (sent, acknowledged) = timed(&mut self.connection, tally, &act).await?;
        let waited = if waits { Some(self.wait(tally, round).await?) } else { None };
        Some(Turn { sent, acknowledged, waited })
    }

    /// Waits until the round is past `round`; returns the begin and the end of the wait.
    pub(crate) async fn wait(&mut self, tally: &Tally, round: u32) -> Option<(Instant, Instant)> {
        let path = format!("/obs?after={round}&wait=30");
        let look = request(&self.target, "GET", &path, Some(&self.token), None);
        let begun = Instant::now();
        loop {
            if !self.connection.call(tally, &look).await {
                return None;
            }
            let ended = Instant::now();
            let seen: Seen = self.connection.read_json(tally)?;
            if seen.round > round {
                return Some((begun, ended));
            }
        }
    }
}

/// Lets every seat act, and wait for the next round if `waits` is set. `None` if a request failed.
async fn by_seats(
    seats: &mut [SeatConnection],
    tally: &Tally,
    round: u32,
    waits: bool,
) -> Option<RoundTimes> {
    let mut playing: FuturesUnordered<_> =
        seats.iter_mut().map(|seat| seat.turn(tally, round, waits)).collect();
    let mut turns: Vec<Turn> = Vec::with_capacity(playing.len());
    while let Some(turn) = playing.next().await {
        // The others would wait for its act for ever.
        turns.push(turn?);
    }
    drop(playing);
    let last = turns.iter().map(|turn| turn.acknowledged).max()?;
    let waited = turns.iter().filter_map(|turn| turn.waited);
    Some(RoundTimes {
        acknowledged: turns.iter().map(|turn| turn.acknowledged - turn.sent).collect(),
        woken: waited.filter_map(|(begun, ended)| woken(last, begun, ended)).collect(),
    })
}

/// The time from the last receipt of a round until a request that waited from `begun` to `ended` was answered. `None`
/// if the wait began after the receipt, zero if it ended before.
fn woken(last: Instant, begun: Instant, ended: Instant) -> Option<Duration> {
    (begun <= last).then(|| ended.saturating_duration_since(last))
}

/// All seats of some episodes at one connection, and possibly a waiting seat at another.
#[derive(Debug)]
pub(crate) struct Swarm {
    acting: Acting,
    watcher: Option<SeatConnection>,
}

/// All seats of some episodes at one connection.
#[derive(Debug)]
pub(crate) struct Acting {
    connection: Connection,
    target: Target,
    games: Vec<Held>,
}

/// An episode whose seats are all played.
#[derive(Clone, Debug)]
struct Held {
    id: String,
    token: String,
    agents: usize,
}

/// The part of the receipts that shows whether one is a problem.
#[derive(Deserialize)]
struct Receipts {
    receipts: Vec<Receipt>,
}

#[derive(Deserialize)]
struct Receipt {
    code: Option<String>,
}

/// The part of a swarm's observations that is read.
#[derive(Deserialize)]
struct SwarmObservations {
    observations: Vec<Seen>,
}

impl Swarm {
    /// Plays one round: observes for all seats if `looks` is set, then acts for all of them. `None` if a request
    /// failed.
    async fn round(&mut self, tally: &Tally, round: u32, looks: bool) -> Option<RoundTimes> {
        let Self { acting, watcher } = self;
        // The wait begins before the round is played, so that the request is already waiting when the acts arrive.
        let watching = async {
            match watcher {
                Some(seat) => seat.wait(tally, round).await.map(Some),
                None => Some(None),
            }
        };
        let playing = async {
            let mut times = Vec::with_capacity(acting.games.len());
            for place in 0..acting.games.len() {
                if looks {
                    acting.look(tally, place, round).await?;
                }
                times.push(acting.act_in(tally, place, round).await?);
            }
            Some(times)
        };
        let (waited, acted) = tokio::join!(watching, playing);
        let acted = acted?;
        let first = acted.first().map(|(_, acknowledged)| *acknowledged);
        let woken = waited?.zip(first).and_then(|((begun, ended), at)| woken(at, begun, ended));
        Some(RoundTimes {
            acknowledged: acted
                .into_iter()
                .map(|(sent, acknowledged)| acknowledged - sent)
                .collect(),
            woken: woken.into_iter().collect(),
        })
    }
}

impl Acting {
    /// All seats of an episode at a connection.
    pub(crate) fn new(target: &Target, game: &LoadGame, connection: Connection) -> Self {
        Self::of(target, std::slice::from_ref(game), connection)
    }

    fn of(target: &Target, games: &[LoadGame], connection: Connection) -> Self {
        let held = |game: &LoadGame| Held {
            id: game.id.clone(),
            token: game.swarm_token.clone(),
            agents: game.seats.len(),
        };
        Self { connection, target: target.clone(), games: games.iter().map(held).collect() }
    }

    /// Acts for all seats of the first episode; returns the time of sending and the time of the receipts.
    pub(crate) async fn act(&mut self, tally: &Tally, round: u32) -> Option<(Instant, Instant)> {
        self.act_in(tally, 0, round).await
    }

    async fn act_in(
        &mut self,
        tally: &Tally,
        place: usize,
        round: u32,
    ) -> Option<(Instant, Instant)> {
        let Held { id, token, agents } = self.games.get(place)?;
        let json = acts(id, *agents, round);
        let act = request(&self.target, "POST", "/swarm/act", Some(token), Some(&json));
        let times = timed(&mut self.connection, tally, &act).await?;
        let receipts: Receipts = self.connection.read_json(tally)?;
        if let Some(code) = receipts.receipts.iter().find_map(|receipt| receipt.code.as_ref()) {
            tally.error(|| format!("an act of /swarm/act was refused: {code}"));
            return None;
        }
        Some(times)
    }

    /// Observes for all seats of an episode, all of which must have this round open.
    async fn look(&mut self, tally: &Tally, place: usize, round: u32) -> Option<()> {
        let Held { token, agents, .. } = self.games.get(place)?;
        let path = format!("/swarm/obs?wait=30&limit={agents}");
        let look = request(&self.target, "GET", &path, Some(token), None);
        if !self.connection.call(tally, &look).await {
            return None;
        }
        let look: SwarmObservations = self.connection.read_json(tally)?;
        let open = look.observations.iter().filter(|seen| seen.round == round).count();
        if open != *agents {
            tally.error(|| format!("{open} of {agents} seats wait in round {round}"));
            return None;
        }
        Some(())
    }
}

/// Sends a request; returns the time of sending and the time of the answer. `None` if it failed.
async fn timed(
    connection: &mut Connection,
    tally: &Tally,
    request: &[u8],
) -> Option<(Instant, Instant)> {
    let sent = Instant::now();
    connection.call(tally, request).await.then(|| (sent, Instant::now()))
}

/// The acts of all seats.
fn acts(id: &str, agents: usize, round: u32) -> String {
    let mut json = String::with_capacity(64 + agents * 180);
    json.push_str(r#"{"acts":["#);
    for agent in 0..agents {
        let comma = if agent == 0 { "" } else { "," };
        write!(
            json,
            r#"{comma}{{"episode":"{id}","agent":"Agent_{agent}","round":{round},"action":"{ACTION}","message":"{MESSAGE}"}}"#
        )
        .expect("a string takes all text");
    }
    json.push_str("]}");
    json
}

#[cfg(test)]
mod tests {
    use super::*;
    use swarmbench_protocol::act::SwarmActRequest;

    #[test]
    fn acts_are_those_of_the_contract() {
        let read: SwarmActRequest = serde_json::from_str(&acts("ep_1", 3, 7)).expect("acts");
        assert_eq!(read.acts.len(), 3);
        for (place, act) in read.acts.iter().enumerate() {
            assert_eq!(act.agent, format!("Agent_{place}"));
            assert_eq!((act.episode.as_str(), act.round), ("ep_1", 7));
        }
    }

    #[test]
    fn only_who_waited_already_was_woken() {
        let start = Instant::now();
        let at = |millis| start + Duration::from_millis(millis);
        for (begun, last, ended, expected) in [
            (0, 10, 12, Some(2)),
            // The answer arrived before the receipt.
            (0, 10, 9, Some(0)),
            (11, 10, 12, None),
        ] {
            assert_eq!(woken(at(last), at(begun), at(ended)), expected.map(Duration::from_millis));
        }
    }
}

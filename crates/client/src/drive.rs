//! The one loop that plays seats over HTTP, for all kinds of players: an observation request waits while decisions
//! are in flight, and acts are sent as they come.

use std::collections::HashMap;
use std::fmt::Display;
use std::time::Duration;

use futures::StreamExt;
use futures::future::BoxFuture;
use futures::stream::FuturesUnordered;
use tokio_util::sync::CancellationToken;

use super::client::{Client, ClientError};
use super::recent::Recent;
use swarmbench_clock::{Clock, SystemClock, after};
use swarmbench_protocol::act::{
    Receipt, SwarmAct, SwarmActResponse, SwarmObsResponse, SwarmReceipt,
};
use swarmbench_protocol::observation::Observation;
use swarmbench_protocol::problem::Problem;

/// Seconds that an observation request waits for news.
const WAIT_S: u32 = 30;

/// Observations in one answer.
const LOOK_MAX: usize = 256;

/// Decisions in flight. At this limit no more observations are requested, as those with prompts are large.
const IN_FLIGHT_MAX: usize = 2048;

/// Acts in one request, and their bytes. The server accepts slightly more.
const ACTS_MAX: usize = 1024;
const BATCH_BYTES_MAX: usize = 7 * 1024 * 1024;

/// Bytes of one act. The server accepts slightly more.
const ACT_BYTES_MAX: usize = 240 * 1024;

/// Bytes of an act that the server accepts even for a full journal.
const SMALL_ACT_BYTES_MAX: usize = 1200;

/// The pause before a delayed act is sent again, if the server asks for none.
const PAUSE: Duration = Duration::from_secs(1);

/// Delays of acts in a row without an accepted one: a broken journal would delay them for ever.
const PUT_OFF_MAX: u32 = 12;

/// Pending decisions, for one seat or for several.
pub type Thought<E> = BoxFuture<'static, Result<Vec<SwarmAct>, E>>;

/// A player that decides for seats.
pub trait Swarm {
    /// A reason why it cannot decide.
    type Error: Display + Send + 'static;

    /// True if the decider reads the texts for language models.
    fn reads_prompts(&self) -> bool;

    /// Begins to decide for seats that wait for an act. Each seat and round comes once.
    fn decide(&mut self, looked: Vec<Observation>) -> Vec<Thought<Self::Error>>;

    /// Learns that an act is durable, as it was stored.
    fn acted(&mut self, _act: &SwarmAct) {}

    /// True if a stop waits for decisions in flight, rather than dropping them.
    const WAITS_WHEN_STOPPED: bool = false;

    /// True if an error like this waits for the other decisions in flight, rather than dropping them.
    fn waits_for_others(_error: &Self::Error) -> bool {
        false
    }
}

/// News of seats that are played.
#[derive(Clone, Copy, Debug)]
pub enum Note<'a> {
    /// Seats newly wait for an act; those of one round may come in several notes.
    Looked(&'a [Observation]),
    /// An act is durable.
    Acted(&'a SwarmAct, &'a Receipt),
    /// An act came after the end of its round: the decision was wasted.
    Late(&'a SwarmAct),
}

/// An error that ends playing early.
#[derive(Debug, thiserror::Error)]
pub enum DriveError<E: Display> {
    /// A request to the server failed.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// The server refused an act.
    #[error("the server refused an act of {agent} in round {round}: {detail}")]
    Refused {
        /// The agent.
        agent: String,
        /// The round.
        round: u32,
        /// The reason.
        detail: String,
    },
    /// The player failed.
    #[error("{0}")]
    Swarm(E),
}

/// The end of playing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// All games are over.
    Over,
    /// Playing was stopped.
    Stopped,
}

/// Plays all seats of a swarm token until all games are over, or until `stop`. A stop drops decisions in flight or
/// waits for them, as the swarm says; acts already decided are still sent.
///
/// # Errors
/// See [`DriveError`]. Acts already decided are sent where possible.
pub async fn drive<S: Swarm>(
    client: &Client,
    token: &str,
    swarm: &mut S,
    stop: &CancellationToken,
    note: impl FnMut(Note<'_>),
) -> Result<End, DriveError<S::Error>> {
    Drive::new(client, token, note).play(swarm, stop).await
}

type Looking = BoxFuture<'static, Result<SwarmObsResponse, ClientError>>;
type Sending = BoxFuture<'static, (Vec<SwarmAct>, Result<SwarmActResponse, ClientError>)>;

struct Drive<'a, E: Display, N> {
    client: &'a Client,
    token: &'a str,
    note: N,
    thinking: FuturesUnordered<Thought<E>>,
    /// Acts that wait to be sent again.
    delayed: FuturesUnordered<BoxFuture<'static, Vec<SwarmAct>>>,
    /// The last round for which each seat was asked, by episode and agent. A restarted server sends all waiting
    /// observations again.
    decided: Recent<HashMap<String, u32>>,
    outbox: Vec<SwarmAct>,
    /// Delays in a row without an accepted act.
    put_off: u32,
    halted: Option<DriveError<E>>,
}

impl<'a, E: Display + Send + 'static, N: FnMut(Note<'_>)> Drive<'a, E, N> {
    fn new(client: &'a Client, token: &'a str, note: N) -> Self {
        Self {
            client,
            token,
            note,
            thinking: FuturesUnordered::new(),
            delayed: FuturesUnordered::new(),
            decided: Recent::default(),
            outbox: Vec::new(),
            put_off: 0,
            halted: None,
        }
    }

    async fn play<S: Swarm<Error = E>>(
        &mut self,
        swarm: &mut S,
        stop: &CancellationToken,
    ) -> Result<End, DriveError<E>> {
        let mut cursor: Option<String> = None;
        let mut looking: Option<Looking> = None;
        let mut sending: Option<Sending> = None;
        let mut is_stopping = false;
        loop {
            if sending.is_none() && !self.outbox.is_empty() {
                sending = Some(self.send());
            }
            if is_stopping || self.halted.is_some() {
                looking = None;
                if self.thinking.is_empty() && self.delayed.is_empty() && sending.is_none() {
                    return match self.halted.take() {
                        Some(error) => Err(error),
                        None => Ok(End::Stopped),
                    };
                }
            } else if looking.is_none() && self.thinking.len() < IN_FLIGHT_MAX {
                looking = Some(self.look(cursor.clone(), swarm.reads_prompts()));
            }
            tokio::select! {
                looked = async { looking.as_mut().expect("it is there").await }, if looking.is_some() => {
                    looking = None;
                    match looked {
                        Ok(look) if look.finished => return Ok(End::Over),
                        Ok(look) => {
                            cursor = Some(look.cursor);
                            self.begin(swarm, look.observations);
                        }
                        Err(error) => self.halt(DriveError::Client(error), true),
                    }
                }
                Some(thought) = self.thinking.next() => match thought {
                    Ok(acts) => self.outbox.extend(acts),
                    Err(error) => {
                        let waits = S::waits_for_others(&error);
                        self.halt(DriveError::Swarm(error), waits);
                    }
                },
                Some(acts) = self.delayed.next() => self.outbox.extend(acts),
                (acts, sent) = async { sending.as_mut().expect("it is there").await }, if sending.is_some() => {
                    sending = None;
                    match sent {
                        Ok(done) => self.receive(acts, done.receipts, |act| swarm.acted(act)),
                        Err(error) => {
                            // No act can be sent any more.
                            self.outbox.clear();
                            self.delayed.clear();
                            self.halt(DriveError::Client(error), false);
                        }
                    }
                }
                () = stop.cancelled(), if !is_stopping => {
                    is_stopping = true;
                    if !S::WAITS_WHEN_STOPPED {
                        self.thinking.clear();
                    }
                }
            }
        }
    }

    /// Keeps the first error.
    fn halt(&mut self, error: DriveError<E>, waits_for_others: bool) {
        if !waits_for_others {
            self.thinking.clear();
        }
        self.halted.get_or_insert(error);
    }

    fn look(&self, after: Option<String>, prompt: bool) -> Looking {
        let (client, token) = (self.client.clone(), self.token.to_owned());
        Box::pin(async move {
            client.swarm_obs(&token, after.as_deref(), WAIT_S, LOOK_MAX, prompt).await
        })
    }

    fn begin<S: Swarm<Error = E>>(&mut self, swarm: &mut S, mut looked: Vec<Observation>) {
        looked.retain(|seen| {
            let sight = &seen.sight;
            let decided = self.decided.of(&sight.episode, HashMap::new);
            decided.insert(sight.agent.clone(), sight.round).is_none_or(|round| round < sight.round)
        });
        (self.note)(Note::Looked(&looked));
        self.thinking.extend(swarm.decide(looked));
    }

    /// Sends decided acts, as many as one request holds.
    fn send(&mut self) -> Sending {
        let mut bytes = 0;
        let mut count = 0;
        for act in &mut self.outbox {
            bytes += fit(act, ACT_BYTES_MAX);
            if count > 0 && (bytes > BATCH_BYTES_MAX || count == ACTS_MAX) {
                break;
            }
            count += 1;
        }
        let rest = self.outbox.split_off(count);
        let acts = std::mem::replace(&mut self.outbox, rest);
        let (client, token) = (self.client.clone(), self.token.to_owned());
        Box::pin(async move {
            let sent = client.swarm_act(&token, acts.clone()).await;
            (acts, sent)
        })
    }

    fn receive(
        &mut self,
        acts: Vec<SwarmAct>,
        receipts: Vec<SwarmReceipt>,
        mut acted: impl FnMut(&SwarmAct),
    ) {
        let mut again = Vec::new();
        let mut pause = Duration::ZERO;
        for (mut act, receipt) in acts.into_iter().zip(receipts) {
            let problem = match receipt {
                SwarmReceipt::Receipt(receipt) => {
                    self.put_off = 0;
                    acted(&act);
                    (self.note)(Note::Acted(&act, &receipt));
                    continue;
                }
                SwarmReceipt::Problem(problem) => problem,
            };
            match Refusal::of(&problem) {
                // The round's clock may have run out, or somebody aborted the episode.
                Refusal::TooLate => (self.note)(Note::Late(&act)),
                Refusal::JournalFull if fit(&mut act, usize::MAX) > SMALL_ACT_BYTES_MAX => {
                    // The decision has the little room that there is, and the notes are forgotten.
                    act.harness = None;
                    fit(&mut act, SMALL_ACT_BYTES_MAX);
                    again.push(act);
                }
                Refusal::ComeAgain if self.put_off < PUT_OFF_MAX => {
                    pause = pause.max(problem.retry_after_ms.map_or(PAUSE, Duration::from_millis));
                    again.push(act);
                }
                Refusal::ComeAgain | Refusal::JournalFull | Refusal::Wrong => {
                    let SwarmAct { agent, round, .. } = act;
                    let refused = DriveError::Refused { agent, round, detail: problem.detail };
                    self.halt(refused, false);
                }
            }
        }
        if !again.is_empty() {
            self.put_off += u32::from(!pause.is_zero());
            self.delayed.push(Box::pin(async move {
                SystemClock.sleep_until(after(SystemClock.now(), pause)).await;
                again
            }));
        }
    }
}

/// Reactions to an act that the server refused.
enum Refusal {
    TooLate,
    JournalFull,
    ComeAgain,
    Wrong,
}

impl Refusal {
    fn of(problem: &Problem) -> Self {
        let limit = problem.limit.as_ref().map_or("", |limit| &limit.name);
        match problem.code.as_str() {
            "round_over" | "episode_over" => Self::TooLate,
            _ if limit.starts_with("journal_bytes_per_") => Self::JournalFull,
            "rate_limited" | "overloaded" | "unavailable" => Self::ComeAgain,
            _ => Self::Wrong,
        }
    }
}

/// Cuts the texts of an act to at most `most` bytes of JSON; returns the bytes of the result. The reasoning is cut
/// first, then what the harness added, then the beginning of the answer: prompts ask for the decision at the end. Notes are short,
/// and stay.
fn fit(act: &mut SwarmAct, most: usize) -> usize {
    loop {
        let bytes = serde_json::to_vec(act).map_or(0, |json| json.len());
        let over = bytes.saturating_sub(most);
        if over == 0 {
            return bytes;
        }
        if let Some(text) = act.reasoning.as_mut().filter(|text| !text.is_empty()) {
            shorten(text, over);
        } else if act.harness.as_mut().is_some_and(|harness| harness.shorten()) {
        } else if let Some(text) = act.response.as_mut().filter(|text| !text.is_empty()) {
            shorten(text, over);
        } else {
            return bytes;
        }
    }
}

/// Cuts the beginning of a text that is `over` bytes of JSON too long, or some of it: a control character takes six bytes of JSON.
fn shorten(text: &mut String, over: usize) {
    let from = text.ceil_char_boundary(over.div_ceil(6).max(over.min(text.len()) / 2));
    text.drain(..from);
}

#[cfg(test)]
mod tests {
    use swarmbench_protocol::act::Harness;

    use super::*;

    fn refused(code: &str) -> SwarmReceipt {
        let problem = serde_json::json!({
            "type": "about:blank", "title": "", "status": 503, "detail": "not now", "code": code, "retry_after_ms": 1,
        });
        SwarmReceipt::Problem(serde_json::from_value(problem).expect("a problem"))
    }

    #[test]
    fn an_act_that_cannot_be_taken_now_is_sent_again_but_not_for_ever() {
        let client = Client::new("http://127.0.0.1:9").expect("an address");
        let act =
            || vec![SwarmAct { response: Some("ACTION: UP".to_owned()), ..SwarmAct::default() }];
        for code in ["rate_limited", "overloaded", "unavailable"] {
            let mut drive: Drive<'_, String, _> = Drive::new(&client, "", |_: Note<'_>| {});
            for tries in 1..=PUT_OFF_MAX {
                drive.receive(act(), vec![refused(code)], |_| {});
                assert_eq!(drive.delayed.len(), tries as usize, "{code}");
                assert!(drive.halted.is_none(), "{code}");
            }
            drive.receive(act(), vec![refused(code)], |_| {});
            assert!(matches!(drive.halted, Some(DriveError::Refused { .. })), "{code}");
        }
    }

    #[test]
    fn long_texts_are_cut_and_the_end_of_an_answer_stays() {
        for filler in ["x", "ä", "\u{1}"] {
            let text = filler.repeat(300_000) + "\nACTION: UP";
            let mut act = SwarmAct {
                response: Some(text.clone()),
                reasoning: Some(text),
                ..SwarmAct::default()
            };
            act.harness = Some(Box::new(Harness {
                added: Some("x".repeat(9_000)),
                scratchpad: Some("notes".to_owned()),
                ..Harness::default()
            }));
            let bytes = fit(&mut act, ACT_BYTES_MAX);
            let kept = act.harness.take().expect("a harness");
            assert_eq!((kept.added, kept.scratchpad.as_deref()), (None, Some("notes")));
            assert!((ACT_BYTES_MAX / 3..=ACT_BYTES_MAX).contains(&bytes), "{filler:?} {bytes}");
            assert_eq!(act.reasoning.as_deref(), Some(""));
            assert!(act.response.is_some_and(|text| text.ends_with("ACTION: UP")));
        }
        let mut short = SwarmAct { response: Some("ACTION: UP".to_owned()), ..SwarmAct::default() };
        let before = short.response.clone();
        fit(&mut short, ACT_BYTES_MAX);
        assert_eq!(short.response, before);
    }
}

//! Plays a game to its end in memory, or makes its end up, and returns the entries that a server would have written.

use std::sync::Arc;
use std::time::Duration;

use jiff::Timestamp;
use swarmbench::episode::spec::Spec;
use swarmbench::ids::{EpisodeId, EpisodeKey, RunKey, Token, TokenKind};
use swarmbench::keys::OwnerKey;
use swarmbench::store::entries::{ActRow, EndRow, Entry, OpeningRow, RoundRow, TokenRow};
use swarmbench_clock::{Entropy, after};
use swarmbench_engine::{Act, Action, Message, World};
use swarmbench_journal::Tally;
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::{Decision, End, RawRecord, end_record, round_record};

/// Time between two rounds of a game.
const ROUND: Duration = Duration::from_millis(400);

/// Every so many acts, one has a message on average.
const MESSAGES_ONE_IN: u8 = 4;

/// A game to be played, with its keys in the database.
pub(crate) struct NewGame {
    pub(crate) episode: EpisodeKey,
    pub(crate) owner: Option<OwnerKey>,
    pub(crate) run: Option<(RunKey, u32)>,
    pub(crate) spec: Spec,
    /// Time of creation.
    pub(crate) at: Timestamp,
}

impl NewGame {
    fn opening(self, entropy: &dyn Entropy) -> (World, OpeningRow) {
        let Self { episode, owner, run, spec, at } = self;
        let world = World::new(Arc::clone(&spec.config));
        let id = EpisodeId::new(at, entropy);
        let record = RawRecord::write(&spec.opening(&id, at, &world));
        let head = Head::START.link(record.as_str().as_bytes());
        let row = OpeningRow {
            episode,
            id,
            owner,
            run,
            fork: None,
            record,
            head,
            task: spec.config.task().name(),
            model: spec.model.clone(),
            visibility: spec.visibility.name(),
            waiting: false,
            is_mixed: false,
            has_people: false,
            own_games: false,
            clocked: spec.advances_by_itself(),
            at,
            idempotency: None,
            tokens: if run.is_some() { Vec::new() } else { tokens(&spec, entropy) },
        };
        (world, row)
    }

    /// Opening and end of a game without acts and rounds, with a score that is made up.
    pub(crate) fn ended(self, entropy: &dyn Entropy, score: f64) -> [Entry; 2] {
        let (episode, at, counts) = (self.episode, self.at, self.spec.counts());
        let (world, opening) = self.opening(entropy);
        let (reason, rounds) = ("rounds_played", world.config().max_round());
        let (record, head) = last(opening.head, reason, score, rounds);
        let end = EndRow {
            episode,
            status: "finished",
            reason,
            head,
            record,
            bytes: 0,
            score,
            rounds,
            seed: world.config().seed(),
            tally: Tally { acts: 1200, invalid: 12, ..Tally::default() },
            counts,
            at,
        };
        [Entry::Open(Box::new(opening)), Entry::End(end)]
    }

    /// Plays the game with random acts. Acts, ids and tokens follow from the entropy.
    pub(super) fn play(self, entropy: &dyn Entropy) -> Vec<Entry> {
        let (episode, at, counts) = (self.episode, self.at, self.spec.counts());
        let mut draws = Draws::new(entropy);
        let (mut world, opening) = self.opening(entropy);
        let mut head = opening.head;
        let mut entries = vec![Entry::Open(Box::new(opening))];
        let (mut tally, mut bytes, mut now) = (Tally::default(), 0, at);
        while !world.is_over() {
            let round = world.round();
            now = after(now, ROUND);
            let mut acts = vec![Act::default(); world.config().num_agents().into()];
            let living: Vec<_> = world.agents().filter(|agent| world.is_alive(*agent)).collect();
            let mut records = Vec::with_capacity(living.len());
            for (waiting_for, &agent) in (0..living.len()).rev().zip(&living) {
                let act = draws.act(&world);
                let decision = Decision::of_player(act.clone()).record(agent, 0);
                let source = decision.source;
                tally.add(&decision);
                let record = RawRecord::write(&decision);
                bytes += record.as_str().len() as u64;
                acts[agent.index()] = act;
                records.push(record.clone());
                let waiting_for = u32::try_from(waiting_for).expect("agents are few");
                entries.push(Entry::Act(ActRow {
                    episode,
                    round,
                    agent,
                    waiting_for,
                    source,
                    at: now,
                    record,
                    brief: None,
                }));
            }
            world.step(&acts);
            let (digest, score) = (world.digest(), world.score());
            let record = round_record(round, records.iter(), &digest.to_string(), score);
            head = head.link(record.as_str().as_bytes());
            entries.push(Entry::Round(RoundRow {
                episode,
                round,
                digest: digest.0,
                score,
                head,
                at: now,
            }));
        }
        let reason = if world.is_done() { "task_done" } else { "rounds_played" };
        let (score, rounds) = (world.score(), world.round());
        let (record, head) = last(head, reason, score, rounds);
        entries.push(Entry::End(EndRow {
            episode,
            status: "finished",
            reason,
            head,
            record,
            bytes,
            score,
            rounds,
            seed: world.config().seed(),
            tally,
            counts,
            at: now,
        }));
        entries
    }
}

/// The last record of a game, and the head of its journal after it.
fn last(head: Head, reason: &str, score: f64, rounds: u32) -> (RawRecord, Head) {
    let record = end_record(End {
        status: "finished".to_owned(),
        reason: reason.to_owned(),
        rounds,
        score,
        open_acts: Vec::new(),
    });
    let head = head.link(record.as_str().as_bytes());
    (record, head)
}

/// Tokens of an episode's creator: one for each seat, and one for all seats.
fn tokens(spec: &Spec, entropy: &dyn Entropy) -> Vec<TokenRow> {
    let token =
        |agent, kind| TokenRow { hash: Token::new(kind, entropy).hash(), agent, holder: None };
    let seats = spec.agents().map(|agent| token(Some(agent), TokenKind::Seat));
    seats.chain([token(None, TokenKind::Swarm)]).collect()
}

/// Buffered random bytes.
struct Draws<'a> {
    entropy: &'a dyn Entropy,
    bytes: [u8; 32],
    used: usize,
}

impl<'a> Draws<'a> {
    fn new(entropy: &'a dyn Entropy) -> Self {
        Self { entropy, bytes: [0; 32], used: 32 }
    }

    fn byte(&mut self) -> u8 {
        if self.used == self.bytes.len() {
            self.entropy.fill(&mut self.bytes);
            self.used = 0;
        }
        self.used += 1;
        self.bytes[self.used - 1]
    }

    /// A random act of the task, sometimes with a message.
    fn act(&mut self, world: &World) -> Act {
        let actions = Action::of_task(world.config().task());
        let act = Act::of(actions[usize::from(self.byte()) % actions.len()]);
        if !self.byte().is_multiple_of(MESSAGES_ONE_IN) {
            return act;
        }
        let text = format!("round {}: I take place {}", world.round(), self.byte());
        Act { message: Message::new(&text), ..act }
    }
}

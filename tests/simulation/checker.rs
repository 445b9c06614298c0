//! What must hold, whatever happens. The checker plays every episode again from what is durable, by
//! the rules and with the engine alone, and compares that with all that the server hands over, shows
//! and answers.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use jiff::Timestamp;
use swarmbench::clock::{after, millis, until};
use swarmbench::episode::actor::{ActError, ClaimError, Claimed, StartError};
use swarmbench::episode::lockstep::{Receipt, RecordedAct, Refusal, Submission};
use swarmbench::episode::quota::{ACT_BYTES_ALWAYS, Full};
use swarmbench::episode::recovery::RecoveryError;
use swarmbench::episode::registry::CreateError;
use swarmbench::episode::seating::SeatTaken;
use swarmbench::episode::spec::Spec;
use swarmbench::episode::{Ending, Snapshot, Status};
use swarmbench::hosted;
use swarmbench::ids::{EpisodeId, EpisodeKey};
use swarmbench::journal::chain::Head;
use swarmbench::journal::record::{ActRecord, RawRecord, Record, Source, round_record};
use swarmbench::journal::replay::{acts_of, living, verify};
use swarmbench::keys::OwnerKey;
use swarmbench::store::StoreError;
use swarmbench::store::entries::{
    ActRow, ClaimRow, EndRow, Entry, OpeningRow, RoundRow, SeatingRow,
};
use swarmbench_engine::physics::Solver;
use swarmbench_engine::{AgentId, World};

use crate::clients::{Acts, Answer, Request, RequestId};
use crate::journal::{JobResult, Lost};

/// What must hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Invariant {
    /// What was acknowledged or shown is on the disk, and nobody sees an episode go back.
    Durable,
    /// One act a seat and round, one resolution a round, one end, and nothing after it.
    OneAct,
    /// The same act gets the same receipt, another act never does.
    StableReceipts,
    /// A refusal is true.
    TrueRefusals,
    /// A round is resolved when all living seats have acted, and counts down to that.
    Barrier,
    /// Journals play again; what is shown is what they say.
    Replay,
    /// A seat has its whole time and no more.
    Clocks,
    /// After a failed commit nothing is acknowledged before a restart.
    NoFalseAck,
    /// Where clients act or time passes, every episode ends and every request is answered.
    Progress,
    /// An episode is abandoned after its idle time, not before.
    Idle,
    /// No round begins after the time at which an episode closes, and the one that runs then may end.
    Closing,
    /// What is counted against a cap is there, and is given back.
    Quotas,
    /// A seat has one holder; an episode starts once, when all have one; the server plays its seats as
    /// if it had never fallen over.
    Seats,
}

/// Something that does not hold.
#[derive(Clone, Debug)]
pub(crate) struct Violation {
    pub(crate) invariant: Invariant,
    pub(crate) what: String,
}

/// How often something happened.
#[derive(Clone, Debug, Default)]
pub(crate) struct Stats(pub(crate) BTreeMap<&'static str, u64>);

impl Stats {
    pub(crate) fn count(&mut self, what: &'static str, times: usize) {
        *self.0.entry(what).or_default() += times as u64;
    }
}

/// All that is known of a run.
pub(crate) struct Checker {
    pub(crate) now: Timestamp,
    pub(crate) stats: Stats,
    pub(crate) violations: Vec<Violation>,
    pub(crate) episodes: BTreeMap<EpisodeKey, Episode>,
    keys: BTreeMap<EpisodeId, EpisodeKey>,
    /// Counts what happens, to tell what was first.
    moment: u64,
    /// When this run of the server began.
    started_at: Timestamp,
    /// When it was first told that a commit failed.
    failed: Option<u64>,
    /// Episodes of which a job was refused in this run of the server.
    refused: BTreeSet<EpisodeId>,
    /// Requests that are not answered.
    requests: BTreeMap<RequestId, Sent>,
    /// Episodes that are asked for, not durable and not refused.
    creating: BTreeMap<EpisodeId, Option<OwnerKey>>,
    /// What the server handed over, by seat: when.
    handed: BTreeMap<Place, u64>,
    /// Acts of clients that went away; they lie in a mailbox all the same.
    orphans: Vec<(EpisodeId, Arrived)>,
    /// Receipts that were given out.
    acked: BTreeMap<Place, Acked>,
}

/// A seat in a round of an episode.
type Place = (EpisodeKey, u32, AgentId);

/// A request on its way.
struct Sent {
    id: EpisodeId,
    moment: u64,
    arrived: Option<Arrived>,
    /// How many places of episodes were taken since then, at most: in all, and of the key.
    held: (usize, usize),
}

/// Acts that lie in a mailbox.
struct Arrived {
    at: Timestamp,
    moment: u64,
    acts: Acts,
}

/// A receipt that was given out first at some moment.
struct Acked {
    recorded: RecordedAct,
    moment: u64,
    was_first: bool,
}

/// An episode as it is on the disk.
pub(crate) struct Episode {
    pub(crate) id: EpisodeId,
    pub(crate) spec: Spec,
    pub(crate) world: World,
    pub(crate) waiting: bool,
    pub(crate) end: Option<(Ending, Head)>,
    owner: Option<OwnerKey>,
    /// By agent, the number of its holder; everything is the creator's where nobody claims.
    holders: Vec<Option<u32>>,
    /// The seats that the server plays, once they have a holder.
    hosted: Vec<(AgentId, String)>,
    /// The players of them, shown everything so far.
    players: Option<hosted::Players>,
    /// The head after the opening.
    opening_head: Head,
    seated: bool,
    /// The head after each round.
    heads: Vec<Head>,
    digests: Vec<[u8; 32]>,
    /// What is left of the banks before each round.
    banks: Vec<Vec<Duration>>,
    /// What was done in each round, the open one too.
    acts: Vec<BTreeMap<AgentId, Kept>>,
    last_act_at: Timestamp,
    created_at: Timestamp,
    /// When the open round began: with the creation, the start, or the end of the round before.
    began_at: Timestamp,
    /// The journal as a file.
    lines: String,
    /// Which round was published in this run of the server, and when.
    opened: Option<(u32, Timestamp, u64)>,
    /// The round that was open when a job was refused: it is opened again when the episode is recovered, and some may
    /// still look at it as it was before.
    reopened: Option<u32>,
    /// Whether the server knows of the end.
    end_told: bool,
    /// The furthest that anybody saw, and at which moment first.
    seen: (u32, bool),
    seen_first: u64,
}

/// A durable act.
struct Kept {
    record: ActRecord,
    raw: RawRecord,
    waiting_for: u32,
}

impl Kept {
    fn by_player(&self) -> bool {
        self.record.source == Source::Player
    }
}

impl Episode {
    fn round(&self) -> u32 {
        self.world.round()
    }

    fn act(&self, round: u32, agent: AgentId) -> Option<&Kept> {
        self.acts.get(round as usize)?.get(&agent)
    }

    /// Whether the server plays this seat.
    fn is_hosted(&self, agent: AgentId) -> bool {
        self.hosted.iter().any(|(hosted, _)| *hosted == agent)
    }

    /// Whether a client holds this seat. Nobody else has a token of it.
    pub(crate) fn is_clients(&self, agent: AgentId) -> bool {
        self.holders[agent.index()].is_some() && !self.is_hosted(agent)
    }

    /// How many seats nobody holds.
    pub(crate) fn count_open(&self) -> u16 {
        let open = self.holders.iter().filter(|holder| holder.is_none()).count();
        u16::try_from(open).expect("few")
    }

    fn bank(&self, agent: AgentId) -> Duration {
        self.banks[self.banks.len() - 1][agent.index()]
    }

    fn idle_at(&self) -> Timestamp {
        after(self.last_act_at, self.spec.idle_timeout)
    }

    /// Whether no round may begin at this time.
    fn is_closed(&self, at: Timestamp) -> bool {
        self.spec.closes_at.is_some_and(|closes_at| closes_at <= at)
    }
}

/// Whether the wire contract calls two acts of a seat and round the same.
fn same(one: &ActRecord, other: &ActRecord) -> bool {
    let told = |record: &ActRecord| {
        let ActRecord { action, message, to, response, .. } = record.clone();
        (action, message, to, response)
    };
    told(one) == told(other)
}

impl Checker {
    pub(crate) fn new(now: Timestamp) -> Self {
        Self {
            now,
            stats: Stats::default(),
            violations: Vec::new(),
            episodes: BTreeMap::new(),
            keys: BTreeMap::new(),
            moment: 0,
            started_at: now,
            failed: None,
            refused: BTreeSet::new(),
            requests: BTreeMap::new(),
            creating: BTreeMap::new(),
            handed: BTreeMap::new(),
            orphans: Vec::new(),
            acked: BTreeMap::new(),
        }
    }

    pub(crate) fn check(
        &mut self,
        invariant: Invariant,
        holds: bool,
        what: impl FnOnce() -> String,
    ) {
        if !holds {
            self.violations.push(Violation { invariant, what: what() });
        }
    }

    fn broken(&mut self, invariant: Invariant, what: String) {
        self.check(invariant, false, || what);
    }

    fn next_moment(&mut self) -> u64 {
        self.moment += 1;
        self.moment
    }

    pub(crate) fn episode(&self, id: &EpisodeId) -> Option<&Episode> {
        self.episodes.get(self.keys.get(id)?)
    }

    /// For which episode a request is that is not answered.
    pub(crate) fn id_of(&self, number: RequestId) -> Option<EpisodeId> {
        self.requests.get(&number).map(|sent| sent.id.clone())
    }

    // ---- what the server hands to the journal

    /// A job was handed over: what is in it was decided now.
    pub(crate) fn handed(&mut self, entries: &[Entry]) {
        let moment = self.next_moment();
        for entry in entries {
            if let Entry::Act(row) = entry {
                self.clock_of(row);
                self.handed.entry((row.episode, row.round, row.agent)).or_insert(moment);
            }
        }
    }

    /// Clocks: an act in time, a default in time, and what both take from the bank.
    fn clock_of(&mut self, row: &ActRow) {
        let Some(episode) = self.episodes.get(&row.episode) else { return };
        let Some(round_deadline) = episode.spec.round_deadline else { return };
        let Ok(record) = row.record.read::<ActRecord>() else { return };
        if episode.is_hosted(row.agent) && record.source == Source::Player {
            // The server sent it to itself.
            return;
        }
        let (now, started_at, bank) = (self.now, self.started_at, episode.bank(row.agent));
        let opened = episode.opened.filter(|(round, ..)| *round == row.round);
        let name = format!("{} {} in round {}", episode.id, row.agent, row.round);
        if record.source == Source::Clock {
            // Where nobody has seen when it was opened, it was not before this server began.
            let (opened_at, seen) = opened.map_or((started_at, None), |(_, at, m)| (at, Some(m)));
            let deadline = after(opened_at, round_deadline + bank);
            self.check(Invariant::Clocks, now >= deadline, || {
                format!("{name}: its clock ran out at {now}, its deadline is {deadline}")
            });
            let spent = record.bank_spent_ms;
            self.check(Invariant::Clocks, spent == millis(bank), || {
                format!("{name}: a clock that ran out took {spent} ms of {bank:?}")
            });
            if let Some(seen) = seen {
                let in_time = self.carried(row).find(|arrived| {
                    arrived.moment > seen && arrived.at <= deadline && fits(arrived, row)
                });
                if let Some(arrived) = in_time {
                    let at = arrived.at;
                    self.broken(
                        Invariant::Clocks,
                        format!(
                            "{name}: its clock ran out at {deadline}, its act had come at {at}"
                        ),
                    );
                }
            }
            return;
        }
        let mut arrivals = self.carried(row).peekable();
        if arrivals.peek().is_none() {
            drop(arrivals);
            return self.broken(Invariant::OneAct, format!("{name}: nobody sent its act"));
        }
        let spent_by = |at: Timestamp| match opened {
            Some((_, opened_at, _)) => {
                millis(until(after(opened_at, round_deadline), at).min(bank))
            }
            None => 0,
        };
        let is_late = |at: Timestamp| {
            opened.is_some_and(|(_, opened_at, _)| at > after(opened_at, round_deadline + bank))
        };
        // After a restart nobody may have seen yet when the round was opened anew.
        let is_known = opened.is_some();
        let fits = arrivals.any(|arrived| {
            !is_known || (!is_late(arrived.at) && spent_by(arrived.at) == record.bank_spent_ms)
        });
        drop(arrivals);
        let (spent, at) = (record.bank_spent_ms, row.at);
        self.check(Invariant::Clocks, fits, || {
            format!(
                "{name}: taken at {at} (now {now}) for {spent} ms of {bank:?}; {opened:?} was opened"
            )
        });
    }

    /// The arrivals of acts for this seat and round that are not answered.
    fn carried<'a>(&'a self, row: &'a ActRow) -> impl Iterator<Item = &'a Arrived> {
        let id = self.episodes.get(&row.episode).map(|episode| &episode.id);
        let waiting = self.requests.values().map(|sent| (&sent.id, sent.arrived.as_ref()));
        let orphans = self.orphans.iter().map(|(id, arrived)| (id, Some(arrived)));
        let of_it = waiting.chain(orphans).filter(move |(of, _)| Some(*of) == id);
        of_it.filter_map(|(_, arrived)| arrived).filter(|arrived| {
            let mut acts = arrived.acts.iter();
            acts.any(|(agent, act)| *agent == row.agent && act.round == row.round)
        })
    }

    // ---- what becomes durable

    /// Entries became durable, all at once.
    pub(crate) fn durable(&mut self, entries: &[Entry]) {
        self.next_moment();
        for entry in entries {
            match entry {
                Entry::Open(row) => self.open(row),
                Entry::Start { episode, at } => {
                    if let Some(episode) = self.episodes.get_mut(episode) {
                        let (was_waiting, id) = (episode.waiting, episode.id.clone());
                        episode.waiting = false;
                        episode.last_act_at = *at;
                        let seated = episode.seated || !episode.spec.is_seated();
                        episode.began_at = *at;
                        let is_open = !episode.is_closed(*at);
                        self.check(Invariant::Closing, is_open, || format!("{id}: a late start"));
                        self.check(Invariant::OneAct, was_waiting, || format!("{id}: two starts"));
                        self.check(Invariant::Seats, seated, || format!("{id}: started too early"));
                    }
                }
                Entry::Claim(row) => self.claim(row),
                Entry::Seat(row) => self.seat(row),
                Entry::Act(row) => self.act(row),
                Entry::Round(row) => self.round(row),
                Entry::End(row) => self.end(row),
                // Tokens, keys and runs: nothing of an episode.
                _ => {}
            }
        }
    }

    fn open(&mut self, row: &OpeningRow) {
        if self.keys.contains_key(&row.id) || self.episodes.contains_key(&row.episode) {
            return self.broken(Invariant::OneAct, format!("{}: two openings", row.id));
        }
        let Ok(Record::Opening(opening)) = row.record.read() else {
            return self.broken(Invariant::Replay, format!("{}: no opening", row.id));
        };
        let spec = match Spec::from_opening(&opening) {
            Ok(spec) => spec,
            Err(problem) => {
                return self.broken(Invariant::Replay, format!("{}: {problem}", row.id));
            }
        };
        let world = World::new(Arc::clone(&spec.config));
        let head = Head::START.link(row.record.as_str().as_bytes());
        self.check(Invariant::Replay, head == row.head, || format!("{}: another head", row.id));
        let episode = Episode {
            id: row.id.clone(),
            waiting: row.waiting,
            end: None,
            owner: row.owner,
            holders: (spec.agents())
                .map(|agent| (!spec.open_seats.contains(&agent)).then_some(0))
                .collect(),
            hosted: match &spec.player {
                Some(player) => (spec.agents().filter(|agent| !spec.open_seats.contains(agent)))
                    .map(|agent| (agent, player.clone()))
                    .collect(),
                None => Vec::new(),
            },
            players: None,
            opening_head: head,
            seated: false,
            heads: vec![head],
            digests: vec![world.digest().0],
            banks: vec![vec![spec.bank; usize::from(spec.config.num_agents())]],
            acts: vec![BTreeMap::new()],
            last_act_at: row.at,
            created_at: row.at,
            began_at: row.at,
            lines: row.record.line(head),
            opened: None,
            reopened: None,
            end_told: false,
            seen: (0, false),
            seen_first: 0,
            world,
            spec,
        };
        self.stats.count("episodes", 1);
        self.creating.remove(&row.id);
        self.keys.insert(row.id.clone(), row.episode);
        self.episodes.insert(row.episode, episode);
    }

    fn claim(&mut self, row: &ClaimRow) {
        let Some(episode) = self.episodes.get_mut(&row.episode) else { return };
        let name = format!("{}: claim {}", episode.id, row.holder.number);
        let mut wrong = Vec::new();
        if row.holder.number == 0 {
            let own: Vec<AgentId> = (episode.world.agents())
                .filter(|agent| episode.spec.is_mixed() && !episode.spec.open_seats.contains(agent))
                .collect();
            if own != row.agents || row.holder.player != episode.spec.player {
                wrong.push(format!("{name} is not the creator's"));
            }
        } else {
            if episode.seated || !episode.waiting || episode.end.is_some() {
                wrong.push(format!("{name} comes after the start"));
            }
            for agent in &row.agents {
                if episode.holders[agent.index()].replace(row.holder.number).is_some() {
                    wrong.push(format!("{name}: {agent} had a holder"));
                }
                if let Some(player) = &row.holder.player {
                    episode.hosted.push((*agent, player.clone()));
                }
            }
            match (&row.holder.player, episode.spec.fill_after) {
                (None, _) => self.stats.count("seats claimed", row.agents.len()),
                (Some(_), Some(time)) => {
                    self.stats.count("seats filled", row.agents.len());
                    if row.holder.at < after(episode.created_at, time) {
                        wrong.push(format!("{name} fills seats too early"));
                    }
                }
                (Some(_), None) => wrong.push(format!("{name} is of nobody")),
            }
        }
        for what in wrong {
            self.broken(Invariant::Seats, what);
        }
    }

    fn seat(&mut self, row: &SeatingRow) {
        let Some(episode) = self.episodes.get_mut(&row.episode) else { return };
        let name = format!("{}: who holds which seat", episode.id);
        let mut wrong = Vec::new();
        if std::mem::replace(&mut episode.seated, true) || episode.world.round() > 0 {
            wrong.push((Invariant::Seats, format!("{name} is told twice, or too late")));
        }
        let told = match row.record.read() {
            Ok(Record::Seats(told)) => told.seats.iter().map(|seat| Some(seat.holder)).collect(),
            _ => Vec::new(),
        };
        if told != episode.holders || told.contains(&None) {
            let holders = &episode.holders;
            wrong.push((Invariant::Seats, format!("{name}: {told:?}, it is {holders:?}")));
        }
        let head = episode.opening_head.link(row.record.as_str().as_bytes());
        if head != row.head {
            wrong.push((Invariant::Replay, format!("{name}: another head")));
        }
        episode.heads[0] = head;
        episode.lines.push_str(&row.record.line(head));
        for (invariant, what) in wrong {
            self.broken(invariant, what);
        }
    }

    fn act(&mut self, row: &ActRow) {
        let Some(episode) = self.episodes.get_mut(&row.episode) else { return };
        let mut wrong: Vec<(Invariant, String)> = Vec::new();
        let name = format!("{}: the act of {} in round {}", episode.id, row.agent, row.round);
        let open = episode.world.round();
        if episode.end.is_some() || row.round != open {
            wrong
                .push((Invariant::OneAct, format!("{name} came in round {open} or after the end")));
        }
        if episode.waiting || !episode.world.is_alive(row.agent) {
            wrong.push((Invariant::Barrier, format!("{name} came before the start or of nobody")));
        }
        let Ok(record) = row.record.read::<ActRecord>() else {
            return self.broken(Invariant::Replay, format!("{name} cannot be read"));
        };
        let by_player = record.source == Source::Player;
        let kept = Kept { record, raw: row.record.clone(), waiting_for: row.waiting_for };
        if kept.record.agent != row.agent.to_string() {
            wrong.push((Invariant::Replay, format!("{name} has another name")));
        }
        if let Some(acts) = episode.acts.get_mut(row.round as usize) {
            if acts.insert(row.agent, kept).is_some() {
                wrong.push((Invariant::OneAct, format!("{name} is the second")));
            }
            let left = living(&episode.world).count().saturating_sub(acts.len());
            if row.round == open && row.waiting_for as usize != left {
                let told = row.waiting_for;
                wrong.push((Invariant::Barrier, format!("{name}: {told} to come, it is {left}")));
            }
        }
        if by_player {
            let idle_at = episode.idle_at();
            if row.at > idle_at {
                let at = row.at;
                wrong.push((Invariant::Idle, format!("{name} came at {at}, idle at {idle_at}")));
            }
            episode.last_act_at = row.at.max(episode.last_act_at);
        } else {
            self.stats.count("clocks run out", 1);
        }
        for (invariant, what) in wrong {
            self.broken(invariant, what);
        }
    }

    fn round(&mut self, row: &RoundRow) {
        let Some(episode) = self.episodes.get_mut(&row.episode) else { return };
        let mut wrong: Vec<(Invariant, String)> = Vec::new();
        let name = format!("{}: round {}", episode.id, row.round);
        if episode.end.is_some() || row.round != episode.world.round() || episode.world.is_over() {
            let open = episode.world.round();
            return self.broken(Invariant::OneAct, format!("{name} is resolved in round {open}"));
        }
        if episode.is_closed(episode.began_at) {
            let began_at = episode.began_at;
            wrong.push((Invariant::Closing, format!("{name} is played, it began at {began_at}")));
        } else if episode.is_closed(row.at) {
            self.stats.count("rounds over the closing time", 1);
        }
        episode.began_at = row.at;
        let recorded = &episode.acts[row.round as usize];
        let missing: Vec<_> =
            living(&episode.world).filter(|agent| !recorded.contains_key(agent)).collect();
        if !missing.is_empty() {
            wrong.push((Invariant::Barrier, format!("{name} is resolved without {missing:?}")));
        }
        // What the server's players do follows from what they were shown, whatever happened to it.
        let players = episode.players.get_or_insert_with(|| {
            episode.hosted.sort_unstable();
            hosted::Players::new(&episode.spec, &episode.hosted).expect("players that are built in")
        });
        for (agent, decided) in players.decide(&episode.world) {
            let kept = recorded.get(&agent).filter(|kept| kept.by_player());
            self.stats.count("acts of the server", usize::from(kept.is_some()));
            if kept.is_some_and(|kept| !same(&kept.record, &decided.record)) {
                wrong.push((Invariant::Seats, format!("{name}: {agent} forgot something")));
            }
        }
        let mut banks = episode.banks[row.round as usize].clone();
        for (agent, kept) in recorded {
            let spent = Duration::from_millis(kept.record.bank_spent_ms);
            match banks[agent.index()].checked_sub(spent) {
                Some(left) => banks[agent.index()] = left,
                None => wrong.push((Invariant::Clocks, format!("{name}: {agent} overspent"))),
            }
        }
        match acts_of(&episode.spec.config, recorded.values().map(|kept| &kept.record)) {
            Ok(acts) => episode.world.step(&acts),
            Err(problem) => return self.broken(Invariant::Replay, format!("{name}: {problem}")),
        }
        let (digest, score) = (episode.world.digest(), episode.world.score());
        let raw = recorded.values().map(|kept| &kept.raw);
        let record = round_record(row.round, raw, &digest.to_string(), score);
        let head = episode.heads[row.round as usize].link(record.as_str().as_bytes());
        if digest.0 != row.digest || score.to_bits() != row.score.to_bits() || head != row.head {
            wrong.push((Invariant::Replay, format!("{name} does not play again as it was played")));
        }
        episode.lines.push_str(&record.line(head));
        episode.heads.push(head);
        episode.digests.push(digest.0);
        episode.banks.push(banks);
        episode.acts.push(BTreeMap::new());
        self.stats.count("rounds", 1);
        for (invariant, what) in wrong {
            self.broken(invariant, what);
        }
    }

    fn end(&mut self, row: &EndRow) {
        let Some(episode) = self.episodes.get_mut(&row.episode) else { return };
        let mut wrong: Vec<(Invariant, String)> = Vec::new();
        let name = format!("{}: its end", episode.id);
        if episode.end.is_some() {
            return self.broken(Invariant::OneAct, format!("{name} is the second"));
        }
        let Ok(Record::End(end)) = row.record.read() else {
            return self.broken(Invariant::Replay, format!("{name} cannot be read"));
        };
        let Some(ending) = Ending::parse(&end.reason) else {
            return self.broken(Invariant::Replay, format!("{name} has no reason"));
        };
        let head = episode.heads[episode.heads.len() - 1].link(row.record.as_str().as_bytes());
        if head != row.head || ending.status().name() != row.status {
            wrong.push((Invariant::Replay, format!("{name} has another head or status")));
        }
        let open = &episode.acts[episode.acts.len() - 1];
        if !open.values().map(|kept| &kept.record).eq(&end.open_acts) {
            wrong.push((Invariant::Replay, format!("{name} has other open acts")));
        }
        let bytes: usize = episode
            .acts
            .iter()
            .flat_map(BTreeMap::values)
            .map(|kept| kept.raw.as_str().len())
            .sum();
        if bytes as u64 != row.bytes {
            wrong
                .push((Invariant::Quotas, format!("{name} counts {} bytes of {bytes}", row.bytes)));
        }
        let (idle_at, now) = (episode.idle_at(), self.now);
        if ending == Ending::Idle && (row.at < idle_at || now < idle_at) {
            let at = row.at;
            wrong.push((Invariant::Idle, format!("{name} is at {at}, {now}, idle at {idle_at}")));
        }
        // It ends so where no round may begin, and the last one was not cut off.
        let cut = end.open_acts.len();
        let fits = episode.is_closed(row.at)
            && cut == 0
            && (episode.waiting || episode.is_closed(episode.began_at));
        if ending == Ending::Closed && !fits {
            let at = row.at;
            wrong.push((Invariant::Closing, format!("{name} closes at {at}, {cut} open acts")));
        }
        self.stats.count(
            match ending {
                Ending::TaskDone => "ended: task done",
                Ending::RoundsPlayed => "ended: rounds played",
                Ending::Aborted => "ended: aborted",
                Ending::Idle => "ended: idle",
                Ending::Closed => "ended: closed",
            },
            1,
        );
        episode.lines.push_str(&row.record.line(head));
        episode.end = Some((ending, head));
        for (invariant, what) in wrong {
            self.broken(invariant, what);
        }
    }

    /// The server was told of a job.
    pub(crate) fn told(&mut self, told: &JobResult) {
        let moment = self.next_moment();
        match told.result {
            Ok(()) => {}
            Err(Lost::Failed) => {
                self.failed.get_or_insert(moment);
                return;
            }
            Err(Lost::Refused) => return self.refused(&told.entries),
        }
        self.note_held();
        for entry in &told.entries {
            let (key, round) = match entry {
                Entry::Start { episode, .. } => (episode, 0),
                Entry::Round(row) => (&row.episode, row.round + 1),
                Entry::End(row) => {
                    if let Some(episode) = self.episodes.get_mut(&row.episode) {
                        episode.end_told = true;
                    }
                    continue;
                }
                _ => continue,
            };
            if let Some(episode) = self.episodes.get_mut(key) {
                episode.opened = Some((round, self.now, moment));
            }
        }
    }

    /// A job was refused: what is in it never happened.
    fn refused(&mut self, entries: &[Entry]) {
        for entry in entries {
            if let Entry::Open(row) = entry {
                self.refused.insert(row.id.clone());
            }
            if let Entry::Act(row) = entry {
                self.handed.remove(&(row.episode, row.round, row.agent));
            }
            let Some(episode) = entry.chain().and_then(|key| self.episodes.get_mut(&key)) else {
                continue;
            };
            (episode.opened, episode.reopened) = (None, Some(episode.world.round()));
            self.refused.insert(episode.id.clone());
        }
    }

    // ---- what clients do and see

    pub(crate) fn sent(&mut self, number: RequestId, id: &EpisodeId, request: &Request) {
        let moment = self.next_moment();
        if let Request::Create(_, owner) = request {
            self.creating.insert(id.clone(), *owner);
        }
        self.stats.count("requests", 1);
        let (id, held) = (id.clone(), self.held());
        self.requests.insert(number, Sent { id, moment, arrived: None, held });
    }

    /// A client went away without waiting for the answer.
    pub(crate) fn left(&mut self, number: RequestId) {
        if let Some(Sent { id, arrived: Some(arrived), .. }) = self.requests.remove(&number) {
            self.orphans.push((id, arrived));
        }
        self.stats.count("requests dropped", 1);
    }

    pub(crate) fn arrived(&mut self, number: RequestId, acts: Acts) {
        let (at, moment) = (self.now, self.next_moment());
        if let Some(sent) = self.requests.get_mut(&number) {
            sent.arrived = Some(Arrived { at, moment, acts });
        }
    }

    /// A request saw what is published.
    pub(crate) fn seen(&mut self, number: RequestId, snapshot: &Snapshot) {
        let moment = self.next_moment();
        if let Some(sent) = self.requests.get(&number) {
            let (id, sent) = (sent.id.clone(), sent.moment);
            self.shown(&id, snapshot, sent, moment);
        }
    }

    fn shown(&mut self, id: &EpisodeId, snapshot: &Snapshot, sent: u64, moment: u64) {
        let is_refused = self.refused.contains(id);
        let round = snapshot.world.round();
        let name = format!("{id}: round {round}, {}, is shown", snapshot.status.name());
        let key = self.keys.get(id).copied();
        let Some(episode) = key.and_then(|key| self.episodes.get_mut(&key)) else {
            return self.broken(Invariant::Durable, format!("{name}, and nothing is durable"));
        };
        let mut wrong: Vec<(Invariant, String)> = Vec::new();
        let is_over = snapshot.status.is_over();
        let (Some(digest), Some(&head)) =
            (episode.digests.get(round as usize), episode.heads.get(round as usize))
        else {
            return self.broken(Invariant::Durable, format!("{name}, and is not durable"));
        };
        let head = match (is_over, episode.end) {
            (false, _) if snapshot.status == Status::Waiting => episode.opening_head,
            (false, _) => head,
            (true, Some((ending, head))) if ending.status() == snapshot.status => head,
            (true, _) => return self.broken(Invariant::Durable, format!("{name}: no such end")),
        };
        if snapshot.status != Status::Waiting && !is_over && episode.waiting {
            wrong.push((Invariant::Durable, format!("{name}: no start is durable")));
        }
        if snapshot.world.digest().0 != *digest || snapshot.head != head {
            wrong.push((Invariant::Replay, format!("{name}, its journal says something else")));
        }
        // A request from before an actor ended by a fault may get what that one published last.
        let may_be_old = is_refused && sent < episode.seen_first;
        if (round, is_over) < episode.seen && !may_be_old {
            wrong.push((Invariant::Durable, format!("{name} after {:?}", episode.seen)));
        }
        if (round, is_over) > episode.seen {
            (episode.seen, episode.seen_first) = ((round, is_over), moment);
        }
        for agent in snapshot.world.agents().filter(|&agent| snapshot.has_acted(agent)) {
            if episode.act(round, agent).is_none() {
                wrong.push((Invariant::Durable, format!("{name}: {agent} has not acted")));
            }
        }
        if snapshot.banks != episode.banks[round as usize] {
            let banks = &snapshot.banks;
            wrong.push((Invariant::Clocks, format!("{name} with banks {banks:?}")));
        }
        let clocked = episode.spec.round_deadline.is_some();
        let is_known = round == episode.world.round() && episode.reopened != Some(round);
        if clocked && snapshot.status == Status::Running && is_known {
            match (snapshot.opened_at(), episode.opened) {
                (None, _) => wrong.push((Invariant::Clocks, format!("{name} without its opening"))),
                (Some(at), Some((known, opened_at, _))) if known == round => {
                    if at != opened_at {
                        wrong.push((Invariant::Clocks, format!("{name}: {at}, not {opened_at}")));
                    }
                }
                (Some(at), _) => episode.opened = Some((round, at, moment)),
            }
        }
        for (invariant, what) in wrong {
            self.broken(invariant, what);
        }
    }

    pub(crate) fn answered(&mut self, number: RequestId, answer: Answer) {
        let moment = self.next_moment();
        let Some(sent) = self.requests.remove(&number) else { return };
        let id = sent.id.clone();
        let failed = self.failed.is_some();
        // A request that was sent after the failure can get nothing acknowledged.
        let too_late = self.failed.is_some_and(|failed| failed < sent.moment);
        let acks = match answer {
            Answer::Looked => false,
            Answer::Nothing => {
                return self.broken(Invariant::Durable, format!("{id} is not found"));
            }
            Answer::NotTakenUp(RecoveryError::Broken { problem, .. }) => {
                return self.broken(Invariant::Replay, format!("{id} is not taken up: {problem}"));
            }
            Answer::NotTakenUp(RecoveryError::Journal(error))
            | Answer::State(_, Err(RecoveryError::Journal(error)))
            | Answer::Started(Err(StartError::Journal(error)))
            | Answer::Claimed(_, Err(ClaimError::Journal(error)))
            | Answer::Aborted(Err(error)) => {
                return self.failure(&id, failed, &error);
            }
            Answer::Created(Err(CreateError::Work(error)))
            | Answer::NotTakenUp(RecoveryError::Work(error))
            | Answer::State(_, Err(RecoveryError::Work(error))) => {
                unreachable!("work is done at once: {error}")
            }
            Answer::Started(Err(StartError::SeatsOpen(_))) => {
                self.stats.count("refused: seats_open", 1);
                let mixed = self.episode(&id).is_some_and(|episode| episode.spec.is_mixed());
                self.check(Invariant::TrueRefusals, mixed, || format!("{id} has no open seats"));
                false
            }
            Answer::Claimed(_, claimed) => self.claim_answered(&id, claimed),
            Answer::Created(Ok(())) => {
                let is_durable = self.keys.contains_key(&id);
                self.check(Invariant::Durable, is_durable, || format!("{id} is created, not kept"));
                true
            }
            Answer::Created(Err(CreateError::NoMemory(full))) => {
                unreachable!("memory has no bound here: {full}")
            }
            Answer::Created(Err(CreateError::Full(full))) => {
                self.full(full, &sent);
                self.note_held();
                self.creating.remove(&id);
                return;
            }
            Answer::Created(Err(CreateError::Closed(at))) => {
                let is_due = at <= self.now;
                self.check(Invariant::Closing, is_due, || format!("{id} is refused before {at}"));
                self.stats.count("refused: closed", 1);
                self.note_held();
                self.creating.remove(&id);
                return;
            }
            Answer::Created(Err(CreateError::Journal(error))) => {
                self.note_held();
                self.creating.remove(&id);
                return self.failure(&id, failed, &error);
            }
            Answer::Started(Ok(())) => {
                let kept = self.episode(&id).is_some_and(|e| !e.waiting || e.end.is_some());
                self.check(Invariant::Durable, kept, || format!("{id}: its start is not kept"));
                self.stats.count("starts", 1);
                true
            }
            Answer::Aborted(Ok(())) => {
                let kept = self.episode(&id).is_some_and(|episode| episode.end.is_some());
                self.check(Invariant::Durable, kept, || format!("{id}: its end is not kept"));
                true
            }
            Answer::State(round, Ok(digest)) => {
                self.stats.count("earlier states", 1);
                let known = self.episode(&id).and_then(|e| e.digests.get(round as usize)).copied();
                self.check(Invariant::Replay, known == Some(digest), || {
                    format!("{id}: another state after {round} rounds")
                });
                false
            }
            Answer::State(round, Err(RecoveryError::Broken { problem, .. })) => {
                let what = format!("{id}: no state after {round} rounds: {problem}");
                return self.broken(Invariant::Replay, what);
            }
            Answer::Acted(acts, outcomes, snapshot) => {
                self.shown(&id, &snapshot, sent.moment, moment);
                let whole = acts.len() == outcomes.len();
                self.check(Invariant::Progress, whole, || format!("{id}: an act has no outcome"));
                let mut acks = false;
                for ((agent, submission), outcome) in acts.iter().zip(outcomes) {
                    acks |= outcome.is_ok();
                    self.outcome(&sent, *agent, submission, outcome, &snapshot, moment);
                }
                acks
            }
        };
        self.check(Invariant::NoFalseAck, !(acks && too_late), || {
            format!("{id}: request {number} is acknowledged after a failed commit")
        });
    }

    /// The result of a claim, except failures of the journal; true where it was acknowledged.
    fn claim_answered(&mut self, id: &EpisodeId, claimed: Result<Claimed, ClaimError>) -> bool {
        match claimed {
            Ok(Claimed { number, agents }) => {
                let is_kept = self.episode(id).is_some_and(|episode| {
                    let holds = |agent: &AgentId| episode.holders[agent.index()] == Some(number);
                    !agents.is_empty() && agents.iter().all(holds)
                });
                let what = || format!("{id}: claim {number} of {agents:?} is not kept");
                self.check(Invariant::Durable, is_kept, what);
                true
            }
            Err(ClaimError::Over) => {
                let is_over = self.episode(id).is_some_and(|episode| episode.end.is_some());
                self.check(Invariant::TrueRefusals, is_over, || format!("{id} is not over"));
                false
            }
            Err(ClaimError::SeatTaken(taken)) => {
                self.stats.count("refused: seat_taken", 1);
                let is_true = self.episode(id).is_some_and(|episode| match taken {
                    SeatTaken::Seat(agent) => episode.holders[agent.index()].is_some(),
                    SeatTaken::Few { open, wanted } => {
                        open < wanted && episode.count_open() <= open
                    }
                });
                self.check(Invariant::TrueRefusals, is_true, || format!("{id}: {taken}"));
                false
            }
            Err(ClaimError::Journal(_)) => unreachable!("failures are told before"),
        }
    }

    /// The server could not keep something: that must be so.
    fn failure(&mut self, id: &EpisodeId, failed: bool, error: &StoreError) {
        self.stats.count("refused: unavailable", 1);
        let is_true = failed || self.refused.contains(id);
        self.check(Invariant::Progress, is_true, || format!("{id}: {error}, and none failed"));
    }

    /// How many places are taken, in all and of the key: at most, as seen from outside.
    fn held(&self) -> (usize, usize) {
        let live = self.episodes.values().filter(|episode| !episode.end_told);
        let owners = live.map(|episode| episode.owner).chain(self.creating.values().copied());
        owners.fold((0, 0), |(all, owned), owner| (all + 1, owned + usize::from(owner.is_some())))
    }

    /// Notes for all creations on their way how many places were taken meanwhile; to be called before
    /// one is given back.
    fn note_held(&mut self) {
        let (all, owned) = self.held();
        for sent in self.requests.values_mut() {
            sent.held = (sent.held.0.max(all), sent.held.1.max(owned));
        }
    }

    /// The server is full: that must be so, or have been so since it was asked.
    fn full(&mut self, full: Full, sent: &Sent) {
        self.stats.count("refused: full", 1);
        let (all, owned) = self.held();
        // The one that was refused took no place.
        let (was, most) = match full {
            Full::Episodes(most) => (sent.held.0.max(all) - 1, most),
            Full::EpisodesOfKey(most) => (sent.held.1.max(owned) - 1, most),
            Full::EpisodesOfShare { open, .. } => (open, usize::MAX),
            Full::BytesOfEpisode(_)
            | Full::BytesOfKey(_)
            | Full::BytesOfCompetition(_)
            | Full::BytesPerSecond { .. } => return,
        };
        self.check(Invariant::Quotas, was >= most, || format!("{full}; it was {was}"));
    }

    fn outcome(
        &mut self,
        sent: &Sent,
        agent: AgentId,
        submission: &Submission,
        outcome: Result<Receipt, ActError>,
        snapshot: &Snapshot,
        moment: u64,
    ) {
        let Some(&key) = self.keys.get(&sent.id) else { return };
        let place = (key, submission.round, agent);
        let name = format!("{}: {agent} in round {}", sent.id, submission.round);
        let acked = self.acked.get(&place);
        let known_before = acked.is_some_and(|acked| acked.moment < sent.moment);
        let is_same_as_acked =
            acked.is_some_and(|acked| same(&acked.recorded.record, &submission.record));
        match outcome {
            Ok(receipt) => {
                let stable = Invariant::StableReceipts;
                let recorded = &receipt.recorded;
                let fits = receipt.round == submission.round
                    && same(&recorded.record, &submission.record)
                    && recorded.record.source == Source::Player;
                self.check(stable, fits, || format!("{name} got the receipt of another act"));
                let acked = self.acked.get(&place);
                let is_stable = acked.is_none_or(|acked| {
                    let may_be_first = !acked.was_first && acked.moment > sent.moment;
                    acked.recorded == *recorded && (receipt.duplicate || may_be_first)
                });
                self.check(stable, is_stable, || format!("{name} got another receipt"));
                let kept = self.episodes.get(&key).and_then(|e| e.act(place.1, agent));
                let is_kept = kept.is_some_and(|kept| {
                    kept.record == recorded.record && kept.waiting_for == recorded.waiting_for
                });
                self.check(Invariant::Durable, is_kept, || {
                    format!("{name} got a receipt for nothing")
                });
                // A client with a receipt finds the state that belongs to it.
                let is_past = snapshot.status.is_over() || snapshot.world.round() > place.1;
                let shows = is_past || (recorded.waiting_for > 0 && snapshot.has_acted(agent));
                self.check(Invariant::Barrier, shows, || {
                    format!("{name} is not shown to have acted")
                });
                self.stats.count(
                    if receipt.duplicate { "acts confirmed again" } else { "acts acknowledged" },
                    1,
                );
                let was_first = !receipt.duplicate;
                let new = || Acked { recorded: receipt.recorded.clone(), moment, was_first: false };
                self.acked.entry(place).or_insert_with(new).was_first |= was_first;
            }
            Err(ActError::Refused(refusal)) => {
                let forgotten = known_before && is_same_as_acked;
                self.check(Invariant::StableReceipts, !forgotten, || {
                    format!("{name} had a receipt, now {refusal}")
                });
                self.refusal(place, sent, submission, refusal, &name);
            }
            Err(ActError::Busy) => self.stats.count("refused: busy", 1),
            Err(ActError::Journal(error)) => {
                let failed = self.failed.is_some();
                self.failure(&sent.id.clone(), failed, &error);
            }
        }
    }

    /// A refusal must be true by what is durable.
    fn refusal(
        &mut self,
        (key, sent_round, agent): Place,
        sent: &Sent,
        submission: &Submission,
        refusal: Refusal,
        name: &str,
    ) {
        let Some(episode) = self.episodes.get(&key) else { return };
        let kept = episode.act(sent_round, agent).filter(|kept| kept.by_player());
        let handed = self.handed.get(&(key, sent_round, agent));
        let arrived = sent.arrived.as_ref().map_or(sent.moment, |arrived| arrived.moment);
        let had_acted = kept.is_some() && handed.is_some_and(|&handed| handed < arrived);
        let (what, is_true) = match refusal {
            Refusal::RoundAhead { sent, round } => ("refused: round_ahead", sent >= round),
            Refusal::AlreadyActed { .. } => (
                "refused: already_acted",
                kept.is_some_and(|kept| !same(&kept.record, &submission.record)),
            ),
            Refusal::EpisodeOver { escaped: false, .. } => {
                ("refused: episode_over", episode.end.is_some() && !had_acted)
            }
            Refusal::EpisodeOver { escaped: true, .. } => {
                ("refused: escaped", !episode.world.is_alive(agent) && !had_acted)
            }
            Refusal::RoundOver { sent, .. } => {
                let ran_out = episode.act(sent, agent).is_some_and(|kept| !kept.by_player());
                ("refused: round_over", (episode.round() > sent || ran_out) && !had_acted)
            }
            Refusal::NoRoom { .. } => {
                ("refused: no_room", submission.record.text_bytes() > ACT_BYTES_ALWAYS)
            }
        };
        self.stats.count(what, 1);
        self.check(Invariant::TrueRefusals, is_true, || format!("{name}: {refusal}"));
    }

    // ---- crashes, and the end of a run

    /// The server fell over and begins again over what is durable; `found` is what was on the disk
    /// though its commit failed.
    pub(crate) fn crashed(&mut self, found: &[Entry], disk: &[Entry]) {
        self.stats.count("crashes", 1);
        self.stats.count("requests cut off", self.requests.len());
        self.durable(found);
        self.requests.clear();
        self.orphans.clear();
        self.creating.clear();
        self.failed = None;
        self.refused.clear();
        self.started_at = self.now;
        let is_kept = |(key, round, agent): &Place| {
            self.episodes.get(key).is_some_and(|e| e.act(*round, *agent).is_some())
        };
        self.handed.retain(|place, _| is_kept(place));
        for episode in self.episodes.values_mut() {
            (episode.opened, episode.reopened) = (None, None);
            episode.end_told = episode.end.is_some();
        }
        self.on_disk(disk);
    }

    /// Everything that was acknowledged is on the disk as it was acknowledged.
    fn on_disk(&mut self, disk: &[Entry]) {
        let rows: BTreeMap<Place, &ActRow> = (disk.iter())
            .filter_map(|entry| match entry {
                Entry::Act(row) => Some(((row.episode, row.round, row.agent), row)),
                _ => None,
            })
            .collect();
        let lost: Vec<_> = (self.acked.iter())
            .filter(|(place, acked)| {
                !rows.get(place).is_some_and(|row| {
                    row.waiting_for == acked.recorded.waiting_for
                        && row.record.read::<ActRecord>().ok().as_ref()
                            == Some(&acked.recorded.record)
                })
            })
            .map(|(place, _)| *place)
            .collect();
        self.check(Invariant::Durable, lost.is_empty(), || format!("lost: {lost:?}"));
    }

    /// All has come to its end.
    pub(crate) fn ended(&mut self, disk: &[Entry]) {
        let open: Vec<_> = self.requests.keys().copied().collect();
        self.check(Invariant::Progress, open.is_empty(), || format!("not answered: {open:?}"));
        self.on_disk(disk);
        for episode in std::mem::take(&mut self.episodes).into_values() {
            let id = &episode.id;
            let head = episode.end.map(|(_, head)| head);
            let verified = verify(episode.lines.as_bytes(), head, Solver::Flow, |_, _| ());
            if let Err(fault) = verified {
                self.broken(Invariant::Replay, format!("{id}: {fault}"));
            }
        }
    }

    /// The places of which a receipt was given out.
    pub(crate) fn receipts(&self) -> BTreeSet<(EpisodeId, u32, AgentId)> {
        let id = |key: &EpisodeKey| Some(self.episodes.get(key)?.id.clone());
        let known =
            self.acked.keys().filter_map(|(key, round, agent)| Some((id(key)?, *round, *agent)));
        known.collect()
    }
}

/// Whether acts that arrived hold one for this seat that is taken whatever was used.
fn fits(arrived: &Arrived, row: &ActRow) -> bool {
    let mut acts = arrived.acts.iter();
    acts.any(|(agent, act)| {
        *agent == row.agent && act.round == row.round && act.record.text_bytes() <= ACT_BYTES_ALWAYS
    })
}

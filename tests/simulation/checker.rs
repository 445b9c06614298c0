//! The invariants of every run. The checker replays every episode from its durable entries, with the rules and the
//! engine alone, and compares the result with everything that the server submits, shows and answers.

mod answers;
mod durable;

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use jiff::Timestamp;
use swarmbench::episode::lockstep::RecordedAct;
use swarmbench::episode::quota::ACT_BYTES_ALWAYS;
use swarmbench::episode::spec::Spec;
use swarmbench::episode::{Ending, Snapshot, Status};
use swarmbench::hosted;
use swarmbench::ids::{EpisodeId, EpisodeKey};
use swarmbench::keys::OwnerKey;
use swarmbench::store::entries::{ActRow, Entry};
use swarmbench_clock::{after, millis, until};
use swarmbench_engine::physics::Solver;
use swarmbench_engine::{AgentId, World};
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::{ActRecord, RawRecord, Source};
use swarmbench_journal::replay::verify;

use crate::simulation::clients::{Acts, Request, RequestId};
use crate::simulation::journal::{JobResult, Lost};
use swarmbench::cluster::Incarnation;

/// An invariant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Invariant {
    /// Everything acknowledged or shown is on the disk, and nobody sees an episode go back.
    Durable,
    /// A seat has one act per round, a round has one resolution, an episode has one end, and nothing follows the end.
    OneAct,
    /// The same act gets the same receipt; another act never gets it.
    StableReceipts,
    /// A refusal is true.
    TrueRefusals,
    /// A round is resolved as soon as all living seats have acted, and receipts count the missing seats. Nobody is
    /// shown an open round in which nobody may act.
    Barrier,
    /// Journals replay to the same states, and everything shown agrees with them.
    Replay,
    /// A seat has its whole time and no more.
    Clocks,
    /// After a failed commit nothing is acknowledged until a restart.
    NoFalseAck,
    /// If clients act or time passes, every episode ends and every request is answered.
    Progress,
    /// An episode is abandoned after its idle time, not before.
    Idle,
    /// No round begins after the time at which an episode closes, and the one that runs then may end.
    Closing,
    /// Only existing things count against a cap, and they stop counting in time.
    Quotas,
    /// A seat has one holder; an episode starts once, when all seats are held; the server plays its seats as if it
    /// had never crashed.
    Seats,
    /// One server of a cluster plays an episode: no other writes it, or answers for it.
    OneOwner,
}

/// A broken invariant.
#[derive(Clone, Debug)]
pub(crate) struct Violation {
    pub(crate) invariant: Invariant,
    pub(crate) what: String,
}

/// Counts of events by name.
#[derive(Clone, Debug, Default)]
pub(crate) struct Stats(pub(crate) BTreeMap<&'static str, u64>);

impl Stats {
    pub(crate) fn count(&mut self, what: &'static str, times: usize) {
        *self.0.entry(what).or_default() += times as u64;
    }
}

/// The checker's knowledge of a run.
pub(crate) struct Checker {
    pub(crate) now: Timestamp,
    pub(crate) stats: Stats,
    pub(crate) violations: Vec<Violation>,
    pub(crate) episodes: BTreeMap<EpisodeKey, Episode>,
    keys: BTreeMap<EpisodeId, EpisodeKey>,
    /// A counter of events, which orders them.
    moment: u64,
    /// True if the server is one of a cluster.
    is_shared: bool,
    /// True if all servers are up and stay so, and no place moves any more.
    is_calm: bool,
    /// The start of each server.
    started_at: BTreeMap<Incarnation, Timestamp>,
    /// The moment at which each server was first told that a commit failed.
    failed: BTreeMap<Incarnation, u64>,
    /// Episodes with a refused job in this run of the server, or of a cluster.
    refused: BTreeSet<EpisodeId>,
    /// Unanswered requests.
    requests: BTreeMap<RequestId, Sent>,
    /// Requested episodes that are neither durable nor refused.
    creating: BTreeMap<EpisodeId, Option<OwnerKey>>,
    /// The server and the moment of each submitted act.
    handed: BTreeMap<SeatRound, (Incarnation, u64)>,
    /// Acts of clients that went away, which stay in mailboxes all the same.
    orphans: Vec<(EpisodeId, Arrived)>,
    /// Acknowledged acts.
    acked: BTreeMap<SeatRound, Acked>,
}

/// A seat in a round of an episode.
type SeatRound = (EpisodeKey, u32, AgentId);

/// An unanswered request.
struct Sent {
    id: EpisodeId,
    moment: u64,
    /// The furthest state that anybody had seen of the episode before.
    floor: (u32, bool),
    /// The acts of the request in the mailboxes of servers; of several if it was sent again.
    arrived: Vec<Arrived>,
    /// The maximum number of taken places of episodes since then: in all, and of the key.
    held: (usize, usize),
}

/// Acts in a mailbox.
struct Arrived {
    server: Incarnation,
    at: Timestamp,
    moment: u64,
    acts: Acts,
}

/// A receipt, and the moment when it was first given.
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
    /// The number of the holder by agent; the creator's number for all if there are no claims.
    holders: Vec<Option<u32>>,
    /// The seats that the server plays as soon as they have a holder.
    hosted: Vec<(AgentId, String)>,
    /// The players of hosted seats, which have been shown everything so far.
    players: Option<hosted::Players>,
    /// The head after the opening.
    opening_head: Head,
    seated: bool,
    /// The head after each round.
    heads: Vec<Head>,
    digests: Vec<[u8; 32]>,
    /// The remaining banks before each round.
    banks: Vec<Vec<Duration>>,
    /// The acts of each round, the open one included.
    acts: Vec<BTreeMap<AgentId, Kept>>,
    last_act_at: Timestamp,
    created_at: Timestamp,
    /// The beginning of the open round: the creation, the start, or the end of the round before.
    began_at: Timestamp,
    /// The journal as a file.
    lines: String,
    /// The last round that each server published, its time and its moment.
    opened: BTreeMap<Incarnation, (u32, Timestamp, u64)>,
    /// The round that was open when a job was refused: the recovered episode opens it again, and some requests may
    /// still see it as it was before.
    reopened: Option<u32>,
    /// True if the server knows the end.
    end_told: bool,
    /// The furthest state that anybody saw, with its first moment below.
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

    /// True if the server plays this seat.
    fn is_hosted(&self, agent: AgentId) -> bool {
        self.hosted.iter().any(|(hosted, _)| *hosted == agent)
    }

    /// True if a client holds this seat. Only a client's seat has a token outside the server.
    pub(crate) fn is_clients(&self, agent: AgentId) -> bool {
        self.holders[agent.index()].is_some() && !self.is_hosted(agent)
    }

    /// The number of seats without a holder.
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

    /// True if no round may begin at this time.
    fn is_closed(&self, at: Timestamp) -> bool {
        self.spec.closes_at.is_some_and(|closes_at| closes_at <= at)
    }
}

/// True if the wire contract treats two acts of a seat and round as the same.
fn same(one: &ActRecord, other: &ActRecord) -> bool {
    let told = |record: &ActRecord| {
        let ActRecord { action, message, to, response, .. } = record.clone();
        (action, message, to, response)
    };
    told(one) == told(other)
}

impl Checker {
    pub(crate) fn new(now: Timestamp, is_shared: bool) -> Self {
        Self {
            now,
            is_shared,
            is_calm: false,
            stats: Stats::default(),
            violations: Vec::new(),
            episodes: BTreeMap::new(),
            keys: BTreeMap::new(),
            moment: 0,
            started_at: BTreeMap::new(),
            failed: BTreeMap::new(),
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

    fn all_broken(&mut self, wrong: Vec<(Invariant, String)>) {
        let violation = |(invariant, what)| Violation { invariant, what };
        self.violations.extend(wrong.into_iter().map(violation));
    }

    fn next_moment(&mut self) -> u64 {
        self.moment += 1;
        self.moment
    }

    pub(crate) fn episode(&self, id: &EpisodeId) -> Option<&Episode> {
        self.episodes.get(self.keys.get(id)?)
    }

    // ---- submissions to the journal

    /// A server submitted a job, whose entries were decided now.
    pub(crate) fn handed(&mut self, server: Incarnation, entries: &[Entry]) {
        let moment = self.next_moment();
        for entry in entries {
            if let Entry::Act(row) = entry {
                self.clock_of(server, row);
                let place = (row.episode, row.round, row.agent);
                self.handed.entry(place).or_insert((server, moment));
            }
        }
    }

    /// Checks the clock of an act: an act in time, a default in time, and the bank time of both.
    fn clock_of(&mut self, server: Incarnation, row: &ActRow) {
        let Some(episode) = self.episodes.get(&row.episode) else { return };
        let Some(round_deadline) = episode.spec.round_deadline else { return };
        let Ok(record) = row.record.read::<ActRecord>() else { return };
        if episode.is_hosted(row.agent) && record.source == Source::Player {
            // The server itself sent the act.
            return;
        }
        let (now, bank) = (self.now, episode.bank(row.agent));
        let started_at = self.started_at.get(&server).copied().unwrap_or(Timestamp::MIN);
        let opened = episode.opened.get(&server).copied();
        let opened = opened.filter(|(round, ..)| *round == row.round);
        let name = format!("{} {} in round {}", episode.id, row.agent, row.round);
        if record.source == Source::Clock {
            // If nobody saw the opening of the round, it was not before this server's start.
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
                let in_time = self.carried(server, row).find(|arrived| {
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
        let mut arrivals = self.carried(server, row).peekable();
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
        // After a restart nobody may have seen yet when the round was opened again.
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

    /// Arrivals at a server of unanswered acts for this seat and round.
    fn carried<'a>(
        &'a self,
        server: Incarnation,
        row: &'a ActRow,
    ) -> impl Iterator<Item = &'a Arrived> {
        let id = self.episodes.get(&row.episode).map(|episode| &episode.id);
        let of = |sent: &'a Sent| sent.arrived.iter().map(|arrived| (&sent.id, arrived));
        let waiting = self.requests.values().flat_map(of);
        let orphans = self.orphans.iter().map(|(id, arrived)| (id, arrived));
        let of_it = waiting.chain(orphans).filter(move |(of, _)| Some(*of) == id);
        of_it.map(|(_, arrived)| arrived).filter(move |arrived| {
            let mut acts = arrived.acts.iter();
            arrived.server == server
                && acts.any(|(agent, act)| *agent == row.agent && act.round == row.round)
        })
    }

    /// A server received the result of a job.
    pub(crate) fn told(&mut self, server: Incarnation, told: &JobResult) {
        let moment = self.next_moment();
        match told.result {
            Ok(()) => {}
            Err(Lost::Failed) => {
                self.failed.entry(server).or_insert(moment);
                if self.is_shared {
                    self.forget_handed(server);
                }
                return;
            }
            Err(Lost::Refused) => return self.refused(server, &told.entries),
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
                episode.opened.insert(server, (round, self.now, moment));
            }
        }
    }

    /// Forgets acts of a server that were submitted and will never be durable.
    fn forget_handed(&mut self, server: Incarnation) {
        let is_kept = |(key, round, agent): &SeatRound| {
            self.episodes.get(key).is_some_and(|e| e.act(*round, *agent).is_some())
        };
        self.handed.retain(|place, (of, _)| *of != server || is_kept(place));
    }

    /// A job was refused, so its entries never happened.
    fn refused(&mut self, server: Incarnation, entries: &[Entry]) {
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
            episode.opened.remove(&server);
            episode.reopened = Some(episode.world.round());
            self.refused.insert(episode.id.clone());
        }
    }

    // ---- actions and observations of clients

    pub(crate) fn sent(&mut self, number: RequestId, id: &EpisodeId, request: &Request) {
        let moment = self.next_moment();
        if let Request::Create(_, owner) = request {
            self.creating.insert(id.clone(), *owner);
        }
        self.stats.count("requests", 1);
        let floor = self.episode(id).map_or((0, false), |episode| episode.seen);
        let (id, held) = (id.clone(), self.held());
        self.requests.insert(number, Sent { id, moment, floor, arrived: Vec::new(), held });
    }

    /// A client went away without waiting for the answer.
    pub(crate) fn left(&mut self, number: RequestId) {
        if let Some(sent) = self.requests.remove(&number) {
            self.orphan(sent);
        }
        self.stats.count("requests dropped", 1);
    }

    /// Keeps acts in mailboxes that nobody waits for any more.
    fn orphan(&mut self, Sent { id, arrived, .. }: Sent) {
        self.orphans.extend(arrived.into_iter().map(|arrived| (id.clone(), arrived)));
    }

    pub(crate) fn arrived(
        &mut self,
        server: Incarnation,
        number: RequestId,
        id: &EpisodeId,
        acts: Acts,
    ) {
        let (at, moment) = (self.now, self.next_moment());
        let arrived = Arrived { server, at, moment, acts };
        match self.requests.get_mut(&number) {
            Some(sent) => sent.arrived.push(arrived),
            None => self.orphans.push((id.clone(), arrived)),
        }
    }

    /// A server answered from its memory, and therefore must play the episode.
    pub(crate) fn answers_for(&mut self, server: Incarnation, id: &EpisodeId, plays: bool) {
        self.check(Invariant::OneOwner, plays, || {
            format!("{id}: server {server} answers, and does not play it")
        });
    }

    /// A request saw a published snapshot.
    pub(crate) fn seen(&mut self, server: Incarnation, number: RequestId, snapshot: &Snapshot) {
        let moment = self.next_moment();
        if let Some(sent) = self.requests.get_mut(&number) {
            let (id, floor, sent_at) = (sent.id.clone(), sent.floor, sent.moment);
            // A request never sees less than it has seen itself.
            let seen = (snapshot.world.round(), snapshot.status.is_over());
            sent.floor = floor.max(seen);
            self.shown(server, &id, snapshot, (sent_at, floor), moment);
        }
    }

    fn shown(
        &mut self,
        server: Incarnation,
        id: &EpisodeId,
        snapshot: &Snapshot,
        (sent, floor): (u64, (u32, bool)),
        moment: u64,
    ) {
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
        // If the end could not be stored, the server can show nothing else.
        let is_known = !is_refused && !self.failed.contains_key(&server);
        if snapshot.status == Status::Running && snapshot.world.is_over() && is_known {
            wrong.push((Invariant::Barrier, format!("{name}, and nothing is left to be done")));
        }
        // A request from before the actor ended by a fault may get the last snapshot of that actor.
        let may_be_old = is_refused && sent < episode.seen_first;
        // Later answers may overtake one that is forwarded by another server.
        let least = if self.is_shared { floor } else { episode.seen };
        if (round, is_over) < least && !may_be_old {
            wrong.push((Invariant::Durable, format!("{name} after {least:?}")));
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
            match (snapshot.opened_at(), episode.opened.get(&server).copied()) {
                (None, _) => wrong.push((Invariant::Clocks, format!("{name} without its opening"))),
                (Some(at), Some((known, opened_at, _))) if known == round => {
                    if at != opened_at {
                        wrong.push((Invariant::Clocks, format!("{name}: {at}, not {opened_at}")));
                    }
                }
                (Some(at), _) => {
                    episode.opened.insert(server, (round, at, moment));
                }
            }
        }
        self.all_broken(wrong);
    }

    /// The maximum number of taken places, in all and of the key, as seen from outside.
    fn held(&self) -> (usize, usize) {
        let live = self.episodes.values().filter(|episode| !episode.end_told);
        let owners = live.map(|episode| episode.owner).chain(self.creating.values().copied());
        owners.fold((0, 0), |(all, owned), owner| (all + 1, owned + usize::from(owner.is_some())))
    }

    /// Records the number of taken places for all requests in flight; called before a place is given back.
    fn note_held(&mut self) {
        let (all, owned) = self.held();
        for sent in self.requests.values_mut() {
            sent.held = (sent.held.0.max(all), sent.held.1.max(owned));
        }
    }

    // ---- crashes, and the end of a run

    /// The server crashed and starts again from the durable entries; `found` are entries that were on the disk
    /// although their commit failed.
    pub(crate) fn crashed(&mut self, found: &[Entry], disk: &[Entry]) {
        self.stats.count("crashes", 1);
        self.stats.count("requests cut off", self.requests.len());
        self.durable(found);
        self.requests.clear();
        self.orphans.clear();
        self.creating.clear();
        self.failed.clear();
        self.refused.clear();
        let is_kept = |(key, round, agent): &SeatRound| {
            self.episodes.get(key).is_some_and(|e| e.act(*round, *agent).is_some())
        };
        self.handed.retain(|place, _| is_kept(place));
        for episode in self.episodes.values_mut() {
            episode.opened.clear();
            episode.reopened = None;
            episode.end_told = episode.end.is_some();
        }
        self.on_disk(disk);
    }

    /// A server started.
    pub(crate) fn began(&mut self, server: Incarnation) {
        self.started_at.insert(server, self.now);
    }

    /// A server of a cluster is gone, and so are its unwritten entries; requests of clients go on elsewhere.
    pub(crate) fn gone(&mut self, server: Incarnation, disk: &[Entry]) {
        for sent in self.requests.values_mut() {
            sent.arrived.retain(|arrived| arrived.server != server);
        }
        self.orphans.retain(|(_, arrived)| arrived.server != server);
        self.forget_handed(server);
        self.on_disk(disk);
    }

    /// A server of a cluster was excluded: it can no longer write, whether it knows that or not.
    pub(crate) fn excluded(&mut self, server: Incarnation) {
        self.stats.count("take-overs", 1);
        self.forget_handed(server);
    }

    /// All servers are up, and no place moves any more: nothing may fail from now on.
    pub(crate) fn calm(&mut self) {
        self.failed.clear();
        self.refused.clear();
        self.is_calm = true;
    }

    /// Checks that everything acknowledged is on the disk as it was acknowledged.
    fn on_disk(&mut self, disk: &[Entry]) {
        let rows: BTreeMap<SeatRound, &ActRow> = (disk.iter())
            .filter_map(|entry| match entry {
                Entry::Act(row) => Some(((row.episode, row.round, row.agent), row)),
                _ => None,
            })
            .collect();
        let lost: Vec<_> = (self.acked.iter())
            .filter(|(place, acked)| {
                !rows.get(place).is_some_and(|row| {
                    row.waiting_for == acked.recorded.waiting_for
                        && row.record == acked.recorded.record
                })
            })
            .map(|(place, _)| *place)
            .collect();
        self.check(Invariant::Durable, lost.is_empty(), || format!("lost: {lost:?}"));
    }

    /// Checks the end of a run.
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

    /// The acknowledged acts.
    pub(crate) fn receipts(&self) -> BTreeSet<(EpisodeId, u32, AgentId)> {
        let id = |key: &EpisodeKey| Some(self.episodes.get(key)?.id.clone());
        let known =
            self.acked.keys().filter_map(|(key, round, agent)| Some((id(key)?, *round, *agent)));
        known.collect()
    }
}

/// True if arrived acts include one of this seat that fits into any quota.
fn fits(arrived: &Arrived, row: &ActRow) -> bool {
    let mut acts = arrived.acts.iter();
    acts.any(|(agent, act)| {
        *agent == row.agent
            && act.round == row.round
            && act.decision.text_bytes() <= ACT_BYTES_ALWAYS
    })
}

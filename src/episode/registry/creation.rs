//! Creation of episodes: from their layout, or from a round of another episode.

use std::sync::atomic::AtomicI64;
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Duration;

use jiff::Timestamp;
use swarmbench_engine::{AgentId, World};
use tokio::sync::OnceCell;
use tokio_util::sync::{CancellationToken, DropGuard};

use super::super::actor::{EpisodeInit, Handle, Running, Times, note_end, seated, spawn};
use super::super::heavy::{is_heavy, off_thread};
use super::super::lockstep::{Lockstep, ResumeState};
use super::super::memory;
use super::super::past::{Past, PastAct};
use super::super::quota::{Full, Purpose};
use super::super::recovery::clocks;
use super::super::seating::Seating;
use super::super::spec::Spec;
use super::Registry;
use crate::budget::{Exhausted, Reservation};
use crate::fair::{Party, Rank};
use crate::ids::{EpisodeId, EpisodeKey, Place, RunKey};
use crate::keys::OwnerKey;
use crate::store::entries::{
    ActRow, ClaimRow, Entry, Held, Holder, OpeningRow, RoundRow, SeatingRow, TokenRow,
};
use crate::store::{Stopped, StoreError};
use crate::telemetry::detached_by;
use crate::work::{Cancelled, WorkError};
use swarmbench_boards::run::is_human;
use swarmbench_journal::Tally;
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::RawRecord;
use swarmbench_protocol::carried::Carried;

/// Rows of forks in one commit: it bounds the time for which acts of other episodes wait.
pub const FORK_PIECE_ROWS_MAX: usize = 4096;

/// Request for a new episode: its description, party, purpose and run.
pub struct Creation {
    pub id: EpisodeId,
    /// Party whose limits the episode uses, with the key of the creator, if any.
    pub party: Party,
    pub purpose: Purpose,
    /// Run of the episode, and its game in the run's plan.
    pub run: Option<(RunKey, u32)>,
    pub spec: Spec,
    /// What each holder of a team declares further.
    pub holder_metas: Vec<Carried>,
    pub tokens: Vec<TokenRow>,
    /// Idempotency key, and hash of the body.
    pub idempotency: Option<(String, [u8; 32])>,
}

/// Reason why an episode was not created.
#[derive(Clone, Debug, thiserror::Error)]
pub enum CreateError {
    #[error(transparent)]
    Full(#[from] Full),
    #[error(transparent)]
    NoMemory(#[from] Exhausted),
    /// The time in which rounds may begin is over.
    #[error("no round may begin after {0}")]
    Closed(Timestamp),
    /// The map is large, and too much heavy work waits.
    #[error(transparent)]
    Work(#[from] WorkError),
    #[error(transparent)]
    Journal(#[from] StoreError),
}

/// Episodes that begin with the same state.
struct NewEpisodes {
    creations: Vec<Creation>,
    /// The parent of forks; `None` for an episode that begins with its layout.
    fork_of: Option<EpisodeKey>,
    past: Past,
    /// Memory of each episode.
    rooms: Vec<Reservation>,
}

/// A new episode, with the entries that make it durable, except for the rounds that it took over.
struct Prepared {
    init: EpisodeInit,
    /// Heads of its chain after each round that it took over.
    heads: Vec<Head>,
    entries: Vec<Entry>,
    room: Reservation,
}

/// A new episode in its slot. While this is held, nobody recovers or evicts the episode.
struct Starting {
    handle: Arc<OnceCell<Handle>>,
    _starting: DropGuard,
}

impl Registry {
    /// Creates an episode, durably.
    pub async fn create(&self, creation: Creation) -> Result<Handle, CreateError> {
        let registry = self.clone();
        let created = self.detached(creation.party, async move {
            let first = registry.numbers.take(1, registry.host.clock.wall());
            let opened = registry.open_new(EpisodeKey(first), creation).await;
            registry.release_unless_opened(first, 1, opened)
        });
        Ok(created.await?.swap_remove(0))
    }

    /// Creates forks of an episode that continue from the end of `past`, all or none, durably. Their numbers follow one another,
    /// in order.
    pub async fn fork(
        &self,
        creations: Vec<Creation>,
        fork_of: EpisodeKey,
        past: Past,
    ) -> Result<Vec<Handle>, CreateError> {
        let registry = self.clone();
        let party = creations.first().map_or(Party::SERVER, |creation| creation.party);
        self.detached(party, async move {
            let count = creations.len();
            let first = registry.numbers.take(count, registry.host.clock.wall());
            let opened = registry.open_forks(first, creations, fork_of, past).await;
            registry.release_unless_opened(first, count, opened)
        })
        .await
    }

    /// Creates episodes for a party in a task of its own: a creation has to complete even if the caller is dropped.
    fn detached(
        &self,
        party: Party,
        creating: impl Future<Output = Result<Vec<Handle>, CreateError>> + Send + 'static,
    ) -> impl Future<Output = Result<Vec<Handle>, CreateError>> {
        let created = detached_by(&*self.host.spawn, party.scope(creating));
        async {
            let stopped = |_| Err(StoreError::Stopped(Stopped::Server).into());
            created.await.unwrap_or_else(stopped)
        }
    }

    fn release_unless_opened(
        &self,
        first: i64,
        count: usize,
        opened: Result<Vec<Handle>, CreateError>,
    ) -> Result<Vec<Handle>, CreateError> {
        if opened.is_err() {
            (first..first + number(count))
                .for_each(|key| self.host.quotas.release(EpisodeKey(key)));
        }
        opened
    }

    /// Admits a new episode in round `round`, and reserves its memory.
    fn admit(
        &self,
        key: EpisodeKey,
        creation: &Creation,
        round: u32,
    ) -> Result<Reservation, CreateError> {
        let Creation { party, purpose, spec, .. } = creation;
        self.host.quotas.admit(key, *party, *purpose)?;
        let bytes = memory::expected(spec, round, spec.hosted_max());
        // Episodes of organizers may exceed a share.
        let shares = (*purpose != Purpose::Organizer).then_some(*party);
        Ok(self.room_of(bytes, shares, Rank::Normal)?)
    }

    async fn open_new(
        &self,
        key: EpisodeKey,
        creation: Creation,
    ) -> Result<Vec<Handle>, CreateError> {
        let room = self.admit(key, &creation, 0)?;
        let config = Arc::clone(&creation.spec.config);
        let heavy = is_heavy(&config);
        let lay_out = move |_: &Cancelled<'_>| World::new(config);
        let share = (creation.party, Rank::Normal);
        let world = off_thread(&self.host.workers, "layout", share, heavy, lay_out).await?;
        let past = Past::none(Arc::new(world));
        let new = NewEpisodes { creations: vec![creation], fork_of: None, past, rooms: vec![room] };
        self.open(key.0, new).await
    }

    async fn open_forks(
        &self,
        first: i64,
        creations: Vec<Creation>,
        fork_of: EpisodeKey,
        past: Past,
    ) -> Result<Vec<Handle>, CreateError> {
        let round = past.world.round();
        let rooms: Result<Vec<_>, _> = (first..)
            .zip(&creations)
            .map(|(key, creation)| self.admit(EpisodeKey(key), creation, round))
            .collect();
        let rooms = rooms?;
        let Some(party) = creations.first().map(|creation| creation.party) else {
            return Ok(Vec::new());
        };
        let bytes = (past.bytes, creations.len() as u64);
        self.host.quotas.take_forks(party, bytes, self.host.clock.now())?;
        let new = NewEpisodes { creations, fork_of: Some(fork_of), past, rooms };
        let opened = self.open(first, new).await;
        if opened.is_err() {
            self.host.quotas.release_forks(party, bytes);
        }
        opened
    }

    /// Stores new episodes, all or none, and starts their actors.
    async fn open(&self, first: i64, new: NewEpisodes) -> Result<Vec<Handle>, CreateError> {
        let NewEpisodes { creations, fork_of, past, rooms } = new;
        let past = Arc::new(past);
        let mut prepared = Vec::with_capacity(creations.len());
        for ((key, creation), room) in (first..).zip(creations).zip(rooms) {
            prepared.push(self.prepare(EpisodeKey(key), creation, fork_of, &past, room).await?);
        }
        // The episodes get slots before anybody can find them. Nobody recovers or evicts them until they are started: they would
        // get a second actor, from their beginning.
        let places: Vec<_> = prepared.iter().map(|one| self.place(&one.init.episode)).collect();
        if let Err(error) = self.keep(&mut prepared, &past).await {
            drop(places);
            for one in &prepared {
                self.slots().remove_unused(&one.init.episode.id);
            }
            return Err(error.into());
        }
        let mut handles = Vec::with_capacity(prepared.len());
        for (one, place) in prepared.into_iter().zip(places) {
            handles.push(self.start(one, place).await);
        }
        Ok(handles)
    }

    async fn prepare(
        &self,
        key: EpisodeKey,
        creation: Creation,
        fork_of: Option<EpisodeKey>,
        past: &Arc<Past>,
        room: Reservation,
    ) -> Result<Prepared, CreateError> {
        let Creation { id, party, purpose: _, run, spec, holder_metas, tokens, idempotency } =
            creation;
        let (now, running) = (self.host.clock.wall(), self.host.clock.now());
        if let Some(closes_at) = spec.closes_at.filter(|at| *at <= now) {
            return Err(CreateError::Closed(closes_at));
        }
        let owner = party.owner();
        let record = RawRecord::write(&spec.opening(&id, now, past.keyframes.layout()));
        let opened = Head::START.link(record.as_str().as_bytes());
        let heads = self.heads(opened, past, party).await?;
        let mut head = heads.last().copied().unwrap_or(opened);
        let waiting = spec.begins_waiting();
        let (seating, claims) = self.seat(key, owner, (&spec, holder_metas), now).await?;
        let row = OpeningRow {
            episode: key,
            id: id.clone(),
            owner,
            run,
            fork: fork_of.map(|parent| (parent, past.world.round())),
            record,
            head,
            task: spec.config.task().name(),
            model: spec.model.clone(),
            visibility: spec.visibility.name(),
            waiting,
            is_mixed: spec.is_mixed(),
            has_people: is_human(&spec.agent_meta),
            own_games: spec.own_games,
            clocked: spec.advances_by_itself(),
            at: now,
            idempotency,
            tokens,
        };
        let mut entries: Vec<Entry> =
            [Entry::Open(Box::new(row))].into_iter().chain(claims).collect();
        if let Some(seating) = seating.as_ref().filter(|_| !waiting) {
            let record;
            (record, head) = seated(seating, head);
            entries.push(Entry::Seat(SeatingRow { episode: key, record, head }));
        }
        let agents = usize::from(spec.config.num_agents());
        let world = Arc::clone(&past.world);
        let resume = ResumeState {
            waiting,
            outcome: None,
            round: world.round(),
            alive: world.agents().map(|agent| world.is_alive(agent)).collect(),
            // Banks are full in a fork as well: its clocks are its own.
            bank_spent: vec![Duration::ZERO; agents],
            recorded: Vec::new(),
            last_act_at: running,
        };
        let spec = Arc::new(spec);
        let episode = Running {
            id,
            key,
            owner,
            run: run.map(|(run, _)| run),
            party,
            spec: Arc::clone(&spec),
            created_at: now,
            hosted: OnceLock::new(),
            keyframes: Mutex::new(past.keyframes.clone()),
            ends_at: AtomicI64::default(),
            times: Arc::new(Times::new(running)),
        };
        let mut init = EpisodeInit {
            episode,
            lockstep: Lockstep::new(clocks(&spec), resume, running),
            newest_at: now,
            world,
            head,
            bytes: past.bytes,
            tally: Tally::default(),
            seating,
        };
        entries.extend(init.end_if_solved());
        Ok(Prepared { init, heads, entries, room })
    }

    /// Heads of a chain that begins with `opened`, after each round that is taken over.
    async fn heads(
        &self,
        opened: Head,
        past: &Arc<Past>,
        party: Party,
    ) -> Result<Vec<Head>, WorkError> {
        if past.rounds.is_empty() {
            return Ok(Vec::new());
        }
        let rounds = Arc::clone(past);
        let link = move |_: &Cancelled<'_>| {
            let mut head = opened;
            let next = rounds.rounds.iter().map(|round| {
                head = head.link(round.record.as_str().as_bytes());
                head
            });
            next.collect()
        };
        off_thread(&self.host.workers, "fork", (party, Rank::Normal), true, link).await
    }

    /// Stores new episodes, all or none. Where they took over many rounds, several commits store these, and the episodes exist
    /// with the last one.
    async fn keep(&self, prepared: &mut [Prepared], past: &Past) -> Result<(), StoreError> {
        let rows = prepared.len() * past.rows();
        let mut entries = Vec::with_capacity(FORK_PIECE_ROWS_MAX.min(rows) + 2);
        if rows > FORK_PIECE_ROWS_MAX {
            entries
                .push(Entry::BeginForks(prepared.iter().map(|one| one.init.episode.key).collect()));
        }
        for one in prepared.iter() {
            let (episode, at) = (one.init.episode.key, one.init.newest_at);
            for ((round, taken), head) in (0..).zip(&past.rounds).zip(&one.heads) {
                if entries.len() >= FORK_PIECE_ROWS_MAX {
                    self.host.journal.keep(std::mem::take(&mut entries)).await?;
                }
                entries.extend(taken.acts.iter().map(|act| {
                    let PastAct { agent, waiting_for, source, .. } = *act;
                    // A fork takes acts over without their texts.
                    let (record, brief) = (act.record.clone(), None);
                    let row =
                        ActRow { episode, round, agent, waiting_for, source, at, record, brief };
                    Entry::Act(row)
                }));
                let (digest, score, head) = (taken.digest, taken.score, *head);
                entries.push(Entry::Round(RoundRow { episode, round, digest, score, head, at }));
            }
        }
        entries.extend(prepared.iter_mut().flat_map(|one| std::mem::take(&mut one.entries)));
        self.host.journal.keep(entries).await
    }

    /// Starts the actor of an episode that is durable now, unless a request has found the episode and recovered it: an episode
    /// never has two actors.
    async fn start(&self, prepared: Prepared, place: Starting) -> Handle {
        let Prepared { init, room, .. } = prepared;
        let Running { id, spec, .. } = &init.episode;
        tracing::info!(episode = %id, task = spec.config.task().name(), model = &*spec.model, "created");
        metrics::counter!("swarmbench_episodes_created_total").increment(1);
        let id = id.clone();
        let start = || async {
            let is_solved = init.lockstep.outcome().is_some();
            let handle = spawn(Arc::clone(&self.host), init, room);
            if is_solved {
                note_end(&self.host, &handle, &handle.snapshot());
            }
            handle.settled().await;
            handle
        };
        let handle = place.handle.get_or_init(start).await.clone();
        if let Some(slot) = self.slots().get_mut(&id) {
            slot.starting = None;
        }
        handle
    }

    /// Reserves the slot of an episode in creation.
    fn place(&self, episode: &Running) -> Starting {
        let starting = CancellationToken::new();
        let mut slots = self.slots();
        let slot = slots.wake_or_insert(&episode.id, self.host.clock.now());
        slot.place = Some((Place::of_game(episode.key, episode.run), episode.key));
        slot.starting = Some(starting.clone());
        Starting { handle: Arc::clone(&slot.handle), _starting: starting.drop_guard() }
    }

    /// Seating of a new episode, and the entries for its creator and its team.
    async fn seat(
        &self,
        episode: EpisodeKey,
        owner: Option<OwnerKey>,
        (spec, metas): (&Spec, Vec<Carried>),
        now: Timestamp,
    ) -> Result<(Option<Seating>, Vec<Entry>), StoreError> {
        if !spec.is_seated() {
            return Ok((None, Vec::new()));
        }
        let key = match owner {
            Some(owner) => self.host.journal.key_id(owner).await?,
            None => None,
        };
        let holder = Holder {
            number: 0,
            owner,
            key,
            model: spec.model.clone(),
            agent_meta: spec.agent_meta.clone(),
            player: spec.player.clone(),
            at: now,
        };
        let own = spec.agents().filter(|agent| !spec.open_seats.contains(agent));
        let has_rows = !spec.open_seats.is_empty();
        let agents = if has_rows { own.collect() } else { Vec::new() };
        let team = (1..).zip(&spec.holders).zip(metas).map(|((number, declared), agent_meta)| {
            // Nobody answers for a player of the server.
            let is_hosted = declared.player.is_some();
            let held = Holder {
                number,
                owner: owner.filter(|_| !is_hosted),
                key: holder.key.clone().filter(|_| !is_hosted),
                model: declared.model.clone(),
                agent_meta,
                player: declared.player.clone(),
                at: now,
            };
            (held, declared.seats.iter().map(|&agent| AgentId(agent)).collect())
        });
        let held: Vec<Held> = team.collect();
        let held: Vec<Held> = [(holder, agents)].into_iter().chain(held).collect();
        let seating = Seating::new(spec, self.host.clock.running_at(now), held.clone());
        let claim = |(holder, agents)| {
            let tokens = Vec::new();
            Entry::Claim(Box::new(ClaimRow { episode, holder, agents, tokens, idempotency: None }))
        };
        Ok((seating, held.into_iter().map(claim).collect()))
    }
}

fn number(count: usize) -> i64 {
    i64::try_from(count).expect("a few episodes")
}

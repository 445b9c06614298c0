//! Episodes over a real store with a journal that misbehaves: an actor that panics, an episode that cannot be read.
//! And the memory that they may take, which follows from settings alone.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use swarmbench::budget::{Budget, Exhausted};
use swarmbench::episode::actor::{Handle, Spawn};
use swarmbench::episode::lockstep::{Receipt, Submission};
use swarmbench::episode::quota::{Purpose, Quotas};
use swarmbench::episode::registry::{CreateError, Creation, Registry};
use swarmbench::episode::spec::Spec;
use swarmbench::fair::Party;
use swarmbench::http::limits::Limits;
use swarmbench::ids::{CompetitionKey, EpisodeId, EpisodeKey, RunKey};
use swarmbench::keys::OwnerKey;
use swarmbench::store::Store;
use swarmbench::store::entries::{ActRow, Entry, Held, brief_of};
use swarmbench::store::port::{
    Committed, EpisodeStore, Reply, RoundActs, StoredAct, StoredEpisode, StoredRound, Unfinished,
};
use swarmbench::work::Workers;
use swarmbench_engine::{Act, Action, AgentId, Config, Settings, TaskName};
use swarmbench_journal::record::{ActRecord, Decision, RawRecord, Source, Usage};
use swarmbench_testkit::host::ManualClock;
use tempfile::TempDir;

/// Longer than anything takes, so that a test that hangs fails.
const PATIENCE: Duration = Duration::from_mins(1);

/// A journal that panics in the actor, or never answers for one episode.
struct Faulty {
    store: Store,
    panics: AtomicBool,
    stuck: Mutex<Option<EpisodeId>>,
}

impl EpisodeStore for Faulty {
    fn append(&self, entries: Vec<Entry>, committed: Committed) {
        let acts = entries.iter().any(|entry| matches!(entry, Entry::Act(_)));
        assert!(!acts || !self.panics.swap(false, Ordering::Relaxed), "a fault, made by a test");
        self.store.append(entries, committed);
    }

    fn recovered(&self, episode: EpisodeKey) {
        self.store.recovered(episode);
    }

    fn episode(&self, id: EpisodeId) -> Reply<'_, Option<StoredEpisode>> {
        if self.stuck.lock().expect("no panic").as_ref() == Some(&id) {
            return Box::pin(std::future::pending());
        }
        self.store.episode(id)
    }

    fn unfinished(&self) -> Reply<'_, Vec<Unfinished>> {
        self.store.unfinished()
    }

    fn holders(&self, episode: EpisodeKey) -> Reply<'_, Vec<Held>> {
        self.store.holders(episode)
    }

    fn entrant(&self, run: RunKey) -> Reply<'_, Option<(CompetitionKey, OwnerKey)>> {
        self.store.entrant(run)
    }

    fn key_id(&self, owner: OwnerKey) -> Reply<'_, Option<String>> {
        self.store.key_id(owner)
    }

    fn acts(&self, episode: EpisodeKey, from: u32, to: u32) -> Reply<'_, Vec<(u32, RoundActs)>> {
        self.store.acts(episode, from, to)
    }

    fn round_acts(&self, episode: EpisodeKey, round: u32) -> Reply<'_, RoundActs> {
        self.store.round_acts(episode, round)
    }

    fn act(&self, episode: EpisodeKey, round: u32, agent: AgentId) -> Reply<'_, Option<StoredAct>> {
        self.store.act(episode, round, agent)
    }

    fn rounds(&self, episode: EpisodeKey, from: u32, to: u32) -> Reply<'_, Vec<StoredRound>> {
        self.store.rounds(episode, from, to)
    }
}

/// A registry over a database of its own.
struct Bench {
    _folder: TempDir,
    journal: Arc<Faulty>,
    clock: Arc<ManualClock>,
    registry: Registry,
}

impl Bench {
    async fn new(budget: Arc<Budget>) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let store = Store::open(&folder.path().join("a.db")).await.expect("it opens");
        let journal =
            Arc::new(Faulty { store, panics: AtomicBool::new(false), stuck: Mutex::default() });
        let clock = Arc::new(ManualClock::new("2026-03-01T12:00:00Z".parse().expect("a time")));
        let registry = registry(&journal, &clock, 0, budget);
        Self { _folder: folder, journal, clock, registry }
    }

    async fn create(
        &self,
        id: &str,
        spec: Spec,
        purpose: Purpose,
        owner: i64,
    ) -> Result<Handle, CreateError> {
        let creation = Creation {
            id: EpisodeId::from_text(id.to_owned()),
            party: Party::of_key(Some(OwnerKey(owner))),
            purpose,
            run: None,
            spec,
            holder_metas: Vec::new(),
            tokens: Vec::new(),
            idempotency: None,
        };
        self.registry.create(creation).await
    }

    async fn small(&self, id: &str) -> Handle {
        self.create(id, spec(|_| {}), Purpose::Usual, 1).await.expect("created")
    }

    /// Creates games until one is refused.
    async fn fill(&self, owner: i64) -> (usize, CreateError) {
        for count in 0..1000 {
            let id = format!("ep_{owner}_{count}");
            if let Err(refused) = self.create(&id, large(true), Purpose::Usual, owner).await {
                return (count, refused);
            }
        }
        panic!("none is refused");
    }
}

/// Another server over the same journal.
fn registry(
    journal: &Arc<Faulty>,
    clock: &Arc<ManualClock>,
    last_key: i64,
    budget: Arc<Budget>,
) -> Registry {
    let spawn: Spawn = Arc::new(|task| drop(tokio::spawn(task)));
    let quotas = Arc::new(Quotas::new(Limits::default().caps()));
    let (journal, clock) = (Arc::clone(journal) as _, Arc::clone(clock) as _);
    Registry::new(journal, clock, quotas, Workers::inline(), spawn, last_key).with_budget(budget)
}

fn spec(change: impl FnOnce(&mut Settings)) -> Spec {
    let mut settings = Settings::standard(TaskName::Synchronization, 1);
    settings.num_agents = 2;
    change(&mut settings);
    crate::game::spec(Config::check(&settings).expect("good settings"))
}

/// A game whose world takes some 200,000 bytes; one with a clock stays in memory.
fn large(is_clocked: bool) -> Spec {
    let spec = spec(|settings| (settings.width, settings.height) = (256, 256));
    let config = {
        let mut settings = spec.config.settings();
        settings.memory = 0;
        Arc::new(Config::check(&settings).expect("good settings"))
    };
    Spec { config, round_deadline: is_clocked.then(|| Duration::from_hours(1)), ..spec }
}

fn stay() -> Decision {
    Decision::of_player(Act::of(Action::Stay))
}

/// The outcome of one act.
async fn act(handle: &Handle, agent: u16, round: u32) -> Option<Receipt> {
    let submission = Submission { round, decision: stay() };
    handle.submit(vec![(AgentId(agent), submission)]).await.pop()?.ok()
}

#[tokio::test]
async fn an_actor_that_panics_is_replaced_from_the_journal() {
    let bench = Bench::new(Budget::unlimited()).await;
    let handle = bench.small("ep_1").await;
    let first = act(&handle, 0, 0).await.expect("acknowledged");
    bench.journal.panics.store(true, Ordering::Relaxed);
    let mut published = handle.follow();
    assert_eq!(act(&handle, 1, 0).await, None, "what was not kept is not acknowledged");
    // A waiter for the next state notices that nothing is published any more.
    published.mark_unchanged();
    assert!(published.changed().await.is_err());
    let again = tokio::time::timeout(PATIENCE, async {
        loop {
            let found = bench.registry.find(&handle.id).await.expect("no error").expect("known");
            if let Some(receipt) = act(&found, 0, 0).await {
                break (found, receipt);
            }
            tokio::task::yield_now().await;
        }
    });
    let (found, receipt) = again.await.expect("it is replaced");
    assert_eq!(receipt, Receipt { duplicate: true, ..first }, "nothing acknowledged is lost");
    assert!(found.snapshot().waits_for(AgentId(1)));
    let last = act(&found, 1, 0).await.expect("acknowledged");
    assert!(!last.duplicate && found.snapshot().world.round() == 1);
}

#[tokio::test]
async fn an_episode_that_cannot_be_read_delays_no_other() {
    let bench = Bench::new(Budget::unlimited()).await;
    for id in ["ep_1", "ep_2"] {
        bench.small(id).await;
    }
    bench.clock.advance(Duration::from_mins(6));
    bench.registry.evict_unused();
    assert_eq!(bench.registry.in_memory(), 0);
    // The sweep looks after the oldest first.
    let [stuck, other] = ["ep_1", "ep_2"].map(|id| EpisodeId::from_text(id.to_owned()));
    *bench.journal.stuck.lock().expect("no panic") = Some(stuck);
    bench.clock.advance(Duration::from_mins(20));
    let registry = bench.registry.clone();
    let sweep = tokio::spawn(async move { registry.sweep_idle().await });
    let ended = tokio::time::timeout(PATIENCE, async {
        while bench
            .journal
            .store
            .episode(other.clone())
            .await
            .expect("read")
            .expect("kept")
            .end
            .is_none()
        {}
    });
    assert!(ended.await.is_ok(), "it is abandoned though the other is stuck");
    sweep.abort();
}

#[tokio::test]
async fn a_group_leaves_memory_to_others_and_running_games_are_recovered_in_any_case() {
    let bench = Bench::new(Budget::memory(4 << 20)).await;
    let (count, refused) = bench.fill(1).await;
    assert!(matches!(refused, CreateError::NoMemory(Exhausted::Share { .. })));
    let (used, most) = (bench.registry.budget().used(), bench.registry.budget().most());
    assert!((most / 3..=most / 2).contains(&used), "{used} of {most} bytes, not half");
    let (others, _) = bench.fill(2).await;
    assert!((1..count).contains(&others), "{others} games of somebody else");
    let organizer = bench.create("ep_own", large(true), Purpose::Organizer, 1).await;
    organizer.expect("organizers may take more than a share");
    let games = count + others + 1;
    // Also where the server is started again with less.
    let small = Budget::memory(1 << 20);
    let again = registry(&bench.journal, &bench.clock, 1000, Arc::clone(&small));
    again.recover_unfinished().await.expect("they are listed");
    assert_eq!(again.in_memory(), games);
    assert!(small.used() > small.most());
}

#[tokio::test]
async fn idle_games_of_a_group_make_room_for_its_next() {
    let bench = Bench::new(Budget::memory(1 << 20)).await;
    let create = |number: usize| {
        let id = format!("ep_{number}");
        let bench = &bench;
        async move { bench.create(&id, large(false), Purpose::Usual, 1).await.map(drop) }
    };
    assert!(create(1).await.is_ok() && create(2).await.is_ok());
    assert!(matches!(create(3).await, Err(CreateError::NoMemory(Exhausted::Share { .. }))));
    bench.clock.advance(Duration::from_secs(11));
    assert!(create(4).await.is_ok());
}

#[tokio::test]
async fn a_replay_reads_no_texts() {
    let bench = Bench::new(Budget::unlimited()).await;
    let long = ActRecord {
        message: Some("naïve \"quotes\" and \\".to_owned()),
        usage: Some(Box::new(Usage {
            prompt_tokens: Some(7),
            latency_ms: Some(12),
            ..Usage::default()
        })),
        response: Some("ACTION: STAY ".repeat(10_000)),
        reasoning: Some("because ".repeat(10_000)),
        bank_spent_ms: 3,
        ..stay().record(AgentId(0), 0)
    };
    let response = Some("ACTION: STAY".to_owned());
    let short = Decision { response, ..stay() }.record(AgentId(1), 0);
    let row = |record: &ActRecord, agent| {
        let (record, brief) = (RawRecord::write(record), record.clone().brief());
        let brief = brief_of(&record, || brief);
        let at = "2026-03-01T12:00:00Z".parse().expect("a time");
        let (episode, round, source) = (EpisodeKey(1), 4, Source::Player);
        Entry::Act(ActRow { episode, round, agent, waiting_for: 0, source, at, record, brief })
    };
    let rows = vec![row(&long, AgentId(0)), row(&short, AgentId(1))];
    bench.journal.keep(rows).await.expect("kept");
    let whole = bench.journal.round_acts(EpisodeKey(1), 4).await.expect("read");
    let played = bench.journal.acts(EpisodeKey(1), 0, 10).await.expect("read");
    assert_eq!((whole.len(), played.len(), played[0].0, played[0].1.len()), (2, 1, 4, 2));
    for (((_, whole), (_, played)), record) in whole.iter().zip(&played[0].1).zip([long, short]) {
        let bytes = RawRecord::write(&record).as_str().len() as u64;
        assert_eq!((whole.bytes, played.bytes), (bytes, bytes));
        assert_eq!(whole.record, record);
        assert_eq!(played.record, ActRecord { response: None, reasoning: None, ..record });
    }
}

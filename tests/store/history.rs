//! Histories of entries that follow from a seed: games, runs, competitions and all else that a server writes, in batches that
//! are plausible, and in some that are refused.

use std::collections::{BTreeSet, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use jiff::Timestamp;
use serde_json::{Map, Value, json};
use swarmbench::episode::spec::{Spec, Visibility};
use swarmbench::ids::{CompetitionKey, EntryKey, EpisodeId, EpisodeKey, RunKey, TokenHash};
use swarmbench::keys::{Key, KeyRow, OwnerKey, Role};
use swarmbench::store::entries::{
    ActRow, AuditRow, ClaimRow, CompetitionRow, EndRow, EntrantFacts, EntrantRow, Entry, Holder,
    ImportRow, ImportedRound, OpeningRow, RoundRow, RunRow, SeatingRow, Secret, TokenRow, brief_of,
};
use swarmbench::store::metrics::{MetricsRow, stored_method};
use swarmbench_analysis::Metric;
use swarmbench_engine::{AgentId, Config, Seed, Settings, TaskName, World};
use swarmbench_journal::Tally;
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::{ActRecord, End, Fork, RawRecord, Source, Usage, end_record};
use swarmbench_protocol::act::{Harness, UsageSums};
use swarmbench_protocol::failure::Failure;
use swarmbench_protocol::import::ImportConfig;
use swarmbench_testkit::dice::Dice;

use crate::game;
use crate::store::numbers::{Names, Side, UNKNOWN};

/// Texts of players. Those with U+0000 are stored as JSON has them, `\u0000`.
const SAID: [&str; 10] = [
    "",
    "I go north",
    "naïve \"quotes\" and \\ backslashes",
    "🐝🐝 swarm 🧠 \u{1f469}\u{200d}\u{1f680}",
    "a tab\t, a line\nand \u{0} nothing",
    "Ångström ß ẞ ſ İ ı",
    "100 %_of% 'single' quotes; DROP TABLE acts",
    "\u{ffff}\u{10ffff}\u{e000}",
    r#""source":"player""#,
    "<|end|>\r\n{{ agent }}",
];

/// Names of models, teams and suites, and reasons. A server refuses control characters in them.
pub(crate) const NAMED: [&str; 12] = [
    "model-a",
    "Model-A",
    "MODEL-A",
    "modèle",
    "модель",
    "模型",
    "🐝",
    "built-in/nobody",
    "z",
    "Z",
    "100 %",
    "it's \"quoted\"",
];

/// Mark in a text where a record is to have the escape of half a character.
const HALF: &str = "HALF-A-CHARACTER";

/// Texts longer than this are read in parts.
const LARGE: usize = 70_000;

/// Earlier entries that may be written again.
const REMEMBERED: usize = 60;

/// The next step.
pub(crate) enum Step {
    /// Jobs that are handed over at once.
    Jobs(Vec<Vec<Entry>>),
    Recover(EpisodeKey),
    Reopen,
}

/// An episode, as far as a history has to know it.
pub(crate) struct Episode {
    pub(crate) key: EpisodeKey,
    pub(crate) id: EpisodeId,
    pub(crate) agents: u16,
    pub(crate) round: u32,
    acted: BTreeSet<u16>,
    seed: Seed,
    holders: u32,
    is_claimed: BTreeSet<u16>,
    is_over: bool,
    counts: bool,
}

pub(crate) struct HistoryRun {
    pub(crate) key: RunKey,
    pub(crate) id: String,
    pub(crate) owner: Option<OwnerKey>,
    slots: u32,
}

pub(crate) struct History {
    pub(crate) dice: Dice,
    pub(crate) names: Names,
    pub(crate) episodes: Vec<Episode>,
    pub(crate) runs: Vec<HistoryRun>,
    /// Hashes of tokens, keys and invitation codes.
    pub(crate) tokens: Vec<TokenHash>,
    pub(crate) invitations: Vec<TokenHash>,
    pub(crate) idempotency: Vec<String>,
    /// Forks that were begun.
    begun: Vec<EpisodeKey>,
    /// Keys, competitions, entrants and imports that are stored.
    stored: [Vec<i64>; 4],
    queued: usize,
    earlier: VecDeque<Entry>,
    broken: BTreeSet<EpisodeKey>,
    worlds: Vec<(Arc<Config>, World)>,
    now_ms: i64,
    next: i64,
    is_new: bool,
}

/// Kinds of jobs: how often each is made, and by whom.
type Kinds = [(usize, fn(&mut History) -> Vec<Entry>)];

const KINDS: &Kinds = &[
    (14, History::open),
    (30, History::acts),
    (12, History::round),
    (10, History::end),
    (4, History::fork),
    (6, History::claim),
    (3, History::seat),
    (2, History::start),
    (3, History::replace_tokens),
    (4, History::add_key),
    (2, History::change_key),
    (4, History::import),
    (10, History::open_run),
    (5, History::change_run),
    (3, History::void),
    (2, History::add_competition),
    (5, History::change_competition),
    (8, History::add_entrant),
    (9, History::change_entrant),
    (3, History::invite),
    (4, History::measured),
    (5, History::audit),
    (9, History::again),
    (1, History::nothing),
];

impl History {
    pub(crate) fn new(seed: u64) -> Self {
        let dice = Dice::of(seed, "histories");
        let tasks = [TaskName::Foraging, TaskName::Synchronization, TaskName::Pursuit];
        let worlds = tasks.into_iter().zip(1_u16..).map(|(task, agents)| {
            let mut settings = Settings::standard(task, 27 + u64::from(agents));
            settings.num_agents = (agents * 2).into();
            let config = Arc::new(Config::check(&settings).expect("good settings"));
            let world = World::new(Arc::clone(&config));
            (config, world)
        });
        Self {
            worlds: worlds.collect(),
            dice,
            names: Names::default(),
            episodes: Vec::new(),
            runs: Vec::new(),
            tokens: Vec::new(),
            invitations: Vec::new(),
            idempotency: Vec::new(),
            begun: Vec::new(),
            stored: Default::default(),
            queued: 0,
            earlier: VecDeque::new(),
            broken: BTreeSet::new(),
            now_ms: 1_772_366_400_000,
            next: 1,
            is_new: true,
        }
    }

    pub(crate) fn step(&mut self) -> Step {
        if self.is_new {
            // Who owns things, and where entrants register.
            self.is_new = false;
            let mut jobs: Vec<_> = (0..4).map(|_| self.add_key()).collect();
            jobs.extend([self.add_competition(), self.add_competition()]);
            return Step::Jobs(jobs);
        }
        self.now_ms += i64::try_from(self.dice.below(5000)).expect("small");
        let broken = self.broken.first().copied();
        if let Some(episode) = broken.filter(|_| self.dice.one_in(3)) {
            return Step::Recover(episode);
        }
        if self.dice.one_in(50) {
            return Step::Reopen;
        }
        let count = 1 + self.dice.below(8);
        let only_rows = self.dice.one_in(3);
        let jobs = (0..count).map(|_| {
            if only_rows {
                return if self.dice.one_in(4) { self.round() } else { self.acts() };
            }
            let mut job = self.job();
            if self.dice.one_in(6) {
                job.extend(self.job());
            }
            job
        });
        Step::Jobs(jobs.collect())
    }

    /// Notes which jobs of a step were kept.
    pub(crate) fn settle(&mut self, jobs: &[Vec<Entry>], kept: &[bool]) {
        for (job, kept) in jobs.iter().zip(kept) {
            if *kept {
                self.earlier.extend(job.iter().cloned());
            } else if !job.iter().any(|entry| matches!(entry, Entry::Open(_))) {
                self.broken.extend(job.iter().filter_map(Entry::chain));
            }
        }
        while self.earlier.len() > REMEMBERED {
            let place = self.dice.below(self.earlier.len());
            self.earlier.swap_remove_front(place);
        }
    }

    pub(crate) fn learn(&mut self, side: &Side) {
        self.stored = side.stored();
        self.queued = side.queued();
    }

    pub(crate) fn is_broken(&self, episode: EpisodeKey) -> bool {
        self.broken.contains(&episode)
    }

    /// An episode continues with what is stored of it.
    pub(crate) fn resume(&mut self, key: EpisodeKey, rounds: Option<u32>) {
        self.broken.remove(&key);
        let episode = self.episodes.iter_mut().find(|episode| episode.key == key);
        if let (Some(episode), Some(rounds)) = (episode, rounds) {
            episode.round = rounds;
            // Seats that have acted in it are refused again, which is a batch that is wrong, too.
            episode.acted.clear();
        }
    }

    /// A server that was started again has no episode with a gap.
    pub(crate) fn forget_refusals(&mut self) {
        self.broken.clear();
        self.begun.clear();
    }

    fn job(&mut self) -> Vec<Entry> {
        let sum = KINDS.iter().map(|(weight, _)| weight).sum();
        let mut drawn = self.dice.below(sum);
        for (weight, make) in KINDS {
            if drawn < *weight {
                return make(self);
            }
            drawn -= weight;
        }
        unreachable!("it is less than the sum")
    }

    // Draws.

    fn at(&self) -> Timestamp {
        let later = if self.dice.one_in(4) { 0 } else { self.dice.below(1000) };
        let ms = self.now_ms + i64::try_from(later).expect("small");
        Timestamp::from_millisecond(ms).expect("a time of this century")
    }

    pub(crate) fn said(&self) -> String {
        let text = (*self.dice.pick(&SAID)).to_owned();
        if self.dice.one_in(12) { text.repeat(200) } else { text }
    }

    pub(crate) fn named(&self) -> String {
        (*self.dice.pick(&NAMED)).to_owned()
    }

    fn maybe<T>(&self, make: impl FnOnce(&Self) -> T) -> Option<T> {
        self.dice.one_in(2).then(|| make(self))
    }

    fn bytes<const N: usize>(&self) -> [u8; N] {
        std::array::from_fn(|_| u8::try_from(self.dice.below(256)).expect("a byte"))
    }

    fn hash(&mut self) -> TokenHash {
        let hash = TokenHash(self.bytes());
        self.tokens.push(hash);
        hash
    }

    fn number(&mut self) -> i64 {
        self.next += 1;
        self.next
    }

    fn id(&mut self, prefix: &str) -> String {
        format!("{prefix}{}", self.number())
    }

    /// Any score that is a number. SQLite stores -0.0 as 0.0.
    fn score(&self) -> f64 {
        let scores = [0.0, 1.0, 0.1, -2.5, 1e300, 5e-324, f64::MAX, 123_456_789.125, 1.0 / 3.0];
        if self.dice.one_in(3) {
            return *self.dice.pick(&scores);
        }
        let drawn = f64::from_bits(u64::from_le_bytes(self.bytes()));
        if drawn.is_finite() { drawn } else { 0.5 }
    }

    fn count(&self) -> u64 {
        *self.dice.pick(&[0, 1, 7, 4_000_000_000, i64::MAX as u64, u64::MAX])
    }

    pub(crate) fn owner(&self) -> Option<OwnerKey> {
        let keys = &self.stored[0];
        if keys.is_empty() || self.dice.one_in(5) {
            return self.dice.one_in(3).then_some(OwnerKey(UNKNOWN));
        }
        Some(OwnerKey(*self.dice.pick(keys)))
    }

    pub(crate) fn competition(&self) -> CompetitionKey {
        let competitions = &self.stored[1];
        if competitions.is_empty() || self.dice.one_in(15) {
            return CompetitionKey(UNKNOWN);
        }
        CompetitionKey(*self.dice.pick(competitions))
    }

    pub(crate) fn entrant(&self) -> Option<EntryKey> {
        let entries = &self.stored[2];
        (!entries.is_empty()).then(|| EntryKey(*self.dice.pick(entries)))
    }

    pub(crate) fn import_key(&self) -> Option<i64> {
        let imports = &self.stored[3];
        (!imports.is_empty()).then(|| *self.dice.pick(imports))
    }

    pub(crate) fn run(&self) -> Option<&HistoryRun> {
        (!self.runs.is_empty()).then(|| self.dice.pick(&self.runs))
    }

    /// A key for a request that may be repeated; now and then one that was used.
    fn idempotent(&mut self) -> Option<(String, [u8; 32])> {
        if self.dice.one_in(2) {
            return None;
        }
        let used = (!self.idempotency.is_empty() && self.dice.one_in(12))
            .then(|| self.dice.pick(&self.idempotency).clone());
        let key = used.unwrap_or_else(|| self.id("/idempotency "));
        self.idempotency.push(key.clone());
        Some((key, self.bytes()))
    }

    /// The place of an episode: mostly of one that is played, and mostly of a new one.
    fn episode(&self) -> Option<usize> {
        if self.episodes.is_empty() {
            return None;
        }
        for _ in 0..10 {
            let recent = self.episodes.len().min(8);
            let place = if self.dice.one_in(4) {
                self.dice.below(self.episodes.len())
            } else {
                self.episodes.len() - 1 - self.dice.below(recent)
            };
            if !self.episodes[place].is_over || self.dice.one_in(20) {
                return Some(place);
            }
        }
        None
    }

    fn meta(&self) -> Map<String, Value> {
        let mut meta = Map::new();
        if self.dice.one_in(2) {
            meta.insert("note".to_owned(), self.said().into());
        }
        if self.dice.one_in(6) {
            // Names that openings have at another place.
            meta.insert("prompt_template".to_owned(), "free text ".repeat(40).into());
        }
        if self.dice.one_in(8) {
            meta.insert("custom_template".to_owned(), true.into());
        }
        if self.dice.one_in(8) {
            meta.insert("half".to_owned(), HALF.into());
        }
        meta
    }

    fn template(&self) -> Arc<str> {
        let large = |text: &str| format!("{text} {{{{ agent }}}} ").repeat(40).into();
        match self.dice.below(5) {
            0 => "".into(),
            1 => "short {{ agent }}".into(),
            2 => large("built-in"),
            3 => large("ü\"\\🐝\u{0}"),
            _ => large(&self.said()),
        }
    }

    // Jobs.

    fn nothing(_: &mut Self) -> Vec<Entry> {
        Vec::new()
    }

    /// Entries that were written before.
    fn again(&mut self) -> Vec<Entry> {
        if self.earlier.is_empty() {
            return Vec::new();
        }
        let place = self.dice.below(self.earlier.len());
        let entry = self.earlier[place].clone();
        if self.dice.one_in(2) {
            return vec![entry];
        }
        let mut job = self.acts();
        job.push(entry);
        job
    }

    fn open(&mut self) -> Vec<Entry> {
        let key = EpisodeKey(self.number());
        let id = EpisodeId::from_text(format!("ep_{}", key.0));
        let row = self.opening(key, id, None);
        vec![Entry::Open(Box::new(row))]
    }

    fn opening(
        &mut self,
        key: EpisodeKey,
        id: EpisodeId,
        fork: Option<(EpisodeKey, String, u32)>,
    ) -> OpeningRow {
        let world = self.dice.below(self.worlds.len());
        let (config, world) = self.worlds[world].clone();
        let agents = config.num_agents();
        let at = self.at();
        let run = if fork.is_none() && self.dice.one_in(2) { self.next_slot() } else { None };
        let has_open_seats = agents > 1 && self.dice.one_in(4);
        let may_be_clocked = self.dice.one_in(3);
        let visibilities = [Visibility::Public, Visibility::Owner, Visibility::Sealed];
        let spec = Spec {
            visibility: *self.dice.pick(&visibilities),
            manual_start: self.dice.one_in(4),
            round_deadline: may_be_clocked.then(|| Duration::from_secs(30)),
            model: self.named(),
            agent_meta: self.meta().into(),
            prompt_template: self.template(),
            custom_template: self.dice.one_in(3),
            run: run.as_ref().map(|(_, id, _)| id.clone()),
            salt: self.maybe(|_| "00ff".repeat(8)),
            fork: fork.as_ref().map(|(_, parent, round)| Fork {
                episode: parent.clone(),
                round: *round,
                head: "ab".repeat(32),
            }),
            own_games: self.dice.one_in(3),
            open_seats: if has_open_seats { vec![AgentId(agents - 1)] } else { Vec::new() },
            player: self.dice.one_in(6).then(|| "greedy".to_owned()),
            ..game::spec((*config).clone())
        };
        let record = with_halves(RawRecord::write(&spec.opening(&id, at, &world)));
        let round = fork.as_ref().map_or(0, |(.., round)| *round);
        let counts = spec.counts();
        self.episodes.push(Episode {
            key,
            id: id.clone(),
            agents,
            round,
            acted: BTreeSet::new(),
            seed: config.seed(),
            holders: 0,
            is_claimed: BTreeSet::new(),
            is_over: false,
            counts,
        });
        let tokens = if self.dice.one_in(3) { Vec::new() } else { self.some_tokens(agents, None) };
        OpeningRow {
            episode: key,
            id,
            owner: self.owner(),
            run: run.map(|(run, _, slot)| (run, slot)),
            fork: fork.map(|(parent, _, round)| (parent, round)),
            head: Head(self.bytes()),
            task: config.task().name(),
            model: spec.model.clone(),
            visibility: spec.visibility.name(),
            waiting: spec.begins_waiting(),
            is_mixed: has_open_seats,
            has_people: self.dice.one_in(6),
            own_games: spec.own_games,
            clocked: spec.round_deadline.is_some(),
            at,
            idempotency: self.idempotent(),
            tokens,
            record,
        }
    }

    fn some_tokens(&mut self, agents: u16, holder: Option<u32>) -> Vec<TokenRow> {
        let agents = (0..agents).map(|agent| Some(AgentId(agent))).chain([None]);
        agents.map(|agent| TokenRow { hash: self.hash(), agent, holder }).collect()
    }

    /// A run, its id, and a game of its plan; now and then one that is played already.
    fn next_slot(&mut self) -> Option<(RunKey, String, u32)> {
        if self.runs.is_empty() {
            return None;
        }
        let place = self.dice.below(self.runs.len());
        let plays_again = self.dice.one_in(5);
        let run = &mut self.runs[place];
        if !plays_again {
            run.slots += 1;
        }
        Some((run.key, run.id.clone(), run.slots))
    }

    fn fork(&mut self) -> Vec<Entry> {
        if !self.begun.is_empty() && self.dice.one_in(2) {
            // Its last commit.
            let key = self.begun.swap_remove(self.dice.below(self.begun.len()));
            let Some(parent) = self.episode() else { return Vec::new() };
            let parent = &self.episodes[parent];
            let fork = (parent.key, parent.id.to_string(), 1);
            let id = EpisodeId::from_text(format!("ep_{}", key.0));
            let row = self.opening(key, id, Some(fork));
            return vec![Entry::Open(Box::new(row))];
        }
        let count = if self.dice.one_in(6) { 20 } else { 1 + self.dice.below(3) };
        let keys: Vec<_> = (0..count).map(|_| EpisodeKey(self.number())).collect();
        let mut entries = vec![Entry::BeginForks(keys.clone())];
        for &key in &keys {
            entries.push(Entry::Act(self.act(key, 0, AgentId(0))));
            entries.push(Entry::Round(self.round_row(key, 0)));
        }
        self.begun.extend(keys);
        entries
    }

    fn act(&self, episode: EpisodeKey, round: u32, agent: AgentId) -> ActRow {
        let source = if self.dice.one_in(6) { Source::Clock } else { Source::Player };
        let failure = self.dice.one_in(5).then(|| *self.dice.pick(&Failure::ALL));
        let usage = self.maybe(|draw| Usage {
            prompt_tokens: draw.maybe(Self::count),
            completion_tokens: draw.maybe(Self::count),
            latency_ms: draw.maybe(Self::count),
            first_token_ms: draw.maybe(Self::count),
            cached_tokens: draw.maybe(Self::count),
            cache_write_tokens: draw.maybe(Self::count),
            reasoning_tokens: draw.maybe(Self::count),
            cost_nano_usd: draw.maybe(Self::count),
        });
        let record = ActRecord {
            agent: agent.to_string(),
            source,
            action: self.maybe(|_| "STAY".to_owned()),
            message: self.maybe(Self::said),
            to: self.dice.one_in(8).then(|| "Agent_0".to_owned()),
            valid: failure.is_none(),
            failure,
            response: self.maybe(Self::said),
            usage: usage.map(Box::new),
            reasoning: self
                .maybe(|draw| if draw.dice.one_in(20) { draw.large() } else { draw.said() }),
            harness: self.maybe(|draw| {
                let (added, scratchpad) = (draw.maybe(Self::said), draw.maybe(Self::said));
                Box::new(Harness { history: vec![1], added, scratchpad, ..Harness::default() })
            }),
            bank_spent_ms: if self.dice.one_in(4) { self.count() } else { 0 },
        };
        let brief = record.clone().brief();
        let record = RawRecord::write(&record);
        // Versions before briefs stored none.
        let brief = if self.dice.one_in(6) { None } else { brief_of(&record, || brief) };
        let waiting_for = u32::try_from(self.dice.below(20)).expect("small");
        ActRow { episode, round, agent, waiting_for, source, at: self.at(), record, brief }
    }

    fn large(&self) -> String {
        "very long \u{0} \"🐝\" ".repeat(LARGE / 20 + self.dice.below(100))
    }

    fn acts(&mut self) -> Vec<Entry> {
        let Some(place) = self.episode() else { return Vec::new() };
        let episode = &self.episodes[place];
        let (key, round) = (episode.key, episode.round);
        let missing: Vec<_> =
            (0..episode.agents).filter(|agent| !episode.acted.contains(agent)).collect();
        if missing.is_empty() {
            return self.resolve(place);
        }
        let count = 1 + self.dice.below(missing.len());
        let acting = &missing[..count];
        self.episodes[place].acted.extend(acting);
        let acts = acting.iter().map(|agent| Entry::Act(self.act(key, round, AgentId(*agent))));
        acts.collect()
    }

    fn round_row(&self, episode: EpisodeKey, round: u32) -> RoundRow {
        let (digest, head) = (self.bytes(), Head(self.bytes()));
        RoundRow { episode, round, digest, score: self.score(), head, at: self.at() }
    }

    fn resolve(&mut self, place: usize) -> Vec<Entry> {
        let row = self.round_row(self.episodes[place].key, self.episodes[place].round);
        self.episodes[place].round += 1;
        self.episodes[place].acted.clear();
        vec![Entry::Round(row)]
    }

    /// All acts of a round that are missing, and the round.
    fn round(&mut self) -> Vec<Entry> {
        let Some(place) = self.episode() else { return Vec::new() };
        let episode = &self.episodes[place];
        let (key, round) = (episode.key, episode.round);
        let missing: Vec<_> =
            (0..episode.agents).filter(|agent| !episode.acted.contains(agent)).collect();
        let acts = missing.into_iter().map(|agent| self.act(key, round, AgentId(agent)));
        let mut entries: Vec<_> = acts.map(Entry::Act).collect();
        entries.extend(self.resolve(place));
        entries
    }

    fn end(&mut self) -> Vec<Entry> {
        let Some(place) = self.episode() else { return Vec::new() };
        self.episodes[place].is_over = true;
        let Episode { key, round, seed, counts, .. } = self.episodes[place];
        let (status, reason) = *self.dice.pick(&[
            ("finished", "task_done"),
            ("finished", "rounds_played"),
            ("aborted", "aborted"),
            ("abandoned", "idle"),
        ]);
        let score = self.score();
        // Few bytes, more than lists read, or more than are read at once.
        let texts = match self.dice.below(6) {
            0 => self.large(),
            1 | 2 => self.said().repeat(30) + HALF,
            _ => String::new(),
        };
        let open = ActRecord {
            reasoning: Some(texts.clone()),
            ..self.act(key, round, AgentId(0)).record.read().expect("it is one")
        };
        let open = RawRecord::write(&open);
        let record = with_halves(end_record(End {
            status: status.to_owned(),
            reason: reason.to_owned(),
            rounds: round,
            score,
            open_acts: if texts.is_empty() { Vec::new() } else { vec![&open] },
        }));
        let mut tally = Tally {
            acts: self.count(),
            invalid: self.count(),
            timeouts: self.count(),
            prompt_tokens: self.count(),
            completion_tokens: self.count(),
            usage: UsageSums {
                cached_tokens: self.count(),
                reasoning_tokens: self.count(),
                cost_nano_usd: self.count(),
                ..UsageSums::NONE
            },
            ..Tally::default()
        };
        for _ in 0..self.dice.below(4) {
            tally.failures.count(*self.dice.pick(&Failure::ALL));
        }
        let row = EndRow {
            episode: key,
            status,
            reason,
            record,
            head: Head(self.bytes()),
            bytes: if self.dice.one_in(100) { self.count() } else { self.dice.below(5000) as u64 },
            score,
            rounds: round,
            seed,
            tally,
            counts: counts || self.dice.one_in(10),
            at: self.at(),
        };
        vec![Entry::End(row)]
    }

    fn start(&mut self) -> Vec<Entry> {
        let Some(place) = self.episode() else { return Vec::new() };
        vec![Entry::Start { episode: self.episodes[place].key, at: self.at() }]
    }

    fn claim(&mut self) -> Vec<Entry> {
        let Some(place) = self.episode() else { return Vec::new() };
        let (key, number) = (self.episodes[place].key, self.episodes[place].holders);
        let episode = &self.episodes[place];
        let free = (0..episode.agents).filter(|agent| !episode.is_claimed.contains(agent));
        let mut agents: Vec<_> = free.map(AgentId).collect();
        agents.truncate(self.dice.below(agents.len() + 1));
        self.episodes[place].is_claimed.extend(agents.iter().map(|agent| agent.0));
        self.episodes[place].holders += 1;
        let owner = self.owner();
        let names = &self.names.keys;
        let of_key = owner.and_then(|owner| names.get(usize::try_from(owner.0).ok()?).cloned());
        let hosted = self.dice.one_in(3);
        let model = if hosted { "built-in/greedy".to_owned() } else { self.named() };
        let mut agent_meta = self.meta();
        agent_meta.remove("half");
        let holder = Holder {
            number,
            owner,
            key: of_key,
            model,
            agent_meta: agent_meta.into(),
            player: hosted.then(|| "greedy".to_owned()),
            at: self.at(),
        };
        let count = u16::try_from(agents.len()).expect("few");
        let tokens = self.some_tokens(count, Some(number));
        let idempotency = self.idempotent();
        vec![Entry::Claim(Box::new(ClaimRow { episode: key, holder, agents, tokens, idempotency }))]
    }

    fn seat(&mut self) -> Vec<Entry> {
        let Some(place) = self.episode() else { return Vec::new() };
        let seats = json!({"kind": "seats", "holders": [], "seats": [], "note": self.said()});
        vec![Entry::Seat(SeatingRow {
            episode: self.episodes[place].key,
            record: RawRecord::write(&seats),
            head: Head(self.bytes()),
        })]
    }

    fn replace_tokens(&mut self) -> Vec<Entry> {
        let Some(place) = self.episode() else { return Vec::new() };
        let Episode { key, agents, holders, .. } = self.episodes[place];
        let holder = (holders > 0 && self.dice.one_in(2)).then(|| holders - 1);
        let tokens = self.some_tokens(agents, holder);
        vec![Entry::ReplaceTokens { episode: key, holder, agents: (-1, i64::MAX), tokens }]
    }

    fn add_key(&mut self) -> Vec<Entry> {
        let id = self.id("key_");
        self.names.keys.push(id.clone());
        let row = KeyRow {
            key: Key {
                number: None,
                id,
                role: *self.dice.pick(&Role::ALL),
                name: self.named(),
                created_at: self.at(),
                expires_at: self.maybe(Self::at),
                revoked_at: None,
            },
            hash: self.hash(),
            acts_for: if self.dice.one_in(3) { self.owner() } else { None },
        };
        vec![Entry::AddKey(Box::new(row))]
    }

    fn change_key(&mut self) -> Vec<Entry> {
        if self.names.keys.is_empty() {
            return Vec::new();
        }
        let id = self.dice.pick(&self.names.keys).clone();
        if self.dice.one_in(2) {
            return vec![Entry::RevokeKey { id, at: self.at() }];
        }
        let used = self.dice.one_in(6) && !self.tokens.is_empty();
        let hash = if used { *self.dice.pick(&self.tokens) } else { self.hash() };
        vec![Entry::ReplaceKey { id, hash }]
    }

    fn import(&mut self) -> Vec<Entry> {
        let (digest, id) = if !self.names.imports.is_empty() && self.dice.one_in(3) {
            // The same game, with or without its acts.
            let place = self.dice.below(self.names.imports.len());
            (TokenHash::of(&place.to_string()).0, self.names.imports[place].clone())
        } else {
            let id = self.id("import_");
            self.names.imports.push(id.clone());
            (TokenHash::of(&(self.names.imports.len() - 1).to_string()).0, id)
        };
        let resolved = u32::try_from(self.dice.below(20)).expect("small");
        let has_acts = self.dice.one_in(2);
        let rounds = (0..=resolved).map(|round| ImportedRound {
            round,
            score: self.score(),
            state: half(&json!({"said": self.said(), "half": HALF}).to_string()),
            acts: has_acts.then(|| self.bytes::<20>().to_vec()),
        });
        let game = ImportRow {
            id,
            digest,
            run_id: self.named(),
            meta: half(&json!({"said": self.said(), "half": HALF}).to_string()),
            model: self.named(),
            task: (*self.dice.pick(&["foraging", "Foraging", "flocking"])).to_owned(),
            seed: self.count(),
            settings: ImportConfig {
                num_agents: 4,
                max_round: 100,
                width: 20,
                height: 20,
                view_size: 5,
                rules: self.maybe(|_| "paper".to_owned()),
                control: None,
                memory: self.maybe(|_| i64::MAX),
                noise: self.maybe(Self::score),
                max_delay: None,
                answer_reader: None,
            },
            score: self.score(),
            resolved,
            acts: if has_acts { self.count() } else { 0 },
            rounds: rounds.collect(),
        };
        vec![Entry::Import { game: Box::new(game), at: self.at() }]
    }

    fn open_run(&mut self) -> Vec<Entry> {
        let key = RunKey(self.number());
        let id = format!("run_{}", key.0);
        let owner = self.owner();
        let number = u32::try_from(1 + self.dice.below(3)).expect("small");
        let attempt = self.maybe(Self::entrant).flatten().map(|entry| (entry, number));
        self.runs.push(HistoryRun { key, id: id.clone(), owner, slots: 0 });
        let visibility = *self.dice.pick(&["public", "owner", "sealed"]);
        let row = RunRow {
            run: key,
            id,
            owner,
            suite: (*self.dice.pick(&["quick", "Quick", "full"])).to_owned(),
            digest: self.named(),
            definition: half(&json!({"model": self.said(), "half": HALF}).to_string()),
            model: self.named(),
            visibility,
            attempt,
            replays: attempt.is_some_and(|_| self.dice.one_in(4)).then_some(1),
            at: self.at(),
            idempotency: self.idempotent(),
            closes_at: self.dice.one_in(3).then(|| self.at()),
        };
        let hash = self.dice.one_in(2).then(|| self.hash());
        let token = hash.map(|hash| Entry::ReplaceRunToken { run: key, holder: None, hash });
        [Entry::OpenRun(Box::new(row))].into_iter().chain(token).collect()
    }

    fn change_run(&mut self) -> Vec<Entry> {
        let Some(HistoryRun { key, .. }) = self.run() else { return Vec::new() };
        let run = *key;
        let status = *self.dice.pick(&["finished", "aborted", "closed"]);
        let hash = self.hash();
        let sent = *self.dice.pick(&self.tokens);
        match self.dice.below(6) {
            0 => vec![Entry::ReplaceRunToken { run, holder: None, hash }],
            1 => vec![Entry::CheckToken(sent), Entry::ReplaceRunToken { run, holder: None, hash }],
            2 => vec![Entry::ReopenRun { run }],
            _ => vec![Entry::EndRun { run, status, at: self.at() }],
        }
    }

    fn void(&mut self) -> Vec<Entry> {
        let (reason, at) = (self.named(), self.at());
        if self.dice.one_in(2) {
            let Some(HistoryRun { key, .. }) = self.run() else { return Vec::new() };
            return vec![Entry::VoidRun { run: *key, reason, at }];
        }
        let Some(place) = self.episode() else { return Vec::new() };
        vec![Entry::VoidEpisode { episode: self.episodes[place].key, reason, at }]
    }

    fn add_competition(&mut self) -> Vec<Entry> {
        let id = self.id("comp_");
        self.names.competitions.push(id.clone());
        vec![Entry::AddCompetition(Box::new(CompetitionRow {
            id,
            definition: half(&json!({"name": self.said(), "half": HALF}).to_string()),
            salt: Secret(self.bytes::<32>().to_vec()),
            seeds: Secret(self.bytes::<48>().to_vec()),
            commitment: self.bytes(),
            opens_at: self.at(),
            closes_at: self.at(),
            at: self.at(),
        }))]
    }

    fn change_competition(&mut self) -> Vec<Entry> {
        let (competition, at) = (self.competition(), self.at());
        vec![match self.dice.below(7) {
            0 => Entry::Reveal { competition, at },
            1 => Entry::CancelCompetition { competition, reason: self.named(), at },
            2 | 3 => Entry::ExtendAttempts {
                competition,
                number: u32::try_from(1 + self.dice.below(3)).expect("small"),
                closes_at: at,
            },
            _ => Entry::ChangeCompetition {
                competition,
                definition: json!({"name": self.said()}).to_string(),
                closes_at: at,
                hidden: self.dice.one_in(3),
            },
        }]
    }

    fn add_entrant(&mut self) -> Vec<Entry> {
        let id = self.id("entry_");
        self.names.entries.push(id.clone());
        let owner = if self.names.keys.is_empty() || self.dice.one_in(10) {
            "key_of_nobody".to_owned()
        } else {
            self.dice.pick(&self.names.keys).clone()
        };
        let mut declaration = json!({"model": self.said(), "agent_meta": {"half": HALF}});
        if self.dice.one_in(2) {
            declaration["prompt_template"] = self.large().into();
        }
        let declaration = match self.dice.below(12) {
            0 => "no object".to_owned(),
            _ => half(&declaration.to_string()),
        };
        let invitation = (!self.invitations.is_empty() && self.dice.one_in(2))
            .then(|| *self.dice.pick(&self.invitations));
        vec![Entry::AddEntrant(Box::new(EntrantRow {
            id,
            competition: self.competition(),
            owner,
            name: self.named(),
            model: self.named(),
            declaration,
            template: self.maybe(Self::named),
            vouched: self.dice.one_in(2),
            invitation,
            address: self.maybe(|_| "2001:db8::/64".to_owned()),
            category: self.maybe(Self::named),
            terms: self.maybe(|draw| u32::try_from(draw.dice.below(4)).expect("small")),
            contact: self.maybe(Self::named),
            at: self.at(),
        }))]
    }

    fn change_entrant(&mut self) -> Vec<Entry> {
        // A name is given to those alone that are stored.
        let Some(entry) = self.entrant() else { return Vec::new() };
        let (name, at) = (self.named(), self.at());
        let status = *self.dice.pick(&["active", "withdrawn", "disqualified"]);
        vec![match self.dice.below(6) {
            0 => Entry::RenameEntrant { entry, name, by_itself: self.dice.below(2) == 0 },
            1 => Entry::EraseEntrant { entry, name: format!("Entrant {}", entry.0), at },
            2 => Entry::DescribeEntrant(Box::new(EntrantFacts {
                entry,
                category: self.maybe(Self::named),
                terms: self.maybe(|draw| u32::try_from(draw.dice.below(4)).expect("small")),
                contact: self.maybe(Self::named),
            })),
            _ => Entry::SetEntrant {
                entry,
                status,
                reason: self.maybe(Self::named),
                vouched: self.dice.one_in(2),
            },
        }]
    }

    fn invite(&mut self) -> Vec<Entry> {
        let at = self.at();
        if !self.invitations.is_empty() && self.dice.one_in(3) {
            let count = 1 + self.dice.below(3);
            let hashes = (0..count).map(|_| *self.dice.pick(&self.invitations)).collect();
            return vec![Entry::RevokeInvitations { hashes, at }];
        }
        let count = 1 + self.dice.below(4);
        let codes: Vec<_> = (0..count).map(|_| (TokenHash(self.bytes()), self.named())).collect();
        self.invitations.extend(codes.iter().map(|(hash, _)| *hash));
        vec![Entry::AddInvitations { competition: self.competition(), codes, at }]
    }

    fn measured(&mut self) -> Vec<Entry> {
        let Some(place) = self.episode() else { return Vec::new() };
        let some = self.dice.below(self.queued.max(1));
        let number = (self.queued > 0).then(|| i64::try_from(some).expect("small"));
        let (embedder, revision) = stored_method();
        let values = Metric::ALL.iter().filter(|_| self.dice.one_in(2)).map(|metric| {
            let value = self.maybe(Self::score);
            (metric.name().to_owned(), json!([value, self.dice.below(9)]))
        });
        let paper: Map<_, _> = values.collect();
        let row = MetricsRow {
            episode: self.episodes[place].key,
            embedder: if self.dice.one_in(5) { "another".to_owned() } else { embedder.to_owned() },
            revision: if self.dice.one_in(5) { revision + 1 } else { revision },
            measured: json!({"sampled": false, "paper": paper, "toolkit": {}}).to_string(),
        };
        let metrics = (!self.dice.one_in(4)).then(|| Box::new(row));
        vec![Entry::Measured { number, metrics }]
    }

    fn audit(&mut self) -> Vec<Entry> {
        let newest_ms = self.maybe(|draw| draw.now_ms);
        let detail = json!({"said": self.said(), "newest_ms": newest_ms});
        let action = *self.dice.pick(&["key.create", "entrant.set", "clock.confirm", "Key.Create"]);
        let shown = self.maybe(|draw| (draw.competition(), json!({"said": draw.said()})));
        vec![Entry::Audit(Box::new(AuditRow {
            at: self.at(),
            who: self.named(),
            action,
            subject: self.named(),
            detail,
            shown,
        }))]
    }
}

/// A text of JSON with halves of characters, which are escaped there and are in no Unicode text.
fn half(json: &str) -> String {
    json.replace(HALF, r"half \ud83d and \udc1d\ud83d")
}

fn with_halves(record: RawRecord) -> RawRecord {
    if record.as_str().contains(HALF) {
        RawRecord::from_stored(half(record.as_str())).expect("it is JSON")
    } else {
        record
    }
}

//! Fills a new database with games played in memory: in minutes, the database of a server after years of use. Every journal
//! is a real one, and all rows are written by the store's own writer.
//!
//! `game` plays one game; `competition` creates a competition, whose attempts are runs like others.

mod competition;
pub(crate) mod game;

use std::sync::Arc;
use std::time::Duration;

use futures::{StreamExt, TryStreamExt, stream};
use jiff::Timestamp;
use swarmbench::episode::spec::Spec;
use swarmbench::ids::{EpisodeKey, RunKey, Token};
use swarmbench::keys::{Key, KeyRow, OwnerKey, Role};
use swarmbench::run::definition::{self, Definition};
use swarmbench::run::new_id;
use swarmbench::store::entries::{Entry, RunRow};
use swarmbench::store::{Location, OpenError, Store, StoreError};
use swarmbench_clock::{Clock, Entropy, SystemClock, after};
use swarmbench_protocol::carried::Carried;
use swarmbench_protocol::status::Visibility;
use swarmbench_protocol::suite::{Suite, SuiteSettings};
use swarmbench_testkit::host::SeededEntropy;

use competition::{Competition, OPEN_GAMES, Shape};
use game::NewGame;

/// Games of a run.
const RUN_GAMES: u64 = 20;

/// One game in this many belongs to no run and has tokens of its own.
const SINGLE_ONE_IN: u64 = 5;

/// Episodes for each competition. Smaller databases have one competition.
const EPISODES_PER_COMPETITION: u64 = 100_000;

/// One game in this many belongs to a competition.
const COMPETITION_ONE_IN: u64 = 10;

/// Number of keys that create episodes.
const OWNERS: u64 = 100;
const MODELS: u64 = 1000;

/// Time over which the games are spread.
const SPAN: Duration = Duration::from_hours(90 * 24);

/// The longest idle timeout: an episode that nobody plays stays unfinished.
const IDLE_TIMEOUT_MS: u64 = 31_536_000_000;

/// Time between the last game and now.
const REST: Duration = Duration::from_hours(24);

/// Pieces in memory at once, being made or waiting for the disk. They bound the memory use.
const PIECES_AT_ONCE: usize = 4;

/// Determines all games, names and tokens.
const SEED: u64 = 1;

/// Agents, and the most rounds, of each episode. Some tasks end earlier.
const AGENTS: i64 = 4;
const ROUNDS: i64 = 4;

/// Single episodes, or attempts of few games, in a piece.
const PIECE_EPISODES: u64 = 100;

/// Contents of the database.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fill {
    /// Number of ended episodes.
    pub(crate) episodes: u64,
    /// Entrants of a further competition, which is open; 0 for none.
    pub(crate) entrants: u32,
    /// Attempts of each of these entrants, with two games each.
    pub(crate) attempts: u32,
}

#[derive(Debug)]
pub(crate) struct Filled {
    pub(crate) episodes: u64,
    pub(crate) runs: u64,
    /// Acts of all games.
    pub(crate) acts: u64,
    /// Ids of all competitions.
    pub(crate) competitions: Vec<String>,
    /// Token of an organizer.
    pub(crate) organizer: Token,
}

#[derive(Debug, thiserror::Error)]
pub(crate) enum FillError {
    #[error(transparent)]
    Open(#[from] OpenError),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("such games cannot be played: {0}")]
    Settings(String),
    /// Ids and times follow from the seed and would collide with existing ones.
    #[error("{0} has games: name an empty database")]
    NotEmpty(String),
}

/// Fills a new database. `progress` gets the durable and the total number of episodes.
pub(crate) async fn fill(
    location: &Location,
    fill: Fill,
    progress: impl FnMut(u64, u64),
) -> Result<Filled, FillError> {
    let store = Store::open(location).await?;
    if store.last_key().await? > 0 {
        store.close().await;
        return Err(FillError::NotEmpty(location.to_string()));
    }
    let filled = Filling::new(store.clone(), fill).all(progress).await;
    store.close().await;
    filled
}

/// Runs or episodes whose entries are committed together.
enum Piece {
    /// A run of a suite with all its games.
    Run { run: RunKey, first: EpisodeKey },
    /// Episodes without a run.
    Singles { first: EpisodeKey, count: u64 },
    /// Attempts in a competition with all their games: `count` attempts from `index` on.
    Attempts {
        competition: Arc<Competition>,
        index: usize,
        count: usize,
        run: RunKey,
        first: EpisodeKey,
    },
}

struct Filling {
    store: Store,
    fill: Fill,
    /// Time of the first game.
    since: Timestamp,
    suites: Vec<Suite>,
}

impl Filling {
    fn new(store: Store, fill: Fill) -> Self {
        let now = SystemClock.wall();
        let back = |by| now.checked_sub(by).unwrap_or(Timestamp::UNIX_EPOCH);
        let since = Timestamp::from_millisecond(back(SPAN + REST).as_millisecond()).unwrap_or(now);
        let suites = ["small", "small-late"].map(suite).to_vec();
        Self { store, fill, since, suites }
    }

    async fn all(self, mut progress: impl FnMut(u64, u64)) -> Result<Filled, FillError> {
        let organizer = self.add_keys().await?;
        let (pieces, made) = self.pieces().await?;
        let filling = Arc::new(self);
        let made_pieces = stream::iter(pieces).map(|piece| {
            let filling = Arc::clone(&filling);
            async move {
                let games = piece.games();
                let made = Arc::clone(&filling);
                let entries = tokio::task::spawn_blocking(move || made.entries(piece)).await;
                let entries = entries.map_err(|error| FillError::Settings(error.to_string()))?;
                let entries = entries.map_err(FillError::Settings)?;
                let acts = entries.iter().filter(|entry| matches!(entry, Entry::Act(_))).count();
                filling.store.keep(entries).await?;
                Ok::<_, FillError>((games, acts as u64))
            }
        });
        let mut kept = made_pieces.buffered(PIECES_AT_ONCE);
        let (mut episodes, mut acts, of) = (0, 0, made.episodes);
        while let Some((games, of_these)) = kept.try_next().await? {
            episodes += games;
            acts += of_these;
            progress(episodes, of);
        }
        for competition in made.competitions.iter().filter(|competition| competition.is_over) {
            let at = competition.closes_at();
            filling.store.keep(vec![Entry::Reveal { competition: competition.key, at }]).await?;
        }
        let competitions = made.competitions.iter().map(|cup| cup.id.clone()).collect();
        Ok(Filled { episodes, runs: made.runs, acts, competitions, organizer })
    }

    /// Adds an organizer, whose token is returned, and the keys that own episodes.
    async fn add_keys(&self) -> Result<Token, FillError> {
        let entropy = random(b'k', 0);
        let key = |role, name: &str| {
            let made = Key::new(role, name, None, self.since, &entropy);
            made.map(|(key, token)| {
                (Entry::AddKey(Box::new(KeyRow { key, hash: token.hash(), acts_for: None })), token)
            })
        };
        let (entry, organizer) = key(Role::Organizer, "organizer").map_err(FillError::Settings)?;
        let mut entries = vec![entry];
        for owner in 0..OWNERS {
            entries
                .push(key(Role::Member, &format!("owner {owner}")).map_err(FillError::Settings)?.0);
        }
        self.store.keep(entries).await?;
        Ok(organizer)
    }

    /// The pieces in order of writing. Creates the competitions, without attempts.
    async fn pieces(&self) -> Result<(Vec<Piece>, Made), FillError> {
        let of = self.fill.episodes;
        let count = of.div_ceil(EPISODES_PER_COMPETITION);
        let each = of / COMPETITION_ONE_IN / count;
        let mut made = Made { episodes: 0, runs: 0, competitions: Vec::new() };
        let mut pieces = Vec::new();
        for number in 0..count {
            let cup = Competition::create(self, number, Shape::over(self, each)).await?;
            made.competitions.push(Arc::new(cup));
        }
        let mut cups = made.competitions.clone().into_iter();
        while made.episodes < of {
            // Competitions are spread evenly between the other pieces.
            let begun = (count - cups.len() as u64) * EPISODES_PER_COMPETITION.min(of / count);
            if made.episodes >= begun
                && let Some(competition) = cups.next()
            {
                for index in 0..competition.attempts() {
                    pieces.push(made.attempts(&competition, index, 1));
                }
            }
            let (run, first) = made.next_run(RUN_GAMES);
            pieces.push(Piece::Run { run, first });
            if made.runs.is_multiple_of(PIECE_EPISODES / RUN_GAMES * (SINGLE_ONE_IN - 1)) {
                let first = made.next(PIECE_EPISODES);
                pieces.push(Piece::Singles { first, count: PIECE_EPISODES });
            }
        }
        if self.fill.entrants > 0 {
            let shape = Shape::open(self, self.fill.entrants, self.fill.attempts);
            let cup = Arc::new(Competition::create(self, count, shape).await?);
            let at_once = usize::try_from(PIECE_EPISODES).unwrap_or(1);
            for index in (0..cup.attempts()).step_by(at_once) {
                let count = at_once.min(cup.attempts() - index);
                pieces.push(made.attempts(&cup, index, count));
            }
            made.competitions.push(cup);
        }
        Ok((pieces, made))
    }

    /// Time of an episode's creation; episodes are spread evenly.
    fn at(&self, episode: EpisodeKey) -> Timestamp {
        let millis = u128::from(episode.0.unsigned_abs()) * SPAN.as_millis();
        let of_attempts = u64::from(self.fill.entrants) * u64::from(self.fill.attempts);
        let all = self.fill.episodes + of_attempts * OPEN_GAMES;
        let millis = millis / u128::from(all.max(1));
        let at = after(self.since, Duration::from_millis(u64::try_from(millis).unwrap_or(0)));
        // The database stores milliseconds.
        Timestamp::from_millisecond(at.as_millisecond()).unwrap_or(at)
    }

    fn entries(&self, piece: Piece) -> Result<Vec<Entry>, String> {
        match piece {
            Piece::Run { run, first } => {
                let number = run.0.unsigned_abs();
                let suite = &self.suites[usize::try_from(number).unwrap_or(0) % self.suites.len()];
                let definition = definition(suite.clone(), format!("model-{}", number % MODELS));
                self.run(run, first, &definition, None, Some(owner(number)))
            }
            Piece::Attempts { competition, index, count, run, first } => {
                let mut entries = Vec::new();
                let games = competition.games().cast_signed();
                for (index, place) in (index..).zip(0_i64..).take(count) {
                    let (attempt, owner, definition) = competition.attempt(index)?;
                    let (run, first) = (RunKey(run.0 + place), EpisodeKey(first.0 + place * games));
                    let of = self.run(run, first, &definition, Some(attempt), Some(owner))?;
                    entries.extend(of);
                }
                Ok(entries)
            }
            Piece::Singles { first, count } => {
                let mut entries = Vec::new();
                for episode in (first.0..).take(usize::try_from(count).unwrap_or(0)) {
                    entries.extend(self.single(EpisodeKey(episode))?);
                }
                Ok(entries)
            }
        }
    }

    /// An ended run with all its games.
    fn run(
        &self,
        run: RunKey,
        first: EpisodeKey,
        definition: &Definition,
        attempt: Option<(swarmbench::ids::EntryKey, u32)>,
        owner: Option<OwnerKey>,
    ) -> Result<Vec<Entry>, String> {
        let entropy = random(b'r', run.0.unsigned_abs());
        let at = self.at(first);
        let visibility =
            Visibility::parse(&definition.visibility).ok_or("an unknown visibility")?;
        let row = run_row(run, definition, visibility, at, &entropy);
        let id = row.id.clone();
        let row = RunRow { owner, attempt, closes_at: attempt.and(definition.closes_at), ..row };
        let hash = Token::new(swarmbench::ids::TokenKind::Swarm, &entropy).hash();
        let token = Entry::ReplaceRunToken { run, holder: None, hash };
        let mut entries = vec![Entry::OpenRun(Box::new(row)), token];
        let mut end = at;
        for (episode, game) in (first.0..).zip(definition.suite.plan()) {
            let episode = EpisodeKey(episode);
            let salt = (visibility == Visibility::Sealed).then(|| {
                let mut bytes = [0; 16];
                entropy.fill(&mut bytes);
                data_encoding::HEXLOWER.encode(&bytes)
            });
            let spec = definition::spec(definition, &id, &game, salt)?;
            let new =
                NewGame { episode, owner, run: Some((run, game.slot)), spec, at: self.at(episode) };
            entries.extend(new.play(&random(b'e', episode.0.unsigned_abs())));
            if let Some(Entry::End(row)) = entries.last() {
                end = end.max(row.at);
            }
        }
        entries.push(Entry::EndRun { run, status: "finished", at: end });
        Ok(entries)
    }

    fn single(&self, episode: EpisodeKey) -> Result<Vec<Entry>, String> {
        let number = episode.0.unsigned_abs();
        let suite = &self.suites[0];
        let mut game = suite.plan().swap_remove(usize::try_from(number % RUN_GAMES).unwrap_or(0));
        game.seed = number.try_into().map_err(|_| "a seed that is too large".to_owned())?;
        let definition = definition(suite.clone(), format!("model-{}", number % MODELS));
        let spec = Spec { run: None, ..definition::spec(&definition, "", &game, None)? };
        let new =
            NewGame { episode, owner: Some(owner(number)), run: None, spec, at: self.at(episode) };
        Ok(new.play(&random(b'e', number)))
    }
}

impl Piece {
    fn games(&self) -> u64 {
        match self {
            Self::Run { .. } => RUN_GAMES,
            Self::Singles { count, .. } => *count,
            Self::Attempts { competition, count, .. } => competition.games() * *count as u64,
        }
    }
}

/// Counters of assigned numbers.
struct Made {
    episodes: u64,
    runs: u64,
    competitions: Vec<Arc<Competition>>,
}

impl Made {
    /// Numbers for the next run and its first game.
    fn next_run(&mut self, games: u64) -> (RunKey, EpisodeKey) {
        self.runs += 1;
        (RunKey(self.runs.cast_signed()), self.next(games))
    }

    /// Numbers for the next attempts in a competition.
    fn attempts(&mut self, competition: &Arc<Competition>, index: usize, count: usize) -> Piece {
        let (run, first) = (RunKey(self.runs.cast_signed() + 1), self.episodes + 1);
        let first = EpisodeKey(first.cast_signed());
        self.runs += count as u64;
        self.episodes += count as u64 * competition.games();
        Piece::Attempts { competition: Arc::clone(competition), index, count, run, first }
    }

    /// Assigns numbers to `episodes` episodes; returns the first one.
    fn next(&mut self, episodes: u64) -> EpisodeKey {
        let first = self.episodes + 1;
        self.episodes += episodes;
        EpisodeKey(first.cast_signed())
    }
}

/// The key that owns a numbered thing. Key 1 is the organizer's.
fn owner(number: u64) -> OwnerKey {
    OwnerKey((2 + number % OWNERS).cast_signed())
}

/// A suite of small games.
fn suite(name: &str) -> Suite {
    let built_in = Suite::built_in("quick", "paper").expect("it is built in");
    Suite {
        name: name.to_owned(),
        seeds: [27, 42, 57, 72].map(swarmbench_engine::Seed::from).to_vec(),
        settings: settings(),
        ..built_in
    }
}

/// The settings of small games.
fn settings() -> SuiteSettings {
    SuiteSettings { num_agents: AGENTS, max_round: ROUNDS, ..SuiteSettings::default() }
}

/// The row of a run without an owner and without a token.
pub(crate) fn run_row(
    run: RunKey,
    definition: &Definition,
    visibility: Visibility,
    at: Timestamp,
    entropy: &dyn Entropy,
) -> RunRow {
    RunRow {
        run,
        id: new_id(at, entropy),
        owner: None,
        suite: definition.suite.name.clone(),
        digest: definition.suite.digest(),
        definition: serde_json::to_string(definition).expect("string keys"),
        model: definition.model.clone(),
        visibility: visibility.name(),
        attempt: None,
        replays: None,
        closes_at: None,
        at,
        idempotency: None,
    }
}

/// A public run in which each game waits as long as it may.
pub(crate) fn definition(suite: Suite, model: String) -> Definition {
    Definition {
        suite,
        model,
        temperature: Some(1.0),
        top_p: Some(1.0),
        meta: Carried::default(),
        prompt_template: None,
        prompt_revision: swarmbench_prompt::REVISION,
        player: None,
        holders: Vec::new(),
        parallel: 4,
        visibility: Visibility::Public.name().to_owned(),
        idle_timeout_ms: IDLE_TIMEOUT_MS,
        closes_at: None,
        own_games: false,
    }
}

/// The random bytes for a numbered thing of some kind.
fn random(kind: u8, number: u64) -> SeededEntropy {
    let mut seed = [0; 8];
    // The seed is hashed, so that sequences of consecutive numbers do not overlap.
    SeededEntropy::new(SEED ^ (u64::from(kind) << 56) ^ number).fill(&mut seed);
    SeededEntropy::new(u64::from_le_bytes(seed))
}

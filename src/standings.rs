//! Boards of a database, read once and updated with each commit.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use swarmbench_engine::{Settings, TaskName};
use swarmbench_protocol::import::KnownSettings;
use tokio::sync::Mutex;

use crate::ids::{EpisodeKey, RunKey};
use crate::run::definition::Definition;
use crate::store::imports::StoredImport;
use crate::store::results::{BoardMixed, BoardRun, Change, LogPosition};
use crate::store::{Store, StoreError};
use swarmbench_boards::collection::{BoardId, BoardSuite, Boards, FinishedRun, Imported};
use swarmbench_boards::cross_play::{MixedGame, Model, Setting};
use swarmbench_boards::result::RunResult;
use swarmbench_boards::run::is_human;
use swarmbench_boards::{Decentralization, EndedGame, Owner, PlayedRun, Player, Slot};
use swarmbench_journal::record::{Record, RecordedConfig};
use swarmbench_protocol::carried::Carried;
use swarmbench_protocol::names::BUILT_IN;
use swarmbench_protocol::suite::{Suite, SuiteSettings};

/// Rule sets of the built-in suites.
const RULES: [&str; 2] = ["paper", "reference"];

/// Party of a team that no key created; keys have positive numbers.
const TEAM_WITHOUT_KEY: i64 = 0;

pub type MixedGames = BTreeMap<EpisodeKey, Arc<MixedGame>>;

/// Boards of a database. A running server has exactly one instance, as each change is reported once.
#[derive(Debug)]
pub struct Standings {
    store: Store,
    cached: Mutex<CachedBoards>,
}

#[derive(Debug)]
struct CachedBoards {
    /// Position up to which the log of changes was read.
    position: LogPosition,
    /// Changes that were read from the log and not looked up yet.
    changes: Vec<Change>,
    /// `None` until the first request.
    boards: Option<Arc<Boards>>,
    /// `None` until the first request.
    mixed: Option<Arc<MixedGames>>,
}

impl Standings {
    pub fn new(store: Store) -> Self {
        let cached = Mutex::new(CachedBoards::new(store.writer().changes().position()));
        Self { store, cached }
    }

    /// All boards, with everything that is durable now.
    pub async fn boards(&self) -> Result<Arc<Boards>, StoreError> {
        let mut cached = self.cached.lock().await;
        self.catch_up(&mut cached).await?;
        if let Some(boards) = &cached.boards {
            return Ok(Arc::clone(boards));
        }
        let mut boards = Boards::new(built_in());
        let mut last = None;
        loop {
            let runs = self.store.runs_on_boards(last).await?;
            let Some(run) = runs.last() else { break };
            last = Some(run.run);
            for run in runs.into_iter().filter(|run| run.is_over) {
                boards.insert(finished_run(run)?);
            }
        }
        boards.set_imported(self.imported().await?);
        let boards = Arc::new(boards);
        cached.boards = Some(Arc::clone(&boards));
        Ok(boards)
    }

    /// All finished games of several holders, with everything that is durable now.
    pub async fn mixed(&self) -> Result<Arc<MixedGames>, StoreError> {
        let mut cached = self.cached.lock().await;
        self.catch_up(&mut cached).await?;
        if let Some(mixed) = &cached.mixed {
            return Ok(Arc::clone(mixed));
        }
        let mut mixed = MixedGames::new();
        let mut last = None;
        loop {
            let (games, next) = self.store.mixed_games(last).await?;
            for game in games {
                mixed.insert(game.episode, Arc::new(mixed_game(game)?));
            }
            if next.is_none() {
                break;
            }
            last = next;
        }
        let mixed = Arc::new(mixed);
        cached.mixed = Some(Arc::clone(&mixed));
        Ok(mixed)
    }

    /// Applies the changes of the log. A change is removed from the list after it was applied, as the caller may be dropped at any
    /// moment.
    async fn catch_up(&self, cached: &mut CachedBoards) -> Result<(), StoreError> {
        let (position, changes) = self.store.writer().changes().since(cached.position);
        match changes {
            // A revealed competition adds runs that no board had; reading everything once costs less than reading each.
            Some(changes) if changes.contains(&Change::Revealed) => {
                *cached = CachedBoards::new(position);
            }
            Some(changes) => {
                cached.position = position;
                cached.changes.extend(changes);
            }
            None => *cached = CachedBoards::new(position),
        }
        if cached.boards.is_none() && cached.mixed.is_none() {
            // The first read includes these changes.
            cached.changes.clear();
        }
        while let Some(&change) = cached.changes.last() {
            match change {
                Change::Run(run) => self.read_run(cached, run).await?,
                Change::Entrant(entry) => {
                    for run in self.store.runs_of_entrant(entry).await? {
                        self.read_run(cached, run).await?;
                    }
                }
                // Boards show ended games only; a revealed competition is handled above.
                Change::Started(_) | Change::Revealed => {}
                Change::Imports => {
                    // One read serves all games that were imported together.
                    cached.changes.retain(|change| *change != Change::Imports);
                    cached.changes.push(Change::Imports);
                    let games = self.imported().await?;
                    if let Some(boards) = &mut cached.boards {
                        Arc::make_mut(boards).set_imported(games);
                    }
                }
                Change::Episode(episode) => match self.store.run_of(episode).await? {
                    Some(run) => {
                        self.read_run(cached, run).await?;
                        // Several holders may have played a game of a run, too.
                        self.read_mixed(cached, episode).await?;
                    }
                    None => self.read_mixed(cached, episode).await?,
                },
            }
            cached.changes.pop();
        }
        Ok(())
    }

    async fn imported(&self) -> Result<Vec<Imported>, StoreError> {
        Ok(self.store.imported_games().await?.into_iter().filter_map(imported).collect())
    }

    async fn read_run(&self, cached: &mut CachedBoards, run: RunKey) -> Result<(), StoreError> {
        let Some(boards) = &mut cached.boards else { return Ok(()) };
        let found = self.store.run_on_boards(run).await?.map(finished_run).transpose()?;
        let boards = Arc::make_mut(boards);
        match found {
            Some(run) => boards.insert(run),
            None => boards.remove(run.0),
        }
        Ok(())
    }

    async fn read_mixed(
        &self,
        cached: &mut CachedBoards,
        episode: EpisodeKey,
    ) -> Result<(), StoreError> {
        let Some(mixed) = &mut cached.mixed else { return Ok(()) };
        let found = self.store.mixed_game(episode).await?.map(mixed_game).transpose()?;
        let mixed = Arc::make_mut(mixed);
        match found {
            Some(game) => drop(mixed.insert(episode, Arc::new(game))),
            None => drop(mixed.remove(&episode)),
        }
        Ok(())
    }
}

impl CachedBoards {
    const fn new(position: LogPosition) -> Self {
        Self { position, changes: Vec::new(), boards: None, mixed: None }
    }
}

/// Boards that exist before the first game.
fn built_in() -> impl Iterator<Item = (BoardId, BoardSuite)> {
    let suites = RULES.iter().flat_map(|rules| {
        Suite::BUILT_IN.iter().filter_map(move |name| Suite::built_in(name, rules))
    });
    suites.map(|built_in| {
        let shown = suite(&built_in, Slot::plan(&built_in).unwrap_or_default());
        (BoardId { digest: built_in.digest(), suite: built_in.name, rules: built_in.rules }, shown)
    })
}

fn suite(suite: &Suite, plan: Vec<Slot>) -> BoardSuite {
    BoardSuite {
        tasks: suite.tasks.iter().filter_map(|name| TaskName::parse(name)).collect(),
        plan,
        settings: KnownSettings {
            rules: Some(suite.rules.clone()),
            ..KnownSettings::from(&Settings::from(&suite.settings))
        },
    }
}

/// An imported game as boards need it, if its task is known.
fn imported(game: StoredImport) -> Option<Imported> {
    Some(Imported {
        slot: Slot { task: TaskName::parse(&game.task)?, seed: game.seed.try_into().ok()? },
        model: game.model,
        score: game.score,
        settings: KnownSettings::from(&game.settings),
    })
}

/// A stored run as boards need it.
fn finished_run(stored: BoardRun) -> Result<FinishedRun, StoreError> {
    let broken = |problem: String| {
        StoreError::broken(format!("the run {} cannot be read: {problem}", stored.id))
    };
    let definition: Definition =
        serde_json::from_str(&stored.definition).map_err(|error| broken(error.to_string()))?;
    let task = |name: &str| {
        TaskName::parse(name).ok_or_else(|| broken(format!("there is no task {name:?}")))
    };
    let plan = (definition.suite.plan().iter())
        .map(|game| Ok(Slot { task: task(&game.task)?, seed: game.seed }))
        .collect::<Result<Vec<_>, StoreError>>()?;
    let games = (stored.games.iter())
        .map(|game| {
            Ok(EndedGame {
                slot: Slot { task: task(&game.task)?, seed: game.seed },
                score: game.score,
                tally: game.tally,
                voided: game.voided,
            })
        })
        .collect::<Result<Vec<_>, StoreError>>()?;
    // The server vouches for hosted players only under the players' own names.
    let is_own = |player: &Option<String>, model: &str| {
        player.as_ref().is_some_and(|player| model.strip_prefix(BUILT_IN) == Some(player))
    };
    let is_own_name = match definition.holders.as_slice() {
        [] => is_own(&definition.player, &definition.model),
        holders => holders.iter().all(|holder| is_own(&holder.player, &holder.model)),
    };
    // An ended game can be read by its holders, who then play the same layout again.
    let slots: BTreeSet<Slot> = games.iter().map(|game| game.slot).collect();
    let is_blind = definition.holders.len() > 1 && slots.len() == games.len();
    let is_enforced = is_blind || definition.is_all_hosted();
    let prompt = definition.prompt();
    let prompt_name = definition.prompt_name();
    let sampling = definition.further_sampling();
    let is_human = is_human(&definition.meta)
        || definition.holders.iter().any(|holder| is_human(&holder.agent_meta));
    let mut holders = definition.shown_holders();
    for holder in &mut holders {
        holder.agent_meta = Carried::default();
    }
    let run = PlayedRun {
        player: Player {
            owner: stored.owner.map(|owner| Owner { id: owner.id, name: owner.name }),
            model: definition.model,
            temperature: definition.temperature,
            top_p: definition.top_p,
            prompt,
            holders,
            sampling,
        },
        id: stored.id,
        status: stored.status,
        created_at: stored.created_at,
        vouched: stored.vouched || is_own_name,
        decentralization: match definition.suite.settings.control.as_str() {
            "centralized" => None,
            _ if is_enforced => Some(Decentralization::Enforced),
            _ => Some(Decentralization::Declared),
        },
        is_human,
        prompt: prompt_name,
        answer_reader: Some(definition.suite.settings.answer_reader.clone()),
    };
    let result = RunResult::new(run, &plan, &games, true);
    let suite = suite(&definition.suite, plan);
    let rules = definition.suite.rules;
    let board = BoardId { suite: stored.suite, rules, digest: stored.digest };
    Ok(FinishedRun { key: stored.run.0, board, suite, result })
}

/// A stored game of several holders as cross-play needs it.
fn mixed_game(stored: BoardMixed) -> Result<MixedGame, StoreError> {
    let broken = |problem: String| {
        let number = stored.episode.0;
        StoreError::broken(format!(
            "the opening of episode number {number} cannot be read: {problem}"
        ))
    };
    let config = match stored.opening.read() {
        Ok(Record::Opening(opening)) => opening.config,
        Ok(Record::Seats(_) | Record::Round(_) | Record::End(_)) => {
            return Err(broken("its record is no opening".to_owned()));
        }
        Err(error) => return Err(broken(error.to_string())),
    };
    let task = TaskName::parse(&config.task);
    let task = task.ok_or_else(|| broken(format!("its task {:?} is unknown", config.task)))?;
    let settings = serde_json::to_string(&settings(&config)).map_err(|e| broken(e.to_string()))?;
    let setting = Setting { task, rules: config.rules, settings };
    // A team plays for its creator, also where no key says who that is; players of the server play for nobody.
    let is_members = |name: &String| {
        config.holders.iter().any(|holder| holder.player.is_none() && holder.model == *name)
    };
    let model = |(name, vouched, owner): (String, bool, Option<i64>)| {
        let owner = owner.or_else(|| is_members(&name).then_some(TEAM_WITHOUT_KEY));
        Model { name, vouched, owner }
    };
    Ok(MixedGame {
        setting,
        score: stored.score,
        models: stored.models.into_iter().map(model).collect(),
    })
}

/// Settings that influence a game, except task, seed and rules.
fn settings(config: &RecordedConfig) -> SuiteSettings {
    SuiteSettings {
        round_deadline_ms: config.round_deadline_ms,
        bank_ms: config.bank_ms,
        ..SuiteSettings::from(&Settings::from(config))
    }
}

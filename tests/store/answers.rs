//! All that reads a store, asked of both engines with the same arguments.

use std::collections::BTreeSet;
use std::fmt::Debug;
use std::fs;
use std::path::Path;

use jiff::Timestamp;
use swarmbench::ids::{EpisodeId, EpisodeKey, ImportKey, Place, RunKey, TokenHash};
use swarmbench::keys::OwnerKey;
use swarmbench::store::StoreError;
use swarmbench::store::audit::{ShownAction, StoredAuditEntry};
use swarmbench::store::competitions::{Declared, RawCompetition};
use swarmbench::store::episodes::{Filter, Order, Readable, SortKey};
use swarmbench::store::imports::ImportFilter;
use swarmbench::store::metrics::{BoardMetric, stored_method};
use swarmbench::store::port::EpisodeStore;
use swarmbench::store::records::ActReader;
use swarmbench::store::results::{BoardMixed, LogPosition};
use swarmbench::store::runs::RunFilter;
use swarmbench_engine::AgentId;

use crate::store::history::{Episode, History};
use crate::store::numbers::Side;
use crate::store::{Pair, kind};

/// Characters of two answers that are shown around the first difference.
const SHOWN: usize = 300;

/// Sets of arguments for each method that takes some.
const ROUNDS: usize = 4;

/// Answers that are read in pieces are read in few of them.
const PIECES_MAX: usize = 10_000;

type StoreAnswer<T> = Result<T, StoreError>;

/// Compares what both answer.
async fn ask<T: Debug>(pair: &Pair, what: &str, call: impl AsyncFn(&Side) -> StoreAnswer<T>) {
    let [sqlite, postgres] = [call(&pair.sqlite).await, call(&pair.postgres).await];
    assert_eq!(kind(&sqlite), kind(&postgres), "{what}: {sqlite:?} and {postgres:?}");
    let (Ok(sqlite), Ok(postgres)) = (sqlite, postgres) else { return };
    let sqlite = pair.sqlite.common(&format!("{sqlite:?}"));
    let postgres = pair.postgres.common(&format!("{postgres:?}"));
    assert_same(what, &sqlite, &postgres);
}

fn assert_same(what: &str, sqlite: &str, postgres: &str) {
    if sqlite == postgres {
        return;
    }
    let same = sqlite.chars().zip(postgres.chars()).take_while(|(one, other)| one == other).count();
    let near = |text: &str| -> String {
        text.chars().skip(same.saturating_sub(SHOWN / 2)).take(SHOWN).collect()
    };
    panic!("{what}\nSQLite:     …{}…\nPostgreSQL: …{}…", near(sqlite), near(postgres));
}

/// Commits since a position in the log of SQLite's store, which is the same in both.
pub(crate) fn compare_changes(pair: &Pair, since: LogPosition) {
    let [sqlite, postgres] = [&pair.sqlite, &pair.postgres].map(|side| {
        let changes = side.store.writer().changes();
        let seen = (changes.since(since), changes.revision(), changes.measured());
        side.common(&format!("{seen:?}"))
    });
    assert_same("changes", &sqlite, &postgres);
}

pub(crate) async fn compare(pair: &Pair, history: &History) {
    let asked = Questions { pair, history };
    asked.lists_of_episodes().await;
    asked.episodes().await;
    asked.journals().await;
    asked.runs().await;
    asked.boards().await;
    asked.competitions().await;
    asked.keys().await;
    asked.imports().await;
    asked.the_rest().await;
}

struct Questions<'a> {
    pair: &'a Pair,
    history: &'a History,
}

impl Questions<'_> {
    async fn ask<T: Debug>(&self, what: &str, call: impl AsyncFn(&Side) -> StoreAnswer<T>) {
        ask(self.pair, what, call).await;
    }

    fn below(&self, n: usize) -> usize {
        self.history.dice.below(n)
    }

    fn one_in(&self, n: usize) -> bool {
        self.history.dice.one_in(n)
    }

    fn maybe<T>(&self, make: impl FnOnce(&Self) -> T) -> Option<T> {
        self.one_in(2).then(|| make(self))
    }

    fn rarely<T>(&self, make: impl FnOnce(&Self) -> T) -> Option<T> {
        self.one_in(6).then(|| make(self))
    }

    fn number(&self) -> u32 {
        *self.history.dice.pick(&[0, 1, 2, 3, 5, 20, 1000, u32::MAX])
    }

    fn limit(&self) -> u32 {
        *self.history.dice.pick(&[0, 1, 3, 10, 100, u32::MAX])
    }

    fn bytes_max(&self) -> usize {
        *self.history.dice.pick(&[0, 1, 500, 5_000, 65_536, 500_000, usize::MAX >> 1])
    }

    fn stored(&self) -> Option<&Episode> {
        let episodes = &self.history.episodes;
        (!episodes.is_empty()).then(|| self.history.dice.pick(episodes))
    }

    fn key(&self) -> EpisodeKey {
        let some = EpisodeKey(*self.history.dice.pick(&[0, -1, 999_999, i64::MAX, i64::MIN]));
        if self.one_in(12) { some } else { self.stored().map_or(some, |episode| episode.key) }
    }

    fn id(&self) -> EpisodeId {
        let some = ["", "ep_", "ep_9999999", "EP_2", "ep\0_2", "🐝"];
        let some = EpisodeId::from_text((*self.history.dice.pick(&some)).to_owned());
        if self.one_in(12) { some } else { self.stored().map_or(some, |one| one.id.clone()) }
    }

    fn run(&self) -> RunKey {
        let some = RunKey(*self.history.dice.pick(&[0, 999_999, i64::MAX]));
        if self.one_in(12) { some } else { self.history.run().map_or(some, |run| run.key) }
    }

    fn run_id(&self) -> String {
        let some = (*self.history.dice.pick(&["", "run_0", "run\0"])).to_owned();
        if self.one_in(12) { some } else { self.history.run().map_or(some, |run| run.id.clone()) }
    }

    fn time(&self) -> Timestamp {
        let ms = 1_772_366_400_000 + i64::try_from(self.below(400_000)).expect("small");
        Timestamp::from_millisecond(ms).expect("a time")
    }

    /// A name, or one that nothing has.
    fn named(&self) -> String {
        let others = ["", "nobody", "model-a\0", "\0", "model-%", "\u{ffff}"];
        if self.one_in(6) {
            return (*self.history.dice.pick(&others)).to_owned();
        }
        self.history.named()
    }

    fn one_of(&self, ids: &[String]) -> String {
        if ids.is_empty() || self.one_in(12) {
            return (*self.history.dice.pick(&["", "x", "\0"])).to_owned();
        }
        self.history.dice.pick(ids).clone()
    }

    fn hash(&self, of: &[TokenHash]) -> TokenHash {
        if of.is_empty() || self.one_in(12) {
            return TokenHash([7; 32]);
        }
        *self.history.dice.pick(of)
    }

    fn idempotency(&self) -> String {
        self.one_of(&self.history.idempotency)
    }

    /// Every kind of who may read, in the numbers of histories.
    fn readables(&self) -> [Readable; 8] {
        let owner = self.history.owner().unwrap_or(OwnerKey(-3));
        [
            Readable::All,
            Readable::Public,
            Readable::And(self.id()),
            Readable::AndOf { owner, at: self.time() },
            Readable::AndOfRun(self.run()),
            Readable::OnlyOfRun(self.run()),
            Readable::Only(self.id()),
            Readable::Nothing,
        ]
    }

    fn filter(&self, readable: Readable) -> Filter {
        let statuses = ["waiting", "running", "finished", "aborted", "Finished", "x\0"];
        let tasks = ["foraging", "synchronization", "pursuit", "Foraging"];
        Filter {
            status: self.rarely(|asked| (*asked.history.dice.pick(&statuses)).to_owned()),
            task: self.rarely(|asked| (*asked.history.dice.pick(&tasks)).to_owned()),
            model: self.rarely(Self::named),
            played_by: self.rarely(Self::named),
            mixed: self.rarely(|asked| asked.one_in(2)),
            run: self.rarely(Self::run),
            fork_of: self.rarely(|asked| asked.id().to_string()),
            forks: self.rarely(|asked| asked.one_in(2)),
            people: self.one_in(8),
            readable,
        }
    }

    async fn lists_of_episodes(&self) {
        for readable in self.readables() {
            let filter = self.filter(readable);
            let (before, limit) = (self.maybe(Self::key), self.limit());
            let what = format!("episodes by {filter:?} before {before:?}, {limit}");
            let own = |side: &Side| Filter {
                readable: own_readable(side, &filter.readable),
                ..filter.clone()
            };
            self.ask(&what, async |side| side.store.list_episodes(&own(side), before, limit).await)
                .await;
            let by = [None, Some(SortKey::SCORE), Some(SortKey::ROUNDS), Some(SortKey::SEED)];
            for (by, is_ascending) in by.into_iter().flat_map(|by| [(by, false), (by, true)]) {
                let order = Order { by, is_ascending };
                self.ask(&format!("{what} {order:?}"), async |side| {
                    let filter = own(side);
                    side.store
                        .list_episodes_without_templates(&filter, order, true, before, limit)
                        .await
                })
                .await;
            }
            self.ask("models", async |side| side.store.public_models("", limit).await).await;
        }
        self.ask("unfinished_episodes", async |side| side.store.unfinished_episodes().await).await;
        self.ask("unfinished", async |side| EpisodeStore::unfinished(&side.store).await).await;
        self.ask("bytes_by_owner", async |side| {
            let mut all = side.store.bytes_by_owner().await?;
            all.sort_by_key(|(owner, _)| side.common_key(owner.0));
            Ok(all)
        })
        .await;
        self.ask("accounts", async |side| {
            let mut all = side.store.accounts().await?;
            all.sort_by_key(|(episode, ..)| *episode);
            Ok(all)
        })
        .await;
        self.ask("bytes_by_competition", async |side| {
            let mut all = side.store.bytes_by_competition().await?;
            all.sort();
            Ok(all)
        })
        .await;
        self.ask("last_key", async |side| side.store.last_key().await).await;
    }

    async fn episodes(&self) {
        for _ in 0..ROUNDS {
            let seat = u16::try_from(self.below(8)).expect("small");
            let (id, key, agent) = (self.id(), self.key(), AgentId(seat));
            let (from, to) = (self.number(), self.number());
            let bytes_max = self.bytes_max();
            let what = format!("{id} {key:?} {agent} {from}..{to}, {bytes_max} bytes");
            let of = |method: &str| format!("{method} of {what}");
            self.ask(&of("find_episode"), async |side| side.store.find_episode(&id).await).await;
            self.ask(&of("episode"), async |side| side.store.episode(id.clone()).await).await;
            self.ask(&of("find_summary"), async |side| side.store.find_summary(&id).await).await;
            self.ask(&of("summary_of"), async |side| side.store.summary_of(key).await).await;
            self.ask(&of("holders"), async |side| side.store.holders(key).await).await;
            self.ask(&of("held_seats"), async |side| side.store.held_seats(key).await).await;
            let holder = self.number();
            self.ask(&of("seats_of"), async |side| side.store.seats_of(key, holder).await).await;
            self.ask(&of("started_at"), async |side| side.store.started_at(key).await).await;
            self.ask(&of("logged_rounds"), async |side| {
                side.store.logged_rounds(key, from, to).await
            })
            .await;
            self.ask(&of("acts"), async |side| side.store.acts(key, from, to).await).await;
            self.ask(&of("rounds"), async |side| side.store.rounds(key, from, to).await).await;
            self.ask(&of("resolved"), async |side| side.store.resolved(key, from, to).await).await;
            self.ask(&of("round_acts"), async |side| side.store.round_acts(key, from).await).await;
            self.ask(&of("act"), async |side| side.store.act(key, from, agent).await).await;
            self.ask(&of("timed_act"), async |side| side.store.timed_act(key, from, agent).await)
                .await;
            self.ask(&of("acts_part"), async |side| {
                side.store.acts_part(key, (from, agent), to, bytes_max).await
            })
            .await;
            self.ask(&of("end_record"), async |side| side.store.end_record(key, bytes_max).await)
                .await;
            let rounds = [3, 1, 2, 2, 1 + from % 9, u32::MAX];
            self.ask(&of("scores_after"), async |side| side.store.scores_after(key, &rounds).await)
                .await;
            self.ask(&of("tally_of"), async |side| side.store.tally_of(key).await).await;
            self.ask(&of("run_of"), async |side| side.store.run_of(key).await).await;
            self.ask(&of("keys_of"), async |side| side.store.keys_of(&id).await).await;
            self.ask(&of("accounts_of"), async |side| side.store.accounts_of(&[key]).await).await;
            self.ask(&of("unfinished_at"), async |side| {
                let run = side.store.run_of(key).await?;
                side.store.unfinished_at(&[Place::of_game(key, run)]).await
            })
            .await;
            self.ask(&of("forks_made_with"), async |side| {
                side.store.forks_made_with(&id, to).await
            })
            .await;
            let method = stored_method();
            self.ask(&of("metrics_of"), async |side| side.store.metrics_of(key, method).await)
                .await;
            self.ask(&of("worth_of"), async |side| side.store.worth_of(key).await).await;
            let idempotency = self.idempotency();
            self.ask(&idempotency, async |side| side.store.created_with(&idempotency).await).await;
            self.ask(&idempotency, async |side| side.store.claimed_with(&idempotency).await).await;
        }
    }

    async fn journals(&self) {
        for _ in 0..ROUNDS {
            let ids: Vec<_> = (0..self.below(6)).map(|_| self.id()).collect();
            // Each once, as those are that a caller has listed.
            let ids: BTreeSet<_> = ids.into_iter().collect();
            let ids: Vec<_> = ids.into_iter().collect();
            let bytes_max = self.bytes_max();
            self.ask(&format!("journals of {ids:?} in {bytes_max}"), async |side| {
                let mut read = Vec::new();
                for mut journal in side.store.journals(&ids, bytes_max).await? {
                    let rounds = journal.stored.rounds;
                    let acts = all_acts(&mut journal.acts, rounds, bytes_max).await?;
                    read.push((journal.stored, journal.rounds, acts, journal.end));
                }
                Ok(read)
            })
            .await;
            let (key, end) = (self.key(), 1 + self.number() % 1000);
            let bytes = self.maybe(|asked| asked.bytes_max() as u64);
            for is_joined in [false, true] {
                let what = format!("acts of {key:?} before {end}, joined: {is_joined}");
                self.ask(&what, async |side| {
                    let store = side.store.clone();
                    let mut reader = if is_joined {
                        ActReader::joined(store, key, end, bytes)
                    } else {
                        ActReader::new(store, key, end)
                    };
                    all_acts(&mut reader, end, bytes_max).await
                })
                .await;
            }
        }
    }

    async fn runs(&self) {
        for readable in self.readables() {
            let filter = RunFilter {
                status: self.rarely(|asked| {
                    (*asked.history.dice.pick(&["running", "finished", "closed"])).to_owned()
                }),
                model: self.rarely(Self::named),
                suite: self.rarely(|asked| {
                    (*asked.history.dice.pick(&["quick", "Quick", "full", "f\0"])).to_owned()
                }),
                readable,
            };
            let (before, limit) = (self.maybe(Self::run), self.limit());
            let what = format!("runs by {filter:?} before {before:?}, {limit}");
            self.ask(&what, async |side| {
                let readable = own_readable(side, &filter.readable);
                let filter = RunFilter { readable, ..filter.clone() };
                side.store.list_runs(&filter, before, limit).await
            })
            .await;
        }
        for _ in 0..ROUNDS {
            let (run, id, suite, from) = (self.run(), self.run_id(), "quick", self.time());
            self.ask(&id, async |side| side.store.find_run(&id).await).await;
            let what = format!("{run:?}");
            self.ask(&what, async |side| side.store.run(run).await).await;
            self.ask(&what, async |side| side.store.entrant(run).await).await;
            self.ask(&what, async |side| side.store.games_of(run).await).await;
            self.ask(&what, async |side| side.store.is_excluded(run).await).await;
            self.ask(&what, async |side| side.store.run_on_boards(run).await).await;
            let owner = self.history.run().and_then(|run| run.owner).unwrap_or(OwnerKey(-1));
            self.ask(&format!("runs_of_suite {owner:?} {from}"), async |side| {
                side.store.runs_of_suite(side.owner(owner), suite, from).await
            })
            .await;
            let idempotency = self.idempotency();
            self.ask(&idempotency, async |side| side.store.run_created_with(&idempotency).await)
                .await;
            let runs: Vec<_> = (0..self.below(8)).map(|_| self.run()).collect();
            self.ask(&format!("games_of_all {runs:?}"), async |side| {
                side.store.games_of_all(&runs).await
            })
            .await;
            let ids: Vec<_> = (0..self.below(8)).map(|_| self.run_id()).collect();
            let metrics: Vec<_> = BoardMetric::all().collect();
            self.ask(&format!("mean_metrics {ids:?}"), async |side| {
                side.store.mean_metrics(&ids, &metrics).await
            })
            .await;
        }
        self.ask("unfinished_runs", async |side| side.store.unfinished_runs().await).await;
        self.ask("last_run_key", async |side| side.store.last_run_key().await).await;
    }

    async fn boards(&self) {
        for after in [None, Some(self.run())] {
            self.ask(&format!("runs_on_boards after {after:?}"), async |side| {
                side.store.runs_on_boards(after).await
            })
            .await;
        }
        let common = |side: &Side, game: BoardMixed| {
            let models = game.models.into_iter();
            let models = models.map(|(model, is_known, owner)| {
                (model, is_known, owner.map(|owner| side.common_key(owner)))
            });
            BoardMixed { models: models.collect(), ..game }
        };
        for after in [None, Some(self.key())] {
            self.ask(&format!("mixed_games after {after:?}"), async |side| {
                let (games, next) = side.store.mixed_games(after).await?;
                let games: Vec<_> = games.into_iter().map(|game| common(side, game)).collect();
                Ok((games, next))
            })
            .await;
            let key = self.key();
            self.ask(&format!("mixed_game {key:?}"), async |side| {
                Ok(side.store.mixed_game(key).await?.map(|game| common(side, game)))
            })
            .await;
        }
    }

    async fn competitions(&self) {
        // What `Debug` does not show.
        let whole = |competition: RawCompetition| {
            let (salt, seeds) = (competition.salt.0.clone(), competition.seeds.0.clone());
            (competition, salt, seeds)
        };
        for all in [false, true] {
            let (before, limit) = (self.maybe(|asked| asked.history.competition()), self.limit());
            self.ask(&format!("list_competitions {all} {before:?} {limit}"), async |side| {
                let before = before.map(|before| side.competition(before));
                let listed = side.store.list_competitions(all, before, limit).await?;
                Ok(listed.into_iter().map(whole).collect::<Vec<_>>())
            })
            .await;
        }
        let now = self.time();
        self.ask(&format!("closing at {now}"), async |side| {
            side.store.closing_competitions(now).await
        })
        .await;
        for _ in 0..ROUNDS {
            let id = self.one_of(&self.history.names.competitions);
            self.ask(&id, async |side| Ok(side.store.find_competition(&id).await?.map(whole)))
                .await;
            self.competition().await;
        }
    }

    #[expect(clippy::too_many_lines, reason = "it is a list")]
    async fn competition(&self) {
        let (competition, limit) = (self.history.competition(), self.limit());
        let owner = self.maybe(|asked| asked.history.owner()).flatten();
        let entry = self.history.entrant();
        let (id, run_id) = (self.one_of(&self.history.names.entries), self.run_id());
        let run = self.maybe(Self::run);
        let (name, model) = (self.named(), self.named());
        let what = format!(
            "{competition:?} {owner:?} {entry:?} {id:?} {run_id:?} {run:?} {name:?} {model:?} {limit}"
        );
        let of = |method: &str| format!("{method} of {what}");
        self.ask(&of("find_entrant"), async |side| {
            side.store.find_entrant(side.competition(competition), &id).await
        })
        .await;
        for declared in [Declared::Whole, Declared::Short] {
            self.ask(&of("entrants"), async |side| {
                let owner = owner.map(|owner| side.owner(owner));
                side.store.entrants(side.competition(competition), owner, declared).await
            })
            .await;
        }
        self.ask(&of("list_entrants"), async |side| {
            let (owner, after) =
                (owner.map(|owner| side.owner(owner)), entry.map(|entry| side.entry(entry)));
            side.store.list_entrants(side.competition(competition), owner, after, limit).await
        })
        .await;
        self.ask(&of("room_for"), async |side| {
            let owner = owner.map(|owner| side.owner(owner));
            side.store.room_for(side.competition(competition), &model, owner).await
        })
        .await;
        for (texts, other) in [("2001:db8:".."2001:db8;", ""), ("a".."b", "2001:db8::/64")] {
            let texts = texts.start.to_owned()..texts.end.to_owned();
            self.ask(&of("is_entered_from"), async |side| {
                side.store.is_entered_from(side.competition(competition), &texts, other).await
            })
            .await;
        }
        if let Some(entry) = entry {
            self.ask(&of("is_name_taken"), async |side| {
                let (competition, entry) = (side.competition(competition), side.entry(entry));
                side.store.is_name_taken(competition, Some(entry), &name).await
            })
            .await;
            if let Some(owner) = owner {
                self.ask(&of("playing"), async |side| {
                    side.store.playing(side.entry(entry), side.owner(owner), &name).await
                })
                .await;
            }
            self.ask(&of("attempts_of"), async |side| {
                side.store.attempts_of(side.entry(entry)).await
            })
            .await;
            self.ask(&of("is_active"), async |side| side.store.is_active(side.entry(entry)).await)
                .await;
            self.ask(&of("runs_of_entrant"), async |side| {
                side.store.runs_of_entrant(side.entry(entry)).await
            })
            .await;
            let other = self.history.entrant().unwrap_or(entry);
            self.ask(&of("entrants_among"), async |side| {
                let entries = [side.entry(other), side.entry(entry)];
                side.store.entrants_among(side.competition(competition), &entries).await
            })
            .await;
            self.ask(&of("entrants_among nobody"), async |side| {
                side.store.entrants_among(side.competition(competition), &[]).await
            })
            .await;
        }
        if let Some(owner) = owner {
            self.ask(&of("competition_of"), async |side| {
                side.store.competition_of(side.owner(owner)).await
            })
            .await;
        }
        self.ask(&of("list_attempts"), async |side| {
            let owner = owner.map(|owner| side.owner(owner));
            side.store.list_attempts(side.competition(competition), owner, run, limit).await
        })
        .await;
        self.ask(&of("find_attempt"), async |side| {
            side.store.find_attempt(side.competition(competition), &run_id).await
        })
        .await;
        self.ask(&of("voided_attempts"), async |side| {
            side.store.voided_attempts(side.competition(competition)).await
        })
        .await;
        self.ask(&of("list_contacts"), async |side| {
            let after = entry.map(|entry| side.entry(entry));
            side.store.list_contacts(side.competition(competition), after, limit).await
        })
        .await;
        self.ask(&of("last_attempt"), async |side| {
            side.store.last_attempt(side.competition(competition)).await
        })
        .await;
        self.ask(&of("running_attempts"), async |side| {
            side.store.running_attempts(side.competition(competition)).await
        })
        .await;
        self.ask(&of("has_open_attempts"), async |side| {
            side.store.has_open_attempts(side.competition(competition)).await
        })
        .await;
        let runs: Vec<_> = (0..self.below(8)).map(|_| self.run()).collect();
        let episodes: Vec<_> = (0..self.below(8)).map(|_| self.key()).collect();
        self.ask(&of("entrants_of"), async |side| {
            side.store.entrants_of(side.competition(competition), &runs, &episodes).await
        })
        .await;
        let hash = self.hash(&self.history.invitations);
        self.ask(&of("find_invitation"), async |side| {
            side.store.find_invitation(side.competition(competition), hash).await
        })
        .await;
        self.ask(&of("unused_invitations"), async |side| {
            side.store.unused_invitations(side.competition(competition), &name).await
        })
        .await;
        let skip = self.number();
        self.ask(&of("list_invitations"), async |side| {
            side.store.list_invitations(side.competition(competition), skip, limit).await
        })
        .await;
        let only = self.maybe(|asked| {
            (*asked.history.dice.pick(&["key.create", "Key.Create", "none", "key\0"])).to_owned()
        });
        self.ask(&of("actions_in"), async |side| {
            let before = before_number(side, self.history).await?;
            let (competition, only) = (side.competition(competition), only.as_deref());
            let numbers = numbers_of_audit(side).await?;
            let shown = side.store.actions_in(competition, only, before, limit).await?;
            let rank = |number| numbers.binary_search(&number).ok();
            let ranked = shown.into_iter().map(|action: ShownAction| {
                (rank(action.number), ShownAction { number: 0, ..action })
            });
            Ok(ranked.collect::<Vec<_>>())
        })
        .await;
    }

    async fn keys(&self) {
        self.ask("keys", async |side| side.store.keys().await).await;
        self.ask("has_keys", async |side| side.store.has_keys().await).await;
        for _ in 0..ROUNDS {
            let (owner, limit) = (self.history.owner(), self.limit());
            self.ask(&format!("keys after {owner:?}, {limit}"), async |side| {
                side.store.list_keys(owner.map(|owner| side.owner(owner)), limit).await
            })
            .await;
            if let Some(owner) = owner {
                let what = format!("{owner:?}");
                self.ask(&what, async |side| side.store.key(side.owner(owner)).await).await;
                self.ask(&what, async |side| side.store.key_id(side.owner(owner)).await).await;
                self.ask(&what, async |side| side.store.team_keys(side.owner(owner)).await).await;
                self.ask(&what, async |side| side.store.entrant_of_key(side.owner(owner)).await)
                    .await;
            }
            for _ in 0..ROUNDS {
                let hash = self.hash(&self.history.tokens);
                let what = format!("{hash:?}");
                self.ask(&what, async |side| side.store.find_key(hash).await).await;
                self.ask(&what, async |side| side.store.find_token(hash).await).await;
            }
        }
    }

    async fn imports(&self) {
        for _ in 0..ROUNDS {
            let filter = ImportFilter {
                task: self.maybe(|asked| {
                    (*asked.history.dice.pick(&["foraging", "Foraging", "f\0"])).to_owned()
                }),
                model: self.rarely(Self::named),
            };
            let key = self.history.import_key().map(ImportKey);
            let (before, limit) = (self.maybe(|_| key).flatten(), self.limit());
            self.ask(&format!("imports by {filter:?} before {before:?}, {limit}"), async |side| {
                let before = before.map(|before| side.import(before));
                side.store.list_imports(&filter, before, limit).await
            })
            .await;
            let id = self.one_of(&self.history.names.imports);
            self.ask(&id, async |side| side.store.find_import(&id).await).await;
            let Some(key) = key else { continue };
            let (from, to) = (self.number(), self.number());
            let what = format!("{key:?} {from}..{to}");
            self.ask(&what, async |side| {
                side.store.imported_rounds(side.import(key), from, to).await
            })
            .await;
            self.ask(&what, async |side| {
                side.store.imported_bytes(side.import(key), from, to).await
            })
            .await;
            self.ask(&what, async |side| side.store.imported_meta(side.import(key)).await).await;
            let states = [from, to, 4, 2, 2];
            self.ask(&what, async |side| {
                side.store.imported_scores(side.import(key), &states).await
            })
            .await;
        }
        self.ask("imported_games", async |side| side.store.imported_games().await).await;
    }

    async fn the_rest(&self) {
        self.ask("newest_at", async |side| side.store.newest_at().await).await;
        self.ask("newest_entry_at", async |side| side.store.newest_entry_at().await).await;
        let limit = self.limit();
        self.ask("unmeasured", async |side| {
            let queued = side.store.unmeasured(limit).await?.into_iter();
            let places = queued.map(|game| (side.place_in_queue(game.number), game.episode));
            Ok(places.collect::<Vec<_>>())
        })
        .await;
        self.ask("audit", async |side| {
            let numbers = numbers_of_audit(side).await?;
            let before = before_number(side, self.history).await?;
            let listed = side.store.audit(before, limit).await?;
            let rank = |number| numbers.binary_search(&number).ok();
            let ranked = listed.into_iter().map(|entry: StoredAuditEntry| {
                (rank(entry.number), StoredAuditEntry { number: 0, ..entry })
            });
            Ok(ranked.collect::<Vec<_>>())
        })
        .await;
        self.ask("ping", async |side| side.store.ping().await).await;
        self.ask("check_files", async |side| Ok(side.store.check_files().is_ok())).await;
        self.ask("bytes", async |side| Ok(side.store.bytes().await? > 0)).await;
    }
}

/// The numbers of all entries of the audit log, in order.
async fn numbers_of_audit(side: &Side) -> StoreAnswer<Vec<i64>> {
    let all = side.store.audit(None, u32::MAX).await?;
    Ok(all.into_iter().rev().map(|entry| entry.number).collect())
}

/// The same entry of the audit log in both, or none.
async fn before_number(side: &Side, history: &History) -> StoreAnswer<Option<i64>> {
    let numbers = numbers_of_audit(side).await?;
    // The same place for both sides: nothing is drawn here.
    let place = numbers.len() / 2 + history.episodes.len() % 2;
    Ok(if history.runs.len().is_multiple_of(2) { numbers.get(place).copied() } else { None })
}

/// Reader, in the numbers of an engine.
fn own_readable(side: &Side, common: &Readable) -> Readable {
    match common {
        Readable::AndOf { owner, at } => Readable::AndOf { owner: side.owner(*owner), at: *at },
        same @ (Readable::All
        | Readable::Public
        | Readable::And(_)
        | Readable::AndOfRun(_)
        | Readable::OnlyOfRun(_)
        | Readable::Only(_)
        | Readable::Nothing) => same.clone(),
    }
}

/// Acts from a reader, round by round, to its end.
async fn all_acts(
    reader: &mut ActReader,
    end: u32,
    bytes_max: usize,
) -> StoreAnswer<Vec<(u32, String)>> {
    let mut read = Vec::new();
    for round in 0..=end.min(100) {
        while let Some(record) = reader.next_of(round, bytes_max).await? {
            read.push((round, record));
            if read.len() > PIECES_MAX {
                return Err(StoreError::broken("it has no end"));
            }
        }
    }
    Ok(read)
}

/// A method that reads and is not asked here would be compared by nobody.
#[test]
fn all_methods_that_read_are_asked() {
    /// Methods that write, open or close, and those about several servers, of which SQLite has one.
    const OTHERS: [&str; 17] = [
        "join",
        "catch_up",
        "has",
        "take",
        "take_place",
        "owns_or_takes",
        "open",
        "open_to_read",
        "close",
        "check",
        "rebuild",
        "rebuild_metrics",
        "measure_queued",
        "patiently",
        "next_of",
        "keep",
        "replace_tokens",
    ];
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let asked = fs::read_to_string(root.join("tests/store/answers.rs")).expect("this file");
    let mut methods = BTreeSet::new();
    let folders = ["src/store", "src/store/tables", "src/store/model"];
    let files = folders.map(|folder| fs::read_dir(root.join(folder)).expect("the folder"));
    for file in files.into_iter().flatten() {
        let path = file.expect("a file").path();
        if path.is_dir() {
            continue;
        }
        let text = fs::read_to_string(&path).expect("a text");
        let is_port = path.ends_with("port.rs");
        for line in text.lines() {
            let method = line.trim().strip_prefix("pub async fn ");
            let method = method.or_else(|| line.strip_prefix("    fn ").filter(|_| is_port));
            let name = method.and_then(|rest| rest.split(['(', '<']).next());
            methods.extend(name.map(str::to_owned));
        }
    }
    methods.remove("append");
    methods.remove("recovered");
    assert!(methods.len() > 80, "only {methods:?} were found");
    let missing: Vec<_> = methods
        .iter()
        .filter(|name| !OTHERS.contains(&name.as_str()))
        .filter(|name| {
            !asked.contains(&format!(".{name}(")) && !asked.contains(&format!("::{name}("))
        })
        .collect();
    assert!(missing.is_empty(), "nothing asks {missing:?}");
}

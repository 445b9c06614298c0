//! The integrity check of a database: pages, references between rows, every journal, and all data derived from journals.
//!
//! The check only reads and may run beside a server: each episode is read in a transaction of its own, so that the server's
//! write-ahead log does not grow meanwhile. Unreadable data counts as damage, and the check continues after it. Memory use is
//! independent of the size of the database.

use futures::TryStreamExt;
use jiff::Timestamp;
use serde::Deserialize;
use serde::de::IgnoredAny;
use serde_json::value::RawValue;
use sha2::{Digest, Sha256};
use sqlx::error::BoxDynError;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions as _, Connection as _};

use super::competitions::{
    PEOPLE_PLAY, RawCompetition, damaged_looks, untaken_names, without_texts,
};
use super::entries::brief_of;
use super::metrics::{is_worth, stored_method};
use super::rebuild::{self, RebuildError};
use super::sql::{Begin, Connection, Engine, FromRow, SqlRow, Statement, get, query};
use super::stored_replay::{StoredJournal, replay_stored};
use super::templates::{self, opening};
use super::{Location, OpenError, postgres, sqlite};
use crate::ids::EpisodeKey;
use crate::migrations;
use crate::store::imports::ImportHash;
use crate::store::results::{as_stored, json};
use swarmbench_boards::run::{Definition, is_human};
use swarmbench_journal::Tally;
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::{ActRecord, End, Opening, RawRecord, Record, Seats, TeamHolder};
use swarmbench_journal::replay::JournalReport;
use swarmbench_players::DEFAULT_PLAYER;

/// Damages listed in full; further ones are only counted.
pub const DAMAGES_MAX: usize = 1000;

/// Limit of problems from `PRAGMA integrity_check`, and from any other query of the check.
const PROBLEMS_MAX: u32 = 100;

/// Rows listed by one query.
const CHUNK: i64 = 256;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    /// "the pages", a table, or the id of an episode or another row.
    pub subject: String,
    pub problem: String,
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Checked {
    /// Replayed episodes.
    pub episodes: u64,
    pub rounds: u64,
    /// Damages, at most [`DAMAGES_MAX`].
    pub damages: Vec<Damage>,
    pub more_damages: u64,
}

impl Checked {
    /// Whether nothing is damaged.
    pub fn is_sound(&self) -> bool {
        self.damages.is_empty()
    }

    fn note(&mut self, subject: impl Into<String>, problem: impl Into<String>) {
        if self.damages.len() < DAMAGES_MAX {
            self.damages.push(Damage { subject: subject.into(), problem: problem.into() });
        } else {
            self.more_damages += 1;
        }
    }

    /// Notes a problem with the subject, or an error of reading it.
    fn note_result(&mut self, subject: &str, result: Result<Result<(), String>, sqlx::Error>) {
        match result {
            Ok(Ok(())) => {}
            Ok(Err(problem)) => self.note(subject, problem),
            Err(error) => self.note(subject, unreadable(&error)),
        }
    }
}

fn unreadable(error: &sqlx::Error) -> String {
    format!("it cannot be read: {error}")
}

/// Parses stored data whose format belongs to another module; an error describes the problem.
pub type Reader<Raw, T> = fn(Raw) -> Result<T, String>;

/// Parsers of the formats that belong to other modules.
pub struct Formats {
    /// The window of a competition (opening and closing time), and the commitment to its secret.
    pub competition: Reader<RawCompetition, ([Timestamp; 2], [u8; 32])>,
    /// The declared model of an entrant, and the identity of its prompt template.
    pub declaration: Reader<String, (String, Option<String>)>,
}

/// Checks a whole database. `progress` gets the finished and the total number of episodes.
pub async fn check(
    location: impl Into<Location>,
    formats: &Formats,
    mut progress: impl FnMut(u64, u64),
) -> Result<Checked, OpenError> {
    let location = location.into();
    let mut connection = match &location {
        Location::File(path) => {
            sqlite::check_readable(path).await?;
            match sqlite::read_options(path).connect().await {
                Ok(connection) => Connection::Sqlite(connection),
                Err(error) => {
                    let mut checked = Checked::default();
                    checked.note("the file", format!("it cannot be opened: {error}"));
                    return Ok(checked);
                }
            }
        }
        Location::Postgres(address) => postgres::open_to_read(address).await?.1,
        Location::Unknown(error) => return Err(error.clone().into()),
    };
    let checked = check_open(&mut connection, &location, formats, &mut progress).await;
    // A reader loses nothing if closing fails.
    drop(connection.close().await);
    checked
}

/// Checks a whole database over an open connection.
pub(super) async fn check_open(
    connection: &mut Connection,
    location: &Location,
    formats: &Formats,
    progress: &mut impl FnMut(u64, u64),
) -> Result<Checked, OpenError> {
    let mut checked = Checked::default();
    pages(connection, &mut checked).await;
    if tables(connection, location, &mut checked).await? {
        references(connection, &mut checked).await;
        statements(connection, &mut checked).await;
        texts(connection, &mut checked).await;
        definitions(connection, formats, &mut checked).await;
        imports(connection, &mut checked).await;
        episodes(connection, &mut checked, progress).await;
    }
    Ok(checked)
}

/// Checks pages, indexes and types in SQLite. PostgreSQL has checksums and `amcheck` for that.
async fn pages(database: &mut Connection, checked: &mut Checked) {
    if database.is_postgres() {
        return;
    }
    let pragma = format!("PRAGMA integrity_check({PROBLEMS_MAX})");
    let reported = Statement::of(pragma).all::<String>(database).await;
    match reported {
        Ok(problems) => {
            for problem in problems.into_iter().filter(|problem| problem != "ok") {
                checked.note("the pages", problem);
            }
        }
        Err(error) => checked.note("the pages", unreadable(&error)),
    }
}

/// Checks the migrations table and the schema; false if the tables are too different to be checked further.
async fn tables(
    database: &mut Connection,
    location: &Location,
    checked: &mut Checked,
) -> Result<bool, OpenError> {
    let applied = if database.is_postgres() {
        "SELECT version, checksum, success FROM _sqlx_migrations ORDER BY version"
    } else {
        // SQLite checks no types in this table: a damaged blob may be a text of the same bytes.
        "SELECT version, iif(typeof(checksum) = 'blob', checksum, NULL) AS checksum, success
         FROM _sqlx_migrations ORDER BY version"
    };
    let rows = query(applied).fetch_all(&mut *database).await;
    let applied = rows.and_then(|rows| {
        let read = |row: &SqlRow| {
            let checksum = row.try_get::<Vec<u8>>("checksum")?;
            Ok((row.try_get::<i64>("version")?, checksum, row.try_get::<bool>("success")?))
        };
        rows.iter().map(read).collect::<Result<Vec<_>, sqlx::Error>>()
    });
    let applied = match applied {
        Ok(applied) => applied,
        Err(error) => {
            checked.note("the tables", unreadable(&error));
            return Ok(false);
        }
    };
    let migrator =
        if database.is_postgres() { migrations::postgres() } else { migrations::sqlite() };
    let known: Vec<_> =
        migrator.iter().map(|known| (known.version, known.checksum.to_vec(), true)).collect();
    if applied == known {
        let result = schema(database, &migrator).await;
        checked.note_result("the tables", result);
        return Ok(true);
    }
    if checked.is_sound() && applied.iter().zip(&known).all(|(one, other)| one == other) {
        return Err(OpenError::Tables(location.to_string()));
    }
    checked.note("the tables", "the note of which migrations made them is damaged");
    Ok(false)
}

/// Compares all tables and indexes with those of a freshly migrated database.
async fn schema(
    database: &mut Connection,
    migrator: &sqlx::migrate::Migrator,
) -> Result<Result<(), String>, sqlx::Error> {
    // Quoting distinguishes texts from numbers and blobs. The text of its own table is up to sqlx.
    const OBJECTS: &str = "SELECT quote(name), quote(type) || quote(tbl_name)
            || CASE WHEN name GLOB '_sqlx*' THEN '' ELSE quote(sql) END
        FROM sqlite_schema ORDER BY name";
    // PostgreSQL's catalogue stores no texts to compare.
    let Engine::Sqlite(database) = database.engine() else { return Ok(Ok(())) };
    let mut fresh =
        SqliteConnectOptions::new().in_memory(true).disable_statement_logging().connect().await?;
    migrator.run(&mut fresh).await.map_err(|error| sqlx::Error::Migrate(Box::new(error)))?;
    let made: Vec<(String, String)> = sqlx::query_as(OBJECTS).fetch_all(&mut fresh).await?;
    fresh.close().await?;
    let stored: Vec<(String, String)> = sqlx::query_as(OBJECTS).fetch_all(database).await?;
    // Additional objects are fine: an operator's, or the table `copying` of a copy that is being finished.
    let lost = made.iter().find(|made| !stored.contains(made));
    Ok(lost.map_or(Ok(()), |(name, _)| Err(format!("{name} is not as the migrations make it"))))
}

/// Columns that reference another table: table, column, referenced table, its key.
const REFERENCES: [(&str, &str, &str, &str); 26] = [
    ("acts", "episode", "episodes", "key"),
    ("rounds", "episode", "episodes", "key"),
    ("tokens", "episode", "episodes", "key"),
    ("tokens", "run", "runs", "key"),
    ("seats", "episode", "episodes", "key"),
    ("seats", "owner", "keys", "number"),
    ("claims", "episode", "episodes", "key"),
    ("claims", "owner", "keys", "number"),
    ("claims", "key", "keys", "id"),
    ("results", "episode", "episodes", "key"),
    ("episodes", "owner", "keys", "number"),
    ("episodes", "run", "runs", "key"),
    ("episodes", "fork_of", "episodes", "key"),
    ("episodes", "template", "templates", "key"),
    ("runs", "owner", "keys", "number"),
    ("runs", "entry", "entries", "key"),
    ("runs", "competition", "competitions", "key"),
    ("entries", "competition", "competitions", "key"),
    ("entries", "owner", "keys", "number"),
    ("keys", "acts_for", "keys", "number"),
    ("invitations", "competition", "competitions", "key"),
    ("audit", "competition", "competitions", "key"),
    ("invitations", "entry", "entries", "key"),
    ("import_rounds", "import", "imports", "key"),
    ("metrics", "episode", "episodes", "key"),
    ("unmeasured", "episode", "episodes", "key"),
];

/// Tables whose rows may precede their episode's, in forks that are being written.
const OF_FORKS: [&str; 2] = ["acts", "rounds"];

async fn references(database: &mut Connection, checked: &mut Checked) {
    for (table, column, other, key) in REFERENCES {
        // An anti-join: PostgreSQL answers NOT EXISTS with an index, but not NOT IN.
        let mut query = format!(
            "SELECT count(*) FROM {table} t WHERE t.{column} IS NOT NULL
                 AND NOT EXISTS (SELECT 1 FROM {other} o WHERE o.{key} = t.{column})"
        );
        if OF_FORKS.contains(&table) {
            query += " AND NOT EXISTS (SELECT 1 FROM forking f WHERE f.episode = t.episode)";
        }
        let count = Statement::of(query);
        let result = count.one::<i64>(database).await.map(|count| {
            if count == 0 {
                return Ok(());
            }
            Err(format!("{count} rows have a {column} that is not in {other}"))
        });
        checked.note_result(&format!("the table {table}"), result);
    }
}

/// Invariants of rows: a problem, and a query for the names of rows that have it.
const STATEMENTS: [(&str, &str); 13] = [
    (
        "its status contradicts its times",
        "SELECT id FROM episodes WHERE CASE
             WHEN status IN ('waiting', 'running') THEN ended_at IS NOT NULL OR ending IS NOT NULL OR reason IS NOT NULL
             WHEN status IN ('finished', 'aborted', 'abandoned') THEN ended_at IS NULL OR ending IS NULL OR reason IS NULL
             ELSE TRUE END",
    ),
    (
        "it is voided without a reason, or has a reason without being voided",
        "SELECT id FROM episodes WHERE (voided_at IS NULL) <> (void_reason IS NULL) OR revealed NOT IN (FALSE, TRUE)
         UNION ALL SELECT id FROM runs WHERE (voided_at IS NULL) <> (void_reason IS NULL)",
    ),
    (
        "its place in a run or in a competition is incomplete",
        "SELECT id FROM episodes WHERE (run IS NULL) <> (slot IS NULL)
         UNION ALL SELECT id FROM runs WHERE (entry IS NULL) <> (attempt IS NULL)
         UNION ALL SELECT id FROM runs r
             WHERE competition IS DISTINCT FROM (SELECT competition FROM entries WHERE key = r.entry)",
    ),
    (
        "it is revealed and its competition is not, or the other way round",
        "SELECT id FROM runs r WHERE revealed <> coalesce(
             (SELECT c.revealed_at IS NOT NULL FROM competitions c WHERE c.key = r.competition), FALSE)",
    ),
    (
        "its parent is named without a round, or the other way round, or is a later episode",
        "SELECT id FROM episodes WHERE (fork_of IS NULL) <> (fork_round IS NULL) OR fork_of >= key",
    ),
    (
        "its Idempotency-Key is stored without the hash of its body, or the other way round",
        "SELECT id FROM episodes WHERE (idempotency_key IS NULL) <> (idempotency_body IS NULL)
             OR length(idempotency_body) <> 32
         UNION ALL SELECT id FROM runs WHERE (idempotency_key IS NULL) <> (idempotency_body IS NULL)
             OR length(idempotency_body) <> 32",
    ),
    (
        "its status contradicts its times",
        "SELECT id FROM runs WHERE CASE
             WHEN status = 'running' THEN ended_at IS NOT NULL
             WHEN status IN ('finished', 'aborted', 'abandoned', 'closed') THEN ended_at IS NULL
             ELSE TRUE END",
    ),
    (
        "its status is finished, but one of its games has not ended",
        "SELECT r.id FROM runs r WHERE r.status = 'finished' AND EXISTS (
             SELECT 1 FROM episodes e WHERE e.run = r.key AND e.ended_at IS NULL AND e.voided_at IS NULL)",
    ),
    (
        "its id, role or hash is not that of a key",
        "SELECT id FROM keys WHERE role NOT IN ('member', 'judge', 'organizer', 'entrant') OR length(hash) <> 32
             OR substr(id, 1, 4) <> 'key_'",
    ),
    (
        "its times are out of order, or it is cancelled without a reason",
        "SELECT id FROM competitions WHERE opens_at >= closes_at OR revealed_at < closes_at
             OR (cancelled_at IS NULL) <> (cancel_reason IS NULL) OR hidden NOT IN (FALSE, TRUE)",
    ),
    (
        "its status is unknown",
        "SELECT id FROM entries
         WHERE status NOT IN ('active', 'withdrawn', 'disqualified') OR vouched NOT IN (FALSE, TRUE)",
    ),
    (
        "who decided is not in its record",
        "SELECT 'act of agent ' || agent || ' in round ' || round || ' of episode ' || episode FROM acts
             WHERE source IS NOT NULL
               AND source IS DISTINCT FROM CASE WHEN record LIKE '%\"source\":\"player\"%' THEN 0
                                                WHEN record LIKE '%\"source\":\"clock\"%' THEN 1 END",
    ),
    (
        "one of its seats belongs to no claim",
        "SELECT 'episode ' || s.episode FROM seats s WHERE NOT EXISTS (
             SELECT 1 FROM claims c WHERE c.episode = s.episode AND c.holder = s.holder AND c.model = s.model
                 AND c.owner IS NOT DISTINCT FROM s.owner AND c.player IS NOT DISTINCT FROM s.player)",
    ),
];

/// [`STATEMENTS`] for rows named by a hash.
const OF_HASHES: [(&str, &str); 3] = [
    (
        "this token does not belong to exactly one episode or run, or its hash does not have 32 bytes",
        "SELECT hash FROM tokens WHERE length(hash) <> 32 OR (episode IS NULL) = (run IS NULL)",
    ),
    (
        "this token is of a seat or a holder that its episode or run does not have",
        "SELECT hash FROM tokens t WHERE (run IS NOT NULL AND agent IS NOT NULL)
             OR (episode IS NOT NULL AND holder IS NOT NULL AND NOT EXISTS (
                 SELECT 1 FROM claims c WHERE c.episode = t.episode AND c.holder = t.holder))",
    ),
    (
        "the hash of this invitation does not have 32 bytes",
        "SELECT hash FROM invitations WHERE length(hash) <> 32",
    ),
];

/// Queries for name and text of rows whose text must be JSON of any content.
const JSON_TEXTS: [&str; 3] = [
    "SELECT 'audit ' || number, detail FROM audit",
    "SELECT 'claim ' || holder || ' of episode ' || episode, agent_meta FROM claims",
    "SELECT id, settings FROM imports",
];

/// Checks data derived from texts: templates, `looks`, JSON columns and brief records.
async fn texts(database: &mut Connection, checked: &mut Checked) {
    match templates::damaged(database).await {
        Ok(keys) => keys.into_iter().for_each(|key| {
            checked.note(format!("template {key}"), "its hash differs from that of its text");
        }),
        Err(error) => checked.note("the table templates", unreadable(&error)),
    }
    match damaged_looks(database).await {
        Ok(names) => names.into_iter().for_each(|name| {
            checked.note(name, "its row in `looks` belongs to no entrant");
        }),
        Err(error) => checked.note("the table looks", unreadable(&error)),
    }
    match untaken_names(database).await {
        Ok(names) => names.into_iter().for_each(|name| {
            checked.note(name, "its digests in `used_names` are not those of the entrant's name");
        }),
        Err(error) => checked.note("the table used_names", unreadable(&error)),
    }
    let is_json = |row: &SqlRow| {
        let read = serde_json::from_str::<IgnoredAny>(row.text(1)?);
        Ok(read.map(drop).map_err(|_| "its text is no JSON".to_owned()))
    };
    for query in JSON_TEXTS {
        each_named(database, checked, query, is_json).await;
    }
    let briefs = "SELECT 'act of agent ' || agent || ' in round ' || round || ' of episode ' || episode, brief, record
                  FROM acts WHERE brief IS NOT NULL";
    each_named(database, checked, briefs, |row| {
        let record: RawRecord = get(row, 2)?;
        let act: ActRecord = record.read().map_err(decode)?;
        let is_same = brief_of(&record, || act.brief()) == Some(get(row, 1)?);
        Ok(if is_same {
            Ok(())
        } else {
            Err("its brief form, which replays read, differs from its record".to_owned())
        })
    })
    .await;
}

/// Checks each row of a query, whose first column is a name.
async fn each_named(
    database: &mut Connection,
    checked: &mut Checked,
    text: &'static str,
    check: impl Fn(&SqlRow) -> Result<Result<(), String>, sqlx::Error>,
) {
    let mut rows = query(text).fetch(database);
    let mut problems = 0;
    while problems < PROBLEMS_MAX {
        let row = match rows.try_next().await {
            Ok(Some(row)) => row,
            Ok(None) => return,
            Err(error) => return checked.note("the rows", unreadable(&error)),
        };
        let result = check(&row);
        if !matches!(result, Ok(Ok(()))) {
            problems += 1;
            let name = row.try_get::<String>(0).unwrap_or_else(|_| "a row".to_owned());
            checked.note_result(&name, result);
        }
    }
}

async fn statements(database: &mut Connection, checked: &mut Checked) {
    for (problem, query) in STATEMENTS {
        let query = format!("{query} LIMIT {PROBLEMS_MAX}");
        let names = Statement::of(query);
        match names.all::<String>(database).await {
            Ok(names) => names.into_iter().for_each(|name| checked.note(name, problem)),
            Err(error) => checked.note("the rows", unreadable(&error)),
        }
    }
    for (problem, query) in OF_HASHES {
        let query = format!("{query} LIMIT {PROBLEMS_MAX}");
        let hashes = Statement::of(query);
        match hashes.all::<Vec<u8>>(database).await {
            Ok(hashes) => hashes.into_iter().for_each(|hash| {
                checked.note(data_encoding::HEXUPPER.encode(&hash), problem);
            }),
            Err(error) => checked.note("the rows", unreadable(&error)),
        }
    }
}

/// Checks definitions of runs, competitions and entrants, and the hashes derived from them.
async fn definitions(database: &mut Connection, formats: &Formats, checked: &mut Checked) {
    // Holders of a team are numbered from 1; other tokens of runs name none.
    let runs = "SELECT key, id, definition, digest, model, suite, visibility,
                       (SELECT count(*) FROM tokens t WHERE t.run = r.key AND t.holder IS NULL) AS of_creator,
                       (SELECT min(t.holder) FROM tokens t WHERE t.run = r.key) AS first_holder,
                       (SELECT max(t.holder) FROM tokens t WHERE t.run = r.key) AS last_holder
                FROM runs r";
    each(database, checked, runs, |row| {
        #[derive(Deserialize)]
        struct OwnText {
            suite: Box<RawValue>,
        }
        let text = row.text("definition")?;
        let OwnText { suite } = parsed(text)?;
        let run: Definition = parsed(text)?;
        let digest = data_encoding::HEXLOWER.encode(&Sha256::digest(suite.get())[..6]);
        let is_same = digest == row.text("digest")?
            && run.model == row.text("model")?
            && run.visibility == row.text("visibility")?
            && run.suite.name == row.text("suite")?;
        if !is_same {
            return Ok(
                Err("its suite, model or visibility differs from its definition".to_owned()),
            );
        }
        let holder = |column| row.try_get::<Option<i64>>(column);
        let numbers = [holder("first_holder")?, holder("last_holder")?];
        let is_of_run = if run.is_team() {
            let known = 1..=i64::try_from(run.holders.len()).unwrap_or(i64::MAX);
            row.try_get::<i64>("of_creator")? == 0
                && numbers.into_iter().flatten().all(|number| known.contains(&number))
        } else {
            numbers == [None; 2]
        };
        Ok(if is_of_run { Ok(()) } else { Err("a token of it names no holder of it".to_owned()) })
    })
    .await;
    let competitions = "SELECT key, id, definition, salt, seeds, commitment, created_at, revealed_at, opens_at, closes_at,
                               cancelled_at, cancel_reason, hidden
                        FROM competitions";
    each(database, checked, competitions, |row| {
        let raw = RawCompetition::from_row(row)?;
        let published = raw.commitment;
        let (times, commitment) = (formats.competition)(raw).map_err(decode)?;
        if commitment != published {
            return Ok(Err("its seeds do not fit its commitment".to_owned()));
        }
        if times != [get(row, "opens_at")?, get(row, "closes_at")?] {
            return Ok(Err("its times differ from its definition".to_owned()));
        }
        Ok(Ok(()))
    })
    .await;
    let entries = "SELECT key, id, model, declaration, brief, template FROM entries";
    each(database, checked, entries, |row| {
        let declaration: String = get(row, "declaration")?;
        let brief = row.try_get::<Option<String>>("brief")?;
        let short = without_texts(&declaration).ok();
        // Earlier versions left out that people play.
        let older = short.as_ref().map(|short| short.replace(PEOPLE_PLAY, ""));
        if brief.is_some() && brief != short && brief != older {
            return Ok(Err(
                "its brief declaration, which lists read, differs from its declaration".to_owned(),
            ));
        }
        let (model, template) = (formats.declaration)(declaration).map_err(decode)?;
        let is_same =
            model == row.text("model")? && template == row.try_get::<Option<String>>("template")?;
        Ok(if is_same {
            Ok(())
        } else {
            Err("its model or template is not the declared one".to_owned())
        })
    })
    .await;
}

fn parsed<'a, T: Deserialize<'a>>(json: &'a str) -> Result<T, sqlx::Error> {
    serde_json::from_str(json).map_err(decode)
}

fn decode(problem: impl Into<BoxDynError>) -> sqlx::Error {
    sqlx::Error::Decode(problem.into())
}

/// Checks all rows of a table with a key and an id, in batches.
async fn each(
    database: &mut Connection,
    checked: &mut Checked,
    select: &str,
    check: impl Fn(&SqlRow) -> Result<Result<(), String>, sqlx::Error>,
) {
    let mut last = i64::MIN;
    loop {
        let query = format!("{select} WHERE key > $1 ORDER BY key LIMIT $2");
        let rows = Statement::of(query).bind(last).bind(CHUNK);
        let rows = match rows.fetch_all(&mut *database).await {
            Ok(rows) if rows.is_empty() => return,
            Ok(rows) => rows,
            Err(error) => return checked.note("the rows", unreadable(&error)),
        };
        for row in &rows {
            let id = row.try_get::<String>("id").unwrap_or_else(|_| "a row".to_owned());
            match row.try_get("key") {
                Ok(key) => last = key,
                Err(error) => return checked.note(id, unreadable(&error)),
            }
            checked.note_result(&id, check(row));
        }
    }
}

/// Checks imported games: a digest covers everything but the acts.
async fn imports(database: &mut Connection, checked: &mut Checked) {
    let mut last = i64::MIN;
    loop {
        let next = "SELECT key, id, digest, run_id, meta, score, rounds FROM imports WHERE key > $1 ORDER BY key LIMIT 1";
        let row = match query(next).bind(last).fetch_optional(&mut *database).await {
            Ok(Some(row)) => row,
            Ok(None) => return,
            Err(error) => return checked.note("the imports", unreadable(&error)),
        };
        let id = row.try_get::<String>("id").unwrap_or_else(|_| "an import".to_owned());
        match row.try_get("key") {
            Ok(key) => last = key,
            Err(error) => return checked.note(id, unreadable(&error)),
        }
        let result = import(database, last, &row).await;
        checked.note_result(&id, result);
    }
}

async fn import(
    database: &mut Connection,
    key: i64,
    row: &SqlRow,
) -> Result<Result<(), String>, sqlx::Error> {
    let mut digest = ImportHash::new(row.text("run_id")?, row.text("meta")?);
    let mut last: Option<(i64, f64)> = None;
    let text =
        "SELECT round, score, state, acts FROM import_rounds WHERE import = $1 ORDER BY round";
    let mut rounds = query(text).bind(key).fetch(database);
    while let Some(round) = rounds.try_next().await? {
        let number = round.try_get("round")?;
        if number != last.map_or(0, |(round, _)| round + 1) {
            return Ok(Err(format!("before round {number} one is missing")));
        }
        let score = round.try_get("score")?;
        digest.add(score, round.text("state")?);
        last = Some((number, score));
        let acts = round.try_get::<Option<Vec<u8>>>("acts")?;
        let unpacked = acts.map(|acts| {
            std::io::copy(&mut flate2::read::GzDecoder::new(acts.as_slice()), &mut std::io::sink())
        });
        if let Some(Err(error)) = unpacked {
            return Ok(Err(format!("the acts of round {number} cannot be unpacked: {error}")));
        }
    }
    drop(rounds);
    let expected = Some((row.try_get("rounds")?, row.try_get("score")?));
    if get::<[u8; 32]>(row, "digest")? != digest.finish() || last != expected {
        return Ok(Err("its rounds or its score do not fit its digest".to_owned()));
    }
    Ok(Ok(()))
}

async fn episodes(
    database: &mut Connection,
    checked: &mut Checked,
    progress: &mut impl FnMut(u64, u64),
) {
    let count = query("SELECT count(*) FROM episodes");
    let of = count.one::<i64>(database).await.unwrap_or_default().unsigned_abs();
    let mut last = i64::MIN;
    let mut done = 0;
    loop {
        let next = query("SELECT key, id FROM episodes WHERE key > $1 ORDER BY key LIMIT $2");
        let rows = match next.bind(last).bind(CHUNK).fetch_all(&mut *database).await {
            Ok(rows) if rows.is_empty() => return,
            Ok(rows) => rows,
            Err(error) => return checked.note("the episodes", unreadable(&error)),
        };
        for row in rows {
            let id = row.try_get::<String>("id").unwrap_or_else(|_| "an episode".to_owned());
            match row.try_get("key") {
                Ok(key) => last = key,
                Err(error) => return checked.note(id, unreadable(&error)),
            }
            let result = in_one_view(database, EpisodeKey(last)).await.map(|judged| {
                judged.map(|rounds| {
                    checked.episodes += 1;
                    checked.rounds += u64::from(rounds);
                })
            });
            checked.note_result(&id, result);
            done += 1;
            progress(done, of);
        }
    }
}

/// Checks an episode in one snapshot; returns its number of rounds.
async fn in_one_view(
    database: &mut Connection,
    key: EpisodeKey,
) -> Result<Result<u32, String>, sqlx::Error> {
    database.transaction(Begin::Read, async |view| episode(view, key).await).await
}

async fn episode(
    database: &mut Connection,
    key: EpisodeKey,
) -> Result<Result<u32, String>, sqlx::Error> {
    let text = concat!("SELECT ", opening!(), ", seating, ending, head, id, task, model, visibility, status, reason, clocked, open_seats, created_at,
                        score, rounds, seed, curve, people,
                        coalesce(fork_round, 0) AS first_round,
                        (SELECT id FROM runs WHERE runs.key = e.run) AS run,
                        (SELECT definition FROM runs WHERE runs.key = e.run) AS of_run,
                        (SELECT id FROM episodes parent WHERE parent.key = e.fork_of) AS fork_of
                 FROM episodes e WHERE key = $1");
    let row = query(text).bind(key.0).fetch_one(&mut *database).await?;
    let raw = |column| get::<Option<RawRecord>>(&row, column);
    let Some(opening) = raw("opening")? else { return Ok(Err("it has no opening".to_owned())) };
    let (seating, ending) = (raw("seating")?, raw("ending")?);
    let stored_head = get(&row, "head")?;
    let first_round: u32 = get(&row, "first_round")?;
    if ending.is_none() {
        let link = |head: Head, raw: &RawRecord| head.link(raw.as_str().as_bytes());
        let before = match first_round.checked_sub(1) {
            None => Some(link(Head::START, &opening)),
            Some(last) => head_after(database, key, last).await?,
        };
        let linked = before.map(|head| seating.as_ref().map_or(head, |raw| link(head, raw)));
        if linked != Some(stored_head) {
            return Ok(Err("its opening was changed: the hash differs".to_owned()));
        }
    }
    let rounds = match rounds(database, key).await? {
        Ok(rounds) => rounds,
        Err(problem) => return Ok(Err(problem)),
    };
    let ending = ending.map(|ending| (ending, stored_head));
    let stored = StoredJournal { episode: key, opening, first_round, seating, rounds, ending };
    let report = match replay_stored(database, &stored).await? {
        Ok(report) => report,
        Err(problem) => return Ok(Err(problem)),
    };
    if let Err(problem) = columns(&row, &report.opening, report.end.as_ref())? {
        return Ok(Err(problem));
    }
    if let Err(problem) = listed(database, key, &row, &report).await? {
        return Ok(Err(problem));
    }
    if let Err(problem) = seats(database, key, &report, stored.seating.as_ref()).await? {
        return Ok(Err(problem));
    }
    if let Err(problem) = players(&row, &report.opening, stored.seating.as_ref())? {
        return Ok(Err(problem));
    }
    if let Err(problem) = open_acts(database, key, &report).await? {
        return Ok(Err(problem));
    }
    if let Err(problem) = result(database, key, &report).await? {
        return Ok(Err(problem));
    }
    Ok(metrics(database, key, &report.opening.episode).await?.map(|()| rounds))
}

/// Compares stored metrics with those computed from the journal. Metrics of earlier revisions cannot be recomputed.
async fn metrics(
    database: &mut Connection,
    key: EpisodeKey,
    id: &str,
) -> Result<Result<(), String>, sqlx::Error> {
    let text = "SELECT embedder, revision, measured FROM metrics WHERE episode = $1";
    for row in query(text).bind(key.0).fetch_all(&mut *database).await? {
        let (embedder, revision) = stored_method();
        if is_worth(row.text("embedder")?, row.try_get::<u32>("revision").unwrap_or(0)) {
            continue;
        }
        let known = 1..=revision;
        let is_known = known.contains(&row.try_get::<u32>("revision").unwrap_or(0));
        if row.text("embedder")? != embedder || !is_known {
            return Ok(Err(format!("{NO_METRICS} they were computed in an unknown way")));
        }
        if row.try_get::<u32>("revision")? < revision {
            continue;
        }
        let measured = match rebuild::measured(database, key, id.to_owned()).await {
            Ok(measured) => measured,
            Err(RebuildError::Sqlite(error)) => return Err(error),
            Err(error) => return Ok(Err(error.to_string())),
        };
        if row.text("measured")? != measured.measured {
            return Ok(Err(format!("{NO_METRICS} its own are others")));
        }
    }
    Ok(Ok(()))
}

const NO_METRICS: &str =
    "its metrics are not those of its journal (`swarmbench board rebuild` computes them again):";

async fn head_after(
    database: &mut Connection,
    key: EpisodeKey,
    round: u32,
) -> Result<Option<Head>, sqlx::Error> {
    let query = query("SELECT head FROM rounds WHERE episode = $1 AND round = $2");
    let row = query.bind(key.0).bind(round).fetch_optional(database).await?;
    row.map(|row| get(&row, 0)).transpose()
}

/// The number of rounds, which must have no gaps.
async fn rounds(
    database: &mut Connection,
    key: EpisodeKey,
) -> Result<Result<u32, String>, sqlx::Error> {
    let text = "SELECT count(*), coalesce(max(round) + 1, 0) FROM rounds WHERE episode = $1";
    let row = query(text).bind(key.0).fetch_one(database).await?;
    let (count, next) = (row.try_get::<u32>(0)?, row.try_get::<u32>(1)?);
    Ok(if count == next { Ok(count) } else { Err(format!("it has {count} of {next} rounds")) })
}

/// Compares the columns by which lists are filtered with the records.
fn columns(
    row: &SqlRow,
    opening: &Opening,
    end: Option<&End>,
) -> Result<Result<(), String>, sqlx::Error> {
    let config = &opening.config;
    let expected = [
        ("id", Some(opening.episode.as_str())),
        ("task", Some(config.task.as_str())),
        ("model", Some(config.model.as_str())),
        ("visibility", Some(config.visibility.as_str())),
        ("reason", end.map(|end| end.reason.as_str())),
        ("run", opening.run.as_deref()),
        ("fork_of", opening.fork.as_ref().map(|fork| fork.episode.as_str())),
    ];
    for (column, value) in expected {
        if row.try_get::<Option<String>>(column)?.as_deref() != value {
            return Ok(Err(format!("its {column} is not the one in its journal")));
        }
    }
    if row.try_get::<u32>("first_round")? != opening.first_round() {
        return Ok(Err("it is a fork of another round than its journal says".to_owned()));
    }
    if let Some(end) = end
        && row.text("status")? != end.status
    {
        return Ok(Err("its status is not the one in its journal".to_owned()));
    }
    if config.round_deadline_ms.is_some() && !row.try_get::<bool>("clocked")? {
        return Ok(Err(
            "it has a clock, but its row says that it has none: a restart would not recover it"
                .to_owned(),
        ));
    }
    if row.try_get::<Option<bool>>("open_seats")?.is_some_and(|mixed| mixed != config.is_mixed()) {
        return Ok(Err("whether it has several holders is not as in its journal".to_owned()));
    }
    if row.try_get::<i64>("created_at")? != opening.created_at.as_millisecond() {
        return Ok(Err("it was created at another time than its journal says".to_owned()));
    }
    Ok(Ok(()))
}

/// Compares what lists show and sort by with the journal. Scores of earlier versions were read from texts by the database, which may
/// round the last digit in another way.
async fn listed(
    database: &mut Connection,
    key: EpisodeKey,
    row: &SqlRow,
    report: &JournalReport,
) -> Result<Result<(), String>, sqlx::Error> {
    let number = |column| row.try_get::<Option<f64>>(column);
    let (score, rounds, seed) = (number("score")?, number("rounds")?, number("seed")?);
    let curve: Option<Vec<f64>> = match row.try_get::<Option<String>>("curve")? {
        None => None,
        Some(text) => Some(parsed(&text)?),
    };
    let metas = query("SELECT agent_meta FROM claims WHERE episode = $1").bind(key.0);
    let metas = metas.fetch_all(&mut *database).await?;
    let mut has_people = is_human(&report.opening.agent_meta);
    for meta in metas {
        has_people |= is_human(&parsed(&meta.try_get::<String>("agent_meta")?)?);
    }
    if row.try_get::<bool>("people")? != has_people {
        return Ok(Err("whether people take part in it is not as its records say".to_owned()));
    }
    let is_same = if report.end.is_none() {
        [score, rounds, seed] == [None; 3] && curve.is_none()
    } else {
        let shown = if report.rounds > 0 { report.score } else { 0.0 };
        let points = super::episodes::curve(database, key, report.rounds).await?;
        let is_near = |a: f64, b: f64| (a - b).abs() <= 1e-12 * b.abs();
        score.is_some_and(|score| is_near(score, shown))
            && rounds == Some(f64::from(report.rounds))
            && seed.is_some_and(|seed| seed.to_string() == report.opening.config.seed.to_string())
            && curve.is_some_and(|curve| {
                curve.len() == points.len() && curve.iter().zip(points).all(|(a, b)| is_near(*a, b))
            })
    };
    Ok(if is_same { Ok(()) } else { Err("what lists show of it is not in its journal".to_owned()) })
}

/// Compares the table of seats with the seating record, which is written once all seats have holders.
async fn seats(
    database: &mut Connection,
    key: EpisodeKey,
    report: &JournalReport,
    record: Option<&RawRecord>,
) -> Result<Result<(), String>, sqlx::Error> {
    let query = query("SELECT agent, holder FROM seats WHERE episode = $1 ORDER BY agent");
    let rows = query.bind(key.0).fetch_all(database).await?;
    let record = match record.map(RawRecord::read).transpose().map_err(decode)? {
        None => None,
        Some(Record::Seats(record)) => Some(record),
        Some(Record::Opening(_) | Record::Round(_) | Record::End(_)) => {
            return Ok(Err("its record of seats is a record of another kind".to_owned()));
        }
    };
    let config = &report.opening.config;
    if record.is_some() && config.is_mixed() && rows.len() != usize::from(config.num_agents) {
        return Ok(Err(format!("{} of its {} seats have holders", rows.len(), config.num_agents)));
    }
    for row in rows {
        let (agent, holder) = (row.try_get::<i64>("agent")?, row.try_get::<i64>("holder")?);
        let name = format!("Agent_{agent}");
        let place = usize::try_from(agent).unwrap_or(usize::MAX);
        let is_held = |record: &Seats| {
            let seat = record.seats.get(place);
            seat.is_some_and(|seat| seat.agent == name && i64::from(seat.holder) == holder)
        };
        let exists = (0..i64::from(report.opening.config.num_agents)).contains(&agent);
        if !exists || !record.as_ref().is_none_or(is_held) {
            return Ok(Err(format!(
                "the holder of the seat of {name} is not the one in its record of seats"
            )));
        }
    }
    Ok(Ok(()))
}

/// Compares who plays a game, and what is declared of them, with the definition of its run. A damaged definition is named with its
/// run.
fn players(
    row: &SqlRow,
    opening: &Opening,
    record: Option<&RawRecord>,
) -> Result<Result<(), String>, sqlx::Error> {
    let Some(text) = row.try_get::<Option<String>>("of_run")? else { return Ok(Ok(())) };
    let Ok(run) = serde_json::from_str::<Definition>(&text) else { return Ok(Ok(())) };
    let is_player = |declared: &Option<String>, played: &Option<String>| {
        // The opening names the player that each task has for this name.
        let is_default = declared.as_deref() == Some(DEFAULT_PLAYER) && played.is_some();
        is_default || declared == played
    };
    let (declared, played) = (run.recorded_holders(), &opening.config.holders);
    let mut is_same = is_player(&run.player, &opening.config.player)
        && run.agent_meta() == opening.agent_meta
        && declared.len() == played.len()
        && declared.into_iter().zip(played).all(|(declared, played)| {
            let is_known = is_player(&declared.player, &played.player);
            is_known && TeamHolder { player: played.player.clone(), ..declared } == *played
        });
    if let Some(Record::Seats(Seats { holders, .. })) =
        record.map(RawRecord::read).transpose().map_err(decode)?
    {
        is_same &= holders.iter().filter(|holder| holder.holder > 0).all(|holder| {
            let declared = run.holders.get(holder.holder as usize - 1);
            declared.is_some_and(|declared| declared.agent_meta_of_seats() == holder.agent_meta)
        });
    }
    Ok(if is_same { Ok(()) } else { Err("its players are not those of its run".to_owned()) })
}

/// Compares the acts of the unresolved round with those of the end record, if there is one.
async fn open_acts(
    database: &mut Connection,
    key: EpisodeKey,
    report: &JournalReport,
) -> Result<Result<(), String>, sqlx::Error> {
    let text = "SELECT round, agent, record FROM acts WHERE episode = $1 AND round >= $2 ORDER BY round, agent";
    let rows = query(text).bind(key.0).bind(report.rounds).fetch_all(database).await?;
    let mut acts = Vec::new();
    for row in rows {
        let act: ActRecord = parsed(row.text("record")?)?;
        let agent = format!("Agent_{}", row.try_get::<u16>("agent")?);
        if row.try_get::<u32>("round")? != report.rounds || act.agent != agent {
            return Ok(Err(format!("an act of {agent} belongs to no round")));
        }
        acts.push(act);
    }
    let is_same = report.end.as_ref().is_none_or(|end| end.open_acts == acts);
    Ok(if is_same { Ok(()) } else { Err("its open acts differ from those in its end".to_owned()) })
}

/// Compares the row in `results` with the one computed from the journal.
async fn result(
    database: &mut Connection,
    key: EpisodeKey,
    report: &JournalReport,
) -> Result<Result<(), String>, sqlx::Error> {
    let text = "SELECT task, seed, score, rounds, status, acts, invalid, clock_outs, prompt_tokens, completion_tokens,
                        failures, usage
                 FROM results WHERE episode = $1";
    let row = query(text).bind(key.0).fetch_optional(database).await?;
    let end = report.end.as_ref().filter(|_| report.opening.counts());
    let (row, end) = match (row, end) {
        (None, None) => return Ok(Ok(())),
        (Some(row), Some(end)) => (row, end),
        (None, Some(_)) => return Ok(Err(format!("{NO_RESULT} it has none"))),
        (Some(_), None) => return Ok(Err(format!("{NO_RESULT} it has one, and is to have none"))),
    };
    let is_same = Tally::from_row(&row)? == as_stored(report.tally)
        && row.text("task")? == report.opening.config.task
        && row.try_get::<i64>("seed")? == i64::from(report.opening.config.seed)
        && row.try_get::<f64>("score")?.to_bits() == report.score.to_bits()
        && row.try_get::<u32>("rounds")? == report.rounds
        && row.text("usage")? == json(&report.tally.usage)
        && row.text("status")? == end.status;
    Ok(if is_same { Ok(()) } else { Err(format!("{NO_RESULT} its own is another")) })
}

const NO_RESULT: &str = "its row in `results` is not the one of its journal (`swarmbench board rebuild` makes it again):";

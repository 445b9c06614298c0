//! A bare writer of PostgreSQL. A group is one statement, which counts the commit in the writer's row, and writes
//! nothing if that row is gone, like the server's statement.

use sqlx::migrate::Migrator;
use sqlx::postgres::{PgArguments, PgBindIterExt as _, PgConnectOptions, PgConnection};
use sqlx::{Arguments as _, AssertSqlSafe, ConnectOptions as _, Connection as _};

use super::{AT_MS, DIGEST, Group, HEAD, SCORE};

/// The writer's row in `nodes`, the first of its database.
pub(crate) const INCARNATION: i64 = 1;

/// Inserts the rows of a commit and increases the count in the writer's row. Returns 0 and writes nothing if that row
/// has another count.
pub(crate) const APPEND: &str = "
    WITH me AS (UPDATE nodes SET committed = committed + 1 WHERE incarnation = $1 AND committed = $2 RETURNING 1),
         a AS (INSERT INTO acts (episode, round, agent, waiting_for, source, at, record, brief)
               SELECT t.* FROM me, unnest($3::bigint[], $4::integer[], $5::smallint[], $6::smallint[], $7::smallint[],
                                          $8::bigint[], $9::text[], $10::text[]) AS t),
         r AS (INSERT INTO rounds (episode, round, digest, score, head, at)
               SELECT t.* FROM me, unnest($11::bigint[], $12::integer[], $13::bytea[], $14::double precision[],
                                          $15::bytea[], $16::bigint[]) AS t)
    SELECT count(*) FROM me";

/// A database with the server's tables, which is dropped with the value.
pub(crate) struct Scratch {
    server: PgConnectOptions,
    name: Option<String>,
}

impl Scratch {
    /// Creates a database on the server of a URL, and connects to it. The user of the URL must be allowed to create
    /// one.
    pub(crate) async fn create(
        url: &str,
        tables: &Migrator,
    ) -> Result<(Self, PgConnection), sqlx::Error> {
        let server: PgConnectOptions = url.parse()?;
        let server = server.disable_statement_logging();
        let mut connection = server.connect().await?;
        // A random name, as load tests of other machines may have databases there, too.
        let name = sqlx::query_scalar(
            "SELECT 'swarmbench_loadtest_' || replace(gen_random_uuid()::text, '-', '')",
        );
        let name: String = name.fetch_one(&mut connection).await?;
        sqlx::raw_sql(AssertSqlSafe(format!("CREATE DATABASE {name}")))
            .execute(&mut connection)
            .await?;
        let scratch = Self { server, name: Some(name) };
        connection.close().await?;
        let mut connection = scratch.options().connect().await?;
        tables
            .run(&mut connection)
            .await
            .map_err(|error| sqlx::Error::Protocol(error.to_string()))?;
        sqlx::query("INSERT INTO nodes (name, started_at) VALUES ('bare writer', 0)")
            .execute(&mut connection)
            .await?;
        // Whatever the default of this server: the server's own acts are on the disk, too.
        sqlx::raw_sql("SET synchronous_commit = on").execute(&mut connection).await?;
        Ok((scratch, connection))
    }

    fn options(&self) -> PgConnectOptions {
        self.name.iter().fold(self.server.clone(), |options, name| options.database(name))
    }

    /// Drops the database and ends all connections to it.
    pub(crate) async fn remove(mut self) -> Result<(), sqlx::Error> {
        remove(self.server.clone(), self.name.take()).await
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let Some(name) = self.name.take() else { return };
        let server = self.server.clone();
        // A separate thread, as this one may already run a runtime. A database that cannot be dropped stays behind.
        let dropped = std::thread::spawn(move || {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
            runtime.block_on(remove(server, Some(name)))
        });
        drop(dropped.join());
    }
}

async fn remove(server: PgConnectOptions, name: Option<String>) -> Result<(), sqlx::Error> {
    let Some(name) = name else { return Ok(()) };
    let mut connection = server.connect().await?;
    let drop = format!("DROP DATABASE IF EXISTS {name}");
    // Without `FORCE` the drop ends PostgreSQL's own work there, such as a vacuum; with it, only sessions that this
    // role may end.
    if sqlx::raw_sql(AssertSqlSafe(drop.clone())).execute(&mut connection).await.is_err() {
        let drop = drop + " WITH (FORCE)";
        sqlx::raw_sql(AssertSqlSafe(drop)).execute(&mut connection).await?;
    }
    connection.close().await
}

pub(super) struct Writer {
    connection: PgConnection,
    scratch: Scratch,
    /// Commits so far.
    committed: i64,
}

impl Writer {
    pub(super) async fn open(url: &str, tables: &Migrator) -> Result<Self, sqlx::Error> {
        let (scratch, connection) = Scratch::create(url, tables).await?;
        Ok(Self { connection, scratch, committed: 0 })
    }

    pub(super) async fn commit(&mut self, group: Group<'_>) -> Result<(), sqlx::Error> {
        let arguments = self.arguments(group).map_err(sqlx::Error::Encode)?;
        let append = sqlx::query_scalar_with(APPEND, arguments);
        let counted: i64 = append.fetch_one(&mut self.connection).await?;
        if counted != 1 {
            return Err(sqlx::Error::Protocol("the row of the bare writer is gone".to_owned()));
        }
        self.committed += 1;
        Ok(())
    }

    /// Binds each column as an array that is encoded directly from an iterator.
    fn arguments(&self, group: Group<'_>) -> Result<PgArguments, sqlx::error::BoxDynError> {
        let (acts, rounds) = (|| group.acts(), || group.rounds());
        let mut to = PgArguments::default();
        to.add(INCARNATION)?;
        to.add(self.committed)?;
        to.add(acts().map(|act| act.episode).bind_iter())?;
        to.add(acts().map(|act| act.round).bind_iter())?;
        to.add(acts().map(|act| act.agent).bind_iter())?;
        to.add(acts().map(|act| act.waiting_for).bind_iter())?;
        to.add(acts().map(|_| 0_i16).bind_iter())?;
        to.add(acts().map(|_| AT_MS).bind_iter())?;
        to.add(acts().map(|_| group.record).bind_iter())?;
        to.add(acts().map(|_| None::<&str>).bind_iter())?;
        to.add(rounds().map(|round| round.episode).bind_iter())?;
        to.add(rounds().map(|round| round.round).bind_iter())?;
        to.add(rounds().map(|_| DIGEST).bind_iter())?;
        to.add(rounds().map(|_| SCORE).bind_iter())?;
        to.add(rounds().map(|_| HEAD).bind_iter())?;
        to.add(rounds().map(|_| AT_MS).bind_iter())?;
        Ok(to)
    }

    pub(super) async fn close(self) -> Result<(), sqlx::Error> {
        self.connection.close().await?;
        self.scratch.remove().await
    }

    #[cfg(test)]
    pub(super) fn connection(&mut self) -> &mut PgConnection {
        &mut self.connection
    }

    #[cfg(test)]
    pub(super) fn database(&self) -> &str {
        self.scratch.name.as_deref().expect("it is not removed")
    }
}

/// The number of acts that a commit adds after the writer's row was deleted.
#[cfg(test)]
pub(super) async fn count_fenced(writer: &mut Writer) -> i64 {
    let count = async |writer: &mut Writer| -> i64 {
        let count = sqlx::query_scalar("SELECT count(*) FROM acts");
        count.fetch_one(writer.connection()).await.expect("a count")
    };
    let before = count(writer).await;
    let deleted = sqlx::query("DELETE FROM nodes").execute(writer.connection()).await;
    deleted.expect("deleted");
    let group = Group { first: 120, acts: 12, episodes: 1, record: "{}" };
    writer.commit(group).await.expect_err("it has no row");
    count(writer).await - before
}

/// The number of databases with these names on the server.
#[cfg(test)]
pub(super) async fn databases(url: &str, names: &[String]) -> i64 {
    let mut connection = PgConnection::connect(url).await.expect("a server");
    let count = sqlx::query_scalar("SELECT count(*) FROM pg_database WHERE datname = ANY($1)");
    count.bind(names).fetch_one(&mut connection).await.expect("a count")
}

//! PostgreSQL: a database on another machine, which one server, or several that know each other, may write to.

pub(super) mod bulk;
pub(super) mod cluster;
pub(super) mod group;
pub(super) mod rows;
pub(super) mod session;

use std::time::{Duration, Instant};

use sqlx::migrate::MigrateError;
use sqlx::postgres::PgConnectOptions;

use super::location::Address;
use super::sql::{Connection, Engine};
use super::{OpenError, copy};
use crate::migrations;
use cluster::Joining;
use group::Committer;
use session::{Server, SessionError};

/// Wait for the session of a process that has just ended, and interval between attempts.
const PREDECESSOR_PATIENCE: Duration = Duration::from_secs(3);
const PREDECESSOR_PAUSE: Duration = Duration::from_millis(50);

/// A database that only this process writes to.
pub(super) struct Opened {
    pub(super) committer: Committer,
    pub(super) readers: PgConnectOptions,
}

/// Takes a database for this process, alone or together with others, after it was checked that what is acknowledged stays; and
/// brings its tables up to date.
pub(super) async fn open(
    address: &Address,
    joining: Option<&Joining>,
) -> Result<Opened, OpenError> {
    let server = Server::at(address)?;
    let readers = server.readers();
    let connection = ready(&server, joining).await?;
    let committer = Committer::join(server, connection, joining).await?;
    Ok(Opened { committer, readers })
}

/// A connection for a command that writes while no server has the database.
pub(super) async fn open_alone(address: &Address) -> Result<Connection, OpenError> {
    let server = Server::at(address)?;
    ready(&server, None).await
}

/// Takes a database, and brings its tables up to date.
async fn ready(server: &Server, joining: Option<&Joining>) -> Result<Connection, OpenError> {
    let mut connection = lock(server, joining.is_some()).await?;
    refuse_unfinished(server, &mut connection).await?;
    if let Some(joining) = joining {
        cluster::check(server, &mut connection, joining).await?;
    }
    migrate(server, &mut connection).await?;
    if joining.is_none() {
        group::exclude_others(&mut connection).await.map_err(|error| server.failed(error))?;
    }
    let prepared = super::prepare(&mut connection).await;
    prepared.map_err(|error| server.failed(error))?;
    Ok(connection)
}

/// Takes a database for this process alone, as it is.
pub(super) async fn take(address: &Address) -> Result<Connection, OpenError> {
    lock(&Server::at(address)?, false).await
}

/// Makes the tables of this version, or those that are missing, in a database that was taken.
pub(super) async fn make_tables(
    connection: &mut Connection,
    address: &Address,
) -> Result<(), OpenError> {
    let server = Server::at(address)?;
    migrate(&server, connection).await?;
    group::exclude_others(connection).await.map_err(|error| server.failed(error).into())
}

async fn refuse_unfinished(server: &Server, connection: &mut Connection) -> Result<(), OpenError> {
    let unfinished = copy::unfinished(connection).await.map_err(|error| server.failed(error))?;
    copy::refuse(unfinished, server.location())
}

async fn lock(server: &Server, is_shared: bool) -> Result<Connection, OpenError> {
    let mut connection = Connection::Postgres(server.connect().await?);
    server.check(&mut connection).await?;
    server.refuse_pooler(&mut connection).await?;
    server.refuse_foreign(&mut connection).await?;
    let failed = |error| server.failed(error);
    if !lock_of_predecessor(&mut connection, is_shared).await.map_err(failed)? {
        // A database that is taken for the first time has no such table yet.
        let by = session::newest_holder(&mut connection).await.ok().flatten();
        let by = by.unwrap_or_else(|| "another process".to_owned());
        let holder = session::lock_holder(&mut connection).await.map_err(failed)?;
        let session =
            holder.map_or_else(String::new, |(_, pid)| format!(", session {pid} of PostgreSQL"));
        return Err(OpenError::InUse(format!("{} (by {by}{session})", server.location())));
    }
    server.set_up_writer(&mut connection).await.map_err(failed)?;
    Ok(connection)
}

/// Takes the lock of the database. The session of a process that has just ended may hold it for a moment: PostgreSQL ends what it did
/// before it looks at the connection.
async fn lock_of_predecessor(
    connection: &mut Connection,
    is_shared: bool,
) -> Result<bool, sqlx::Error> {
    let until = Instant::now() + PREDECESSOR_PATIENCE;
    loop {
        if session::try_lock(connection, is_shared).await? {
            return Ok(true);
        }
        if Instant::now() >= until {
            return Ok(false);
        }
        tokio::time::sleep(PREDECESSOR_PAUSE).await;
    }
}

async fn migrate(server: &Server, connection: &mut Connection) -> Result<(), OpenError> {
    let Engine::Postgres(raw) = connection.engine() else { unreachable!("it is of PostgreSQL") };
    let migrated = migrations::postgres().run(raw).await;
    migrated.map_err(|source| match source {
        MigrateError::Execute(error) | MigrateError::ExecuteMigration(error, _)
            if session::sqlstate(&error).as_deref() == Some(session::FORBIDDEN) =>
        {
            SessionError::Forbidden(server.location().to_owned(), error).into()
        }
        source => OpenError::of_migration(server.location(), source),
    })
}

/// A connection that only reads, also while a server has the database.
pub(super) async fn open_to_read(address: &Address) -> Result<(Server, Connection), OpenError> {
    let server = Server::at(address)?;
    let mut connection = Connection::Postgres(server.connect().await?);
    server.refuse_empty(&mut connection).await?;
    refuse_unfinished(&server, &mut connection).await?;
    Ok((server, connection))
}

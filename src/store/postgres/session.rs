//! Connections to PostgreSQL, and what has to be true of a server before anything is written to it.

use std::io::ErrorKind;
use std::time::Duration;

use sqlx::postgres::{PgConnectOptions, PgConnection};
use sqlx::{ConnectOptions as _, raw_sql};

use crate::store::location::Address;
use crate::store::sql::{Connection, query};

/// The oldest PostgreSQL that this program is tested with.
const VERSION_MIN: i64 = 150_000;

/// The code of an error: the role has no right to do it.
pub(super) const FORBIDDEN: &str = "42501";

/// Maximum time of connecting.
const CONNECT_PATIENCE: Duration = Duration::from_secs(10);

/// Settings of each session. Short queries: compiling them takes longer than they do. A connection of ours may be idle for
/// days. These are no parameters of the startup, which poolers refuse.
const SETTINGS: &str = "SET jit = off; SET idle_session_timeout = 0; SET client_min_messages = warning; \
                        SET extra_float_digits = 2";

/// Prepared statements that a connection keeps.
const STATEMENTS_KEPT: usize = 256;

/// Why a database of PostgreSQL cannot be used. Each says what to do.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    #[error("the file with the password, {path}, cannot be read")]
    PasswordFile { path: std::path::PathBuf, source: std::io::Error },
    #[error(
        "nothing answers at {0}: is PostgreSQL running there, and does it listen on this address?"
    )]
    Unreachable(String, #[source] sqlx::Error),
    #[error(
        "PostgreSQL refuses the user of {0}: check user and password (PGPASSWORD, ~/.pgpass, or password_file in the \
         address), and pg_hba.conf"
    )]
    Login(String, #[source] sqlx::Error),
    #[error("there is no database {0}: create it with `createdb`, with an encoding of UTF8")]
    NoDatabase(String),
    #[error(
        "PostgreSQL at {0} has no connection left: raise max_connections, this program needs ten"
    )]
    Full(String),
    #[error("PostgreSQL at {location} is version {version}: 15 or newer is needed")]
    Version { location: String, version: String },
    #[error(
        "{location} has {setting} = {value}: what is acknowledged could be lost. Set {setting} = {wanted} in \
         postgresql.conf, and reload"
    )]
    Unsafe { location: String, setting: &'static str, value: String, wanted: &'static str },
    #[error(
        "{0} has the encoding {1}: create a database with `createdb --encoding UTF8 --template template0`"
    )]
    Encoding(String, String),
    #[error("{0} is a standby, or only to be read: name the primary")]
    Standby(String),
    #[error(
        "between this server and {0} is a pooler that gives each transaction another session: name PostgreSQL itself, \
         or set the pooler to pool_mode = session"
    )]
    Pooler(String),
    #[error(
        "the role of {0} may not make tables there: let it own the database (ALTER DATABASE … OWNER TO …), or give it the right \
         in its schema (GRANT CREATE ON SCHEMA public TO …)"
    )]
    Forbidden(String, #[source] sqlx::Error),
    #[error(
        "TLS with {0} fails: check sslmode, sslrootcert (the authority that signed the certificate of PostgreSQL), sslcert and \
         sslkey in the address"
    )]
    Tls(String, #[source] sqlx::Error),
    #[error("{0} has no tables of this program yet: `swarmbench serve` makes them")]
    Empty(String),
    #[error(
        "{0} has tables of another program: create a database for this one, with `createdb`, and name it with --db"
    )]
    Foreign(String),
    #[error("the database {location} cannot be used")]
    Failed { location: String, source: sqlx::Error },
}

/// Options of connections for one purpose.
#[derive(Clone)]
pub(in crate::store) struct Server {
    options: PgConnectOptions,
    location: String,
}

impl Server {
    pub(in crate::store) fn at(address: &Address) -> Result<Self, SessionError> {
        let options = address
            .options()
            .map_err(|(path, source)| SessionError::PasswordFile { path, source })?;
        let options = options
            .statement_cache_capacity(STATEMENTS_KEPT)
            .application_name("swarmbench")
            .extra_float_digits(None)
            .disable_statement_logging();
        Ok(Self { options, location: address.to_string() })
    }

    pub(in crate::store) fn location(&self) -> &str {
        &self.location
    }

    /// Options of connections that only read, each of which [`set_up_reader`] has to set up.
    pub(in crate::store) fn readers(&self) -> PgConnectOptions {
        self.options.clone()
    }

    /// A connection; the error says what is wrong.
    pub(in crate::store) async fn connect(&self) -> Result<PgConnection, SessionError> {
        self.try_connect().await.map_err(|error| self.explain(error))
    }

    pub(in crate::store) async fn try_connect(&self) -> Result<PgConnection, sqlx::Error> {
        let connecting = async {
            let mut connection = self.options.connect().await?;
            raw_sql(SETTINGS).execute(&mut connection).await?;
            Ok(connection)
        };
        let connected = tokio::time::timeout(CONNECT_PATIENCE, connecting).await;
        connected.unwrap_or_else(|_| {
            let late = std::io::Error::from(ErrorKind::TimedOut);
            Err(sqlx::Error::Io(late))
        })
    }

    pub(in crate::store) fn failed(&self, source: sqlx::Error) -> SessionError {
        // Another session has a statement of that name, or this one has none: somebody hands sessions around.
        if matches!(sqlstate(&source).as_deref(), Some("42P05" | "26000")) {
            return SessionError::Pooler(self.location.clone());
        }
        SessionError::Failed { location: self.location.clone(), source }
    }

    fn explain(&self, error: sqlx::Error) -> SessionError {
        let location = self.location.clone();
        match sqlstate(&error).as_deref() {
            Some(code) if code.starts_with("28") => SessionError::Login(location, error),
            Some("3D000") => SessionError::NoDatabase(location),
            Some("53300") => SessionError::Full(location),
            Some(_) => self.failed(error),
            None => match &error {
                sqlx::Error::Tls(_) | sqlx::Error::Configuration(_) => {
                    SessionError::Tls(location, error)
                }
                // The file of a certificate; a certificate that is not accepted, by either side.
                sqlx::Error::Io(io)
                    if matches!(io.kind(), ErrorKind::NotFound | ErrorKind::InvalidData) =>
                {
                    SessionError::Tls(location, error)
                }
                _ => SessionError::Unreachable(location, error),
            },
        }
    }

    /// Checks that what is acknowledged by this server stays.
    pub(in crate::store) async fn check(
        &self,
        connection: &mut Connection,
    ) -> Result<(), SessionError> {
        let location = || self.location.clone();
        let settings = query(
            "SELECT CAST(current_setting('server_version_num') AS bigint), current_setting('server_encoding'),
                    pg_is_in_recovery() OR current_setting('transaction_read_only') = 'on'",
        );
        let (version, encoding, is_read_only): (i64, String, bool) =
            settings.one(connection).await.map_err(|error| self.failed(error))?;
        check_version(self.location(), version)?;
        if encoding != "UTF8" {
            return Err(SessionError::Encoding(location(), encoding));
        }
        if is_read_only {
            return Err(SessionError::Standby(location()));
        }
        for (setting, wanted) in [("fsync", "on"), ("full_page_writes", "on")] {
            let value: String = self.setting(connection, setting).await?;
            if value != wanted {
                return Err(SessionError::Unsafe { location: location(), setting, value, wanted });
            }
        }
        // Each session may choose it, and the one that writes does.
        let value = self.setting(connection, "synchronous_commit").await?;
        if value == "off" {
            tracing::warn!(
                "synchronous_commit is off in {}: this server sets it to on for what it writes",
                self.location
            );
        }
        Ok(())
    }

    async fn setting(
        &self,
        connection: &mut Connection,
        name: &'static str,
    ) -> Result<String, SessionError> {
        let value = query("SELECT current_setting($1)").bind(name).one(connection).await;
        value.map_err(|error| self.failed(error))
    }

    /// Refuses a pooler that shares sessions: what a session is set to, or has locked, would be another's. Two connections
    /// show it: while one has a transaction open, the other has lost what it was set to, or finds what the first one set.
    pub(in crate::store) async fn refuse_pooler(
        &self,
        one: &mut Connection,
    ) -> Result<(), SessionError> {
        let failed = |error| self.failed(error);
        let mut other = Connection::Postgres(self.connect().await?);
        query("SET swarmbench.session = 'one'").execute(one).await.map_err(failed)?;
        query("BEGIN").execute(&mut other).await.map_err(failed)?;
        let session = || query("SELECT coalesce(current_setting('swarmbench.session', true), '')");
        let of_other: String = session().one(&mut other).await.map_err(failed)?;
        let of_one: String = session().one(one).await.map_err(failed)?;
        query("ROLLBACK").execute(&mut other).await.map_err(failed)?;
        other.close().await.map_err(failed)?;
        if of_other == "one" || of_one != "one" {
            return Err(SessionError::Pooler(self.location.clone()));
        }
        Ok(())
    }

    /// Refuses a database with tables of another program.
    pub(in crate::store) async fn refuse_foreign(
        &self,
        connection: &mut Connection,
    ) -> Result<(), SessionError> {
        let tables = query(
            "SELECT count(*), count(*) FILTER (WHERE tablename IN ('_sqlx_migrations', 'episodes', 'copying'))
             FROM pg_tables WHERE schemaname = current_schema()",
        );
        let (all, own): (i64, i64) = tables.one(connection).await.map_err(|e| self.failed(e))?;
        if all > 0 && own == 0 {
            return Err(SessionError::Foreign(self.location.clone()));
        }
        Ok(())
    }

    /// Refuses a database without tables of this program.
    pub(in crate::store) async fn refuse_empty(
        &self,
        connection: &mut Connection,
    ) -> Result<(), SessionError> {
        self.refuse_foreign(connection).await?;
        let made =
            query("SELECT to_regclass('_sqlx_migrations') IS NOT NULL").one(connection).await;
        if made.map_err(|error| self.failed(error))? {
            return Ok(());
        }
        Err(SessionError::Empty(self.location.clone()))
    }

    /// Sets a session to what the writer needs.
    pub(in crate::store) async fn set_up_writer(
        &self,
        connection: &mut Connection,
    ) -> Result<(), sqlx::Error> {
        for setting in [
            // At least on: what the operator has set may wait for standbys, too.
            "SELECT set_config('synchronous_commit', CASE current_setting('synchronous_commit')
                 WHEN 'remote_apply' THEN 'remote_apply' ELSE 'on' END, false)",
            "SET default_transaction_read_only = off",
            // A writer that was stopped in the middle of a transaction must not hold its locks for ever.
            "SET idle_in_transaction_session_timeout = '60s'",
            "SET statement_timeout = 0",
            "SET lock_timeout = 0",
        ] {
            query(setting).execute(connection).await?;
        }
        Ok(())
    }
}

/// Sets a session to what readers need.
pub(in crate::store) async fn set_up_reader(
    connection: &mut PgConnection,
) -> Result<(), sqlx::Error> {
    raw_sql(SETTINGS).execute(&mut *connection).await?;
    raw_sql("SET default_transaction_read_only = on").execute(connection).await?;
    Ok(())
}

/// Refuses a version that this program was never tested with.
fn check_version(location: &str, version: i64) -> Result<(), SessionError> {
    if version >= VERSION_MIN {
        return Ok(());
    }
    // 9.6.24 is 90624, 14.10 is 140010.
    let version = match version {
        100_000.. => (version / 10_000).to_string(),
        _ => format!("{}.{}", version / 10_000, version / 100 % 100),
    };
    Err(SessionError::Version { location: location.to_owned(), version })
}

/// The code of an error of PostgreSQL, if it is one.
pub(in crate::store) fn sqlstate(error: &sqlx::Error) -> Option<String> {
    Some(error.as_database_error()?.code()?.into())
}

/// The number of the advisory lock that the writer of a database has. Others may use advisory locks, too.
const LOCK: i64 = 0x5377_6172_6d42_656e;

/// Takes the database for this session, if no other has it; or shares it with others that do.
pub(in crate::store) async fn try_lock(
    connection: &mut Connection,
    is_shared: bool,
) -> Result<bool, sqlx::Error> {
    let lock = if is_shared {
        "SELECT pg_try_advisory_lock_shared($1)"
    } else {
        "SELECT pg_try_advisory_lock($1)"
    };
    query(lock).bind(LOCK).one(connection).await
}

/// Holder of the database, as the newest row of `nodes` says: host and process.
pub(in crate::store) async fn newest_holder(
    connection: &mut Connection,
) -> Result<Option<String>, sqlx::Error> {
    query("SELECT name FROM nodes ORDER BY incarnation DESC LIMIT 1").optional(connection).await
}

/// The session that has the database: the name that it gave itself, and the process of PostgreSQL that serves it.
pub(in crate::store) async fn lock_holder(
    connection: &mut Connection,
) -> Result<Option<(String, i64)>, sqlx::Error> {
    let holder = query(
        "SELECT coalesce(a.application_name, ''), l.pid
         FROM pg_locks l LEFT JOIN pg_stat_activity a ON a.pid = l.pid
         WHERE l.locktype = 'advisory' AND l.granted AND l.database = (SELECT oid FROM pg_database WHERE datname = current_database())
             AND CAST(l.classid AS bigint) = $1 >> 32 AND CAST(l.objid AS bigint) = $1 & 4294967295",
    );
    holder.bind(LOCK).optional(connection).await
}

/// Gives the session a name, by which [`lock_holder`] knows it.
pub(in crate::store) async fn set_name(
    connection: &mut Connection,
    name: &str,
) -> Result<(), sqlx::Error> {
    let set = query("SELECT set_config('application_name', $1, false)").bind(name);
    set.execute(connection).await.map(drop)
}

/// The processes of PostgreSQL that serve other sessions of this name in the database.
pub(in crate::store) async fn others_called(
    connection: &mut Connection,
    name: &str,
) -> Result<Vec<i64>, sqlx::Error> {
    let others = query(
        "SELECT CAST(pid AS bigint) FROM pg_stat_activity
         WHERE application_name = $1 AND datname = current_database() AND pid <> pg_backend_pid()",
    );
    others.bind(name).all(connection).await
}

/// Ends another session.
pub(in crate::store) async fn terminate(
    connection: &mut Connection,
    pid: i64,
) -> Result<(), sqlx::Error> {
    let end = query("SELECT pg_terminate_backend(CAST($1 AS integer))").bind(pid);
    end.execute(connection).await.map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_older_postgres_is_refused_by_its_name() {
        let refused = |version| check_version("postgres://me@db/swarm", version).err();
        for (version, name) in [(90_624, "9.6"), (100_023, "10"), (140_010, "14"), (149_999, "14")]
        {
            let said = refused(version).expect("it is too old").to_string();
            let expected =
                format!("postgres://me@db/swarm is version {name}: 15 or newer is needed");
            assert!(said.ends_with(&expected), "{said}");
        }
        for version in [150_000, 150_014, 160_000, 170_005, 180_000] {
            assert!(refused(version).is_none(), "{version}");
        }
    }
}

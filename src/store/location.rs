//! Database locations: the values of `--db`.

use std::convert::Infallible;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use percent_encoding::percent_decode_str;
use sqlx::postgres::PgConnectOptions;
use swarmbench_clock::files::read_text;

/// A file of SQLite, or a database of PostgreSQL.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Location {
    File(PathBuf),
    Postgres(Address),
    /// Neither of the two. Only opening it fails: an error while parsing arguments would show the text, with any password.
    Unknown(LocationError),
}

/// The address of a PostgreSQL database. `Display` and `Debug` leave the password out.
#[derive(Clone, PartialEq, Eq)]
pub struct Address {
    url: String,
    password_file: Option<PathBuf>,
}

/// Accepted parameters of an address, besides [`PASSWORD_FILE`]. Others are refused, as sqlx would ignore them silently.
const PARAMETERS: [&str; 9] =
    ["sslmode", "sslrootcert", "sslcert", "sslkey", "host", "port", "dbname", "user", "password"];

/// The parameter with the path of a password file, the way in which containers get secrets.
const PASSWORD_FILE: &str = "password_file";

const SCHEMES: [&str; 2] = ["postgres://", "postgresql://"];

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LocationError {
    #[error("the name of the database file is empty")]
    Empty,
    #[error(
        "{0}:// is no engine of this program: name a file for SQLite, or postgres://USER@HOST:PORT/DATABASE"
    )]
    Scheme(String),
    #[error(
        "an address of PostgreSQL has no parameter {0:?}: there are {parameters} and {PASSWORD_FILE}",
        parameters = PARAMETERS.join(", ")
    )]
    Parameter(String),
    #[error("it is no address of PostgreSQL, as in postgres://USER@HOST:PORT/DATABASE: {0}")]
    Address(String),
}

impl Location {
    /// The path of a SQLite database.
    pub fn file(&self) -> Option<&Path> {
        match self {
            Self::File(path) => Some(path),
            Self::Postgres(_) | Self::Unknown(_) => None,
        }
    }
}

impl From<&Path> for Location {
    fn from(path: &Path) -> Self {
        Self::File(path.to_owned())
    }
}

impl From<&PathBuf> for Location {
    fn from(path: &PathBuf) -> Self {
        Self::File(path.clone())
    }
}

impl From<&Self> for Location {
    fn from(location: &Self) -> Self {
        location.clone()
    }
}

impl From<PathBuf> for Location {
    fn from(path: PathBuf) -> Self {
        Self::File(path)
    }
}

impl From<&str> for Location {
    fn from(text: &str) -> Self {
        if SCHEMES.iter().any(|scheme| text.starts_with(scheme)) {
            return Address::parse(text).map_or_else(Self::Unknown, Self::Postgres);
        }
        if let Some((scheme, _)) = text.split_once("://") {
            return Self::Unknown(LocationError::Scheme(scheme.to_owned()));
        }
        if text.is_empty() {
            return Self::Unknown(LocationError::Empty);
        }
        Self::File(text.into())
    }
}

impl FromStr for Location {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(Self::from(text))
    }
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(path) => path.display().fmt(f),
            Self::Postgres(address) => address.fmt(f),
            Self::Unknown(_) => f.write_str("a database that is not known"),
        }
    }
}

impl Address {
    fn parse(text: &str) -> Result<Self, LocationError> {
        let (base, parameters) = text.split_once('?').unwrap_or((text, ""));
        let mut passed = Vec::new();
        let mut password_file = None;
        for parameter in parameters.split('&').filter(|parameter| !parameter.is_empty()) {
            let (name, value) = parameter.split_once('=').unwrap_or((parameter, ""));
            if name == PASSWORD_FILE {
                password_file =
                    Some(PathBuf::from(&*percent_decode_str(value).decode_utf8_lossy()));
            } else if PARAMETERS.contains(&name) {
                passed.push(parameter);
            } else {
                return Err(LocationError::Parameter(name.to_owned()));
            }
        }
        let url = if passed.is_empty() {
            base.to_owned()
        } else {
            format!("{base}?{}", passed.join("&"))
        };
        // An address that cannot be parsed may have a password in any part of it, so errors never show it.
        PgConnectOptions::from_str(&url)
            .map_err(|error| LocationError::Address(error.to_string()))?;
        Ok(Self { url, password_file })
    }

    /// Connection options. `PGPASSWORD` or `~/.pgpass` gives the password where the address has none.
    ///
    /// # Errors
    /// If the file with the password cannot be read.
    pub(super) fn options(&self) -> Result<PgConnectOptions, (PathBuf, io::Error)> {
        let options = PgConnectOptions::from_str(&self.url).expect("it was parsed before");
        match &self.password_file {
            None => Ok(options),
            Some(path) => match read_text(path) {
                Ok(text) => Ok(options.password(text.trim_end_matches(['\r', '\n']))),
                Err(error) => Err((path.clone(), error)),
            },
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let options = PgConnectOptions::from_str(&self.url).map_err(|_| fmt::Error)?;
        let user = options.get_username();
        let database = options.get_database().unwrap_or(user);
        if let Some(socket) = options.get_socket() {
            return write!(f, "postgres://{user}@{}/{database}", socket.display());
        }
        let (host, port) = (options.get_host(), options.get_port());
        write!(f, "postgres://{user}@{host}:{port}/{database}")
    }
}

/// Leaves the password out, as [`Display`](fmt::Display) does.
impl fmt::Debug for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_location_is_a_file_or_an_address() {
        assert_eq!(Location::from("a/b.db"), Location::File("a/b.db".into()));
        let refused = |text| {
            let Location::Unknown(error) = Location::from(text) else {
                panic!("{text} is refused")
            };
            error.to_string()
        };
        assert!(refused("mysql://a/b").contains("postgres://USER@HOST:PORT/DATABASE"));
        assert!(refused("").contains("empty"));
        assert!(refused("postgres://a/b?pool=3").contains("no parameter \"pool\""));
        assert!(refused("postgres://a:notaport/b").contains("no address of PostgreSQL"));
    }

    #[test]
    fn a_password_is_never_shown() {
        let secret = "h%40rd2guess";
        for url in [
            format!("postgres://me:{secret}@db.example:5433/swarm?sslmode=require"),
            format!("postgresql://me@db.example:5433/swarm?password={secret}"),
        ] {
            let location = Location::from(url.as_str());
            let shown = format!("{location} {location:?}");
            assert!(!shown.contains("2guess"), "{shown}");
            assert_eq!(location.to_string(), "postgres://me@db.example:5433/swarm");
        }
    }

    #[test]
    fn a_password_may_be_in_a_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("secret");
        std::fs::write(&file, "from a file\n").expect("written");
        let parse = |file: &Path| {
            let url = format!("postgres://me@db.example/swarm?password_file={}", file.display());
            let Location::Postgres(address) = Location::from(url.as_str()) else {
                panic!("an address")
            };
            address
        };
        assert!(parse(&file).options().is_ok());
        let (missing, _) = parse(&folder.path().join("other")).options().expect_err("no such file");
        assert!(missing.ends_with("other"));
    }
}

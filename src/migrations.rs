//! Migrations, which are part of the program. sqlx's macro that reads the folder is not used, as it would compile SQLite a second
//! time.

use sqlx::SqlSafeStr as _;
use sqlx::migrate::{Migration, MigrationType, Migrator};

/// Version, description and text of each file in `migrations/sqlite`.
const SQLITE: [(i64, &str, &str); 19] = [
    (1, "journal", include_str!("../migrations/sqlite/0001_journal.sql")),
    (2, "keys", include_str!("../migrations/sqlite/0002_keys.sql")),
    (3, "runs", include_str!("../migrations/sqlite/0003_runs.sql")),
    (4, "imports", include_str!("../migrations/sqlite/0004_imports.sql")),
    (5, "boards", include_str!("../migrations/sqlite/0005_boards.sql")),
    (6, "shares", include_str!("../migrations/sqlite/0006_shares.sql")),
    (7, "metrics", include_str!("../migrations/sqlite/0007_metrics.sql")),
    (8, "failures", include_str!("../migrations/sqlite/0008_failures.sql")),
    (9, "forks", include_str!("../migrations/sqlite/0009_forks.sql")),
    (10, "templates", include_str!("../migrations/sqlite/0010_templates.sql")),
    (11, "competitions", include_str!("../migrations/sqlite/0011_competitions.sql")),
    (12, "teams", include_str!("../migrations/sqlite/0012_teams.sql")),
    (13, "attempts", include_str!("../migrations/sqlite/0013_attempts.sql")),
    (14, "columns", include_str!("../migrations/sqlite/0014_columns.sql")),
    (15, "fleet", include_str!("../migrations/sqlite/0015_fleet.sql")),
    (16, "lists", include_str!("../migrations/sqlite/0016_lists.sql")),
    (17, "names", include_str!("../migrations/sqlite/0017_names.sql")),
    (18, "looks", include_str!("../migrations/sqlite/0018_looks.sql")),
    (19, "networks", include_str!("../migrations/sqlite/0019_networks.sql")),
];

/// The same of `migrations/postgres`. A version makes the same tables and columns in both.
const POSTGRES: [(i64, &str, &str); 6] = [
    (14, "tables", include_str!("../migrations/postgres/0014_tables.sql")),
    (15, "fleet", include_str!("../migrations/postgres/0015_fleet.sql")),
    (16, "lists", include_str!("../migrations/postgres/0016_lists.sql")),
    (17, "names", include_str!("../migrations/postgres/0017_names.sql")),
    (18, "looks", include_str!("../migrations/postgres/0018_looks.sql")),
    (19, "networks", include_str!("../migrations/postgres/0019_networks.sql")),
];

/// Migrations of SQLite, oldest first.
pub fn sqlite() -> Migrator {
    migrator(&SQLITE)
}

/// Migrations of PostgreSQL, oldest first.
pub fn postgres() -> Migrator {
    migrator(&POSTGRES)
}

/// Version of the newest migration.
pub(crate) fn newest(migrator: &Migrator) -> Option<i64> {
    migrator.iter().map(|migration| migration.version).max()
}

fn migrator(files: &[(i64, &'static str, &'static str)]) -> Migrator {
    let migration = |&(version, description, sql): &(i64, &'static str, &'static str)| {
        let kind = MigrationType::Simple;
        Migration::new(version, description.into(), kind, sql.into_sql_str(), false)
    };
    Migrator::with_migrations(files.iter().map(migration).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_files_of_the_folders_are_migrations() {
        for (folder, listed) in [("sqlite", &SQLITE[..]), ("postgres", &POSTGRES[..])] {
            let folder = format!("{}/migrations/{folder}", env!("CARGO_MANIFEST_DIR"));
            let files = std::fs::read_dir(folder).expect("the folder");
            let names = files.map(|file| file.expect("a file").file_name().into_string());
            let mut names: Vec<_> = names.map(|name| name.expect("a name in ASCII")).collect();
            names.sort_unstable();
            let listed: Vec<_> = listed
                .iter()
                .map(|(version, name, _)| format!("{version:04}_{name}.sql"))
                .collect();
            assert_eq!(names, listed);
        }
    }

    #[test]
    fn both_engines_have_the_same_newest_version() {
        assert_eq!(newest(&sqlite()), newest(&postgres()));
    }
}

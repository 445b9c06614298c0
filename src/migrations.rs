//! The migrations, which are part of the program. Without the macro of sqlx that reads the folder: it would compile SQLite a
//! second time.

use sqlx::SqlSafeStr as _;
use sqlx::migrate::{Migration, MigrationType, Migrator};

/// Version, description and text of each file in `migrations`.
const FILES: [(i64, &str, &str); 14] = [
    (1, "journal", include_str!("../migrations/0001_journal.sql")),
    (2, "keys", include_str!("../migrations/0002_keys.sql")),
    (3, "runs", include_str!("../migrations/0003_runs.sql")),
    (4, "imports", include_str!("../migrations/0004_imports.sql")),
    (5, "boards", include_str!("../migrations/0005_boards.sql")),
    (6, "shares", include_str!("../migrations/0006_shares.sql")),
    (7, "metrics", include_str!("../migrations/0007_metrics.sql")),
    (8, "failures", include_str!("../migrations/0008_failures.sql")),
    (9, "forks", include_str!("../migrations/0009_forks.sql")),
    (10, "templates", include_str!("../migrations/0010_templates.sql")),
    (11, "competitions", include_str!("../migrations/0011_competitions.sql")),
    (12, "teams", include_str!("../migrations/0012_teams.sql")),
    (13, "attempts", include_str!("../migrations/0013_attempts.sql")),
    (14, "columns", include_str!("../migrations/0014_columns.sql")),
];

/// All migrations, oldest first.
pub(crate) fn migrator() -> Migrator {
    let migration = |(version, description, sql): (i64, &'static str, &'static str)| {
        let kind = MigrationType::Simple;
        Migration::new(version, description.into(), kind, sql.into_sql_str(), false)
    };
    Migrator::with_migrations(FILES.map(migration).into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_files_of_the_folder_are_migrations() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/migrations");
        let files = std::fs::read_dir(folder).expect("the folder");
        let names = files.map(|file| file.expect("a file").file_name().into_string());
        let mut names: Vec<_> = names.map(|name| name.expect("a name in ASCII")).collect();
        names.sort_unstable();
        let listed = FILES.map(|(version, name, _)| format!("{version:04}_{name}.sql"));
        assert_eq!(names, listed);
    }
}

//! Migrations, which are part of the program. sqlx's macro that reads the folder is not used, as it would compile SQLite a second
//! time.

use sqlx::SqlSafeStr as _;
use sqlx::migrate::{Migration, MigrationType, Migrator};

/// Version, description and text of each file in `migrations/sqlite`.
const SQLITE: [(i64, &str, &str); 22] = [
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
    (20, "labels", include_str!("../migrations/sqlite/0020_labels.sql")),
    (21, "listing", include_str!("../migrations/sqlite/0021_listing.sql")),
    (22, "usage", include_str!("../migrations/sqlite/0022_usage.sql")),
];

/// The same of `migrations/postgres`. A version makes the same tables and columns in both.
const POSTGRES: [(i64, &str, &str); 9] = [
    (14, "tables", include_str!("../migrations/postgres/0014_tables.sql")),
    (15, "fleet", include_str!("../migrations/postgres/0015_fleet.sql")),
    (16, "lists", include_str!("../migrations/postgres/0016_lists.sql")),
    (17, "names", include_str!("../migrations/postgres/0017_names.sql")),
    (18, "looks", include_str!("../migrations/postgres/0018_looks.sql")),
    (19, "networks", include_str!("../migrations/postgres/0019_networks.sql")),
    (20, "labels", include_str!("../migrations/postgres/0020_labels.sql")),
    (21, "listing", include_str!("../migrations/postgres/0021_listing.sql")),
    (22, "usage", include_str!("../migrations/postgres/0022_usage.sql")),
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

    #[tokio::test]
    async fn labels_of_erased_entrants_are_erased_by_a_migration() {
        use sqlx::sqlite::SqliteConnectOptions;
        use sqlx::{ConnectOptions as _, Executor as _, Row as _};

        let opened = SqliteConnectOptions::new().in_memory(true).connect().await;
        let mut database = opened.expect("a database");
        let before =
            SQLITE.iter().filter(|(version, ..)| *version < 20).copied().collect::<Vec<_>>();
        migrator(&before).run(&mut database).await.expect("the tables of an earlier version");
        let rows = "
            INSERT INTO entries (key, id, competition, owner, name, model, declaration, status, registered_at, erased_at)
            VALUES (1, 'ent_1', 7, 1, 'erased ent_1', 'm', '{}', 'withdrawn', 0, 1), (2, 'ent_2', 7, 2, 'grace', 'm', '{}', 'active', 0, NULL);
            INSERT INTO invitations (hash, competition, label, entry, created_at)
            VALUES (x'01', 7, 'Ada', 1, 0), (x'02', 7, 'Grace', 2, 0), (x'03', 7, 'free', NULL, 0);
            INSERT INTO audit (at, who, action, subject, detail, competition)
            VALUES (0, 'key_1', 'competition.codes', 'c', '{\"labels\":[\"Ada\"]}', 7), (0, 'key_1', 'competition.codes', 'd', 'other', 8)";
        database.execute(rows).await.expect("rows");
        sqlite().run(&mut database).await.expect("the newest tables");
        let texts = "SELECT label FROM invitations UNION ALL SELECT detail FROM audit";
        let texts = sqlx::query(texts).fetch_all(&mut database).await.expect("rows");
        let texts: Vec<String> = texts.iter().map(|row| row.get(0)).collect();
        assert_eq!(texts, ["erased ent_1", "Grace", "free", "{}", "other"]);
    }

    #[tokio::test]
    async fn games_of_earlier_versions_have_what_lists_show() {
        use sqlx::sqlite::SqliteConnectOptions;
        use sqlx::{ConnectOptions as _, Executor as _, Row as _};

        let opened = SqliteConnectOptions::new().in_memory(true).connect().await;
        let mut database = opened.expect("a database");
        let before =
            SQLITE.iter().filter(|(version, ..)| *version < 21).copied().collect::<Vec<_>>();
        migrator(&before).run(&mut database).await.expect("the tables of an earlier version");
        let rows = r#"
            INSERT INTO episodes (key, id, opening, task, model, visibility, status, clocked, head, ending, created_at, ended_at)
            VALUES (1, 'ep_1', '{"config":{"seed":7},"agent_meta":{"kind":"human"}}', 't', 'm', 'public', 'finished', 0, x'',
                    '{"rounds":2,"score":1.5}', 0, 1),
                   (2, 'ep_2', '{"config":{"seed":8},"agent_meta":{}}', 't', 'm', 'public', 'aborted', 0, x'',
                    '{"rounds":0,"score":9.0}', 0, 1),
                   (3, 'ep_3', 'damaged', 't', 'm', 'public', 'running', 0, x'', NULL, 0, NULL),
                   (4, 'ep_4', '{"config":{"seed":{}}}', 't', 'm', 'public', 'finished', 0, x'',
                    '{"rounds":"some","score":"none"}', 0, 1);
            INSERT INTO rounds (episode, round, digest, score, head, at) VALUES (1, 0, x'', 1, x'', 0), (1, 1, x'', 1.5, x'', 0);
            INSERT INTO claims (episode, holder, model, agent_meta, claimed_at) VALUES (2, 1, 'm', '{"kind":"human"}', 0)"#;
        database.execute(rows).await.expect("rows");
        sqlite().run(&mut database).await.expect("the newest tables");
        let read = "SELECT concat_ws(' ', key, score, rounds, seed, curve, people) FROM episodes ORDER BY key";
        let read = sqlx::query(read).fetch_all(&mut database).await.expect("rows");
        let read: Vec<String> = read.iter().map(|row| row.get(0)).collect();
        assert_eq!(
            read,
            ["1 1.5 2.0 7.0 [0,1.0,1.5] 1", "2 0.0 0.0 8.0 [0] 1", "3 0", "4 0.0 0.0 0.0 [0] 0"]
        );
    }

    #[test]
    fn both_engines_have_the_same_newest_version() {
        assert_eq!(newest(&sqlite()), newest(&postgres()));
    }
}

//! The table `audit`: what organizers did.

use sqlx::sqlite::SqliteConnection;

use crate::journal::AuditRow;

pub(super) async fn add(
    connection: &mut SqliteConnection,
    row: &AuditRow,
) -> Result<(), sqlx::Error> {
    sqlx::query("INSERT INTO audit (at, who, action, subject, detail) VALUES (?, ?, ?, ?, ?)")
        .bind(row.at.as_millisecond())
        .bind(&row.who)
        .bind(row.action)
        .bind(&row.subject)
        .bind(row.detail.to_string())
        .execute(connection)
        .await?;
    Ok(())
}

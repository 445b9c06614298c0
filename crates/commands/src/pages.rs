//! Lists of a server, read page by page.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use swarmbench_client::client::Client;

#[derive(Deserialize, Serialize)]
pub struct Page<T> {
    pub items: Vec<T>,
    pub next_cursor: Option<String>,
}

impl<T> Page<T> {
    pub const fn of(items: Vec<T>) -> Self {
        Self { items, next_cursor: None }
    }
}

/// Reads all items of a list.
pub async fn all<T: DeserializeOwned>(client: &Client, path: &str) -> anyhow::Result<Vec<T>> {
    let mut items = Vec::new();
    let add = |page: Page<T>| {
        items.extend(page.items);
        page.next_cursor
    };
    pages(client, path, &[], add).await?;
    Ok(items)
}

/// Reads a list page by page; `add` returns the cursor of the next page to read.
pub async fn pages<T: DeserializeOwned>(
    client: &Client,
    path: &str,
    query: &[(&str, &str)],
    mut add: impl FnMut(T) -> Option<String>,
) -> anyhow::Result<()> {
    let mut cursor: Option<String> = None;
    loop {
        let mut query = query.to_vec();
        query.extend(cursor.as_deref().map(|cursor| ("cursor", cursor)));
        cursor = add(client.get_with(path, &query).await?);
        if cursor.is_none() {
            return Ok(());
        }
    }
}

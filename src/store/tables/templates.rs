//! The table `templates`: prompt templates, shared by many openings.

use crate::store::sql::{Connection, query};
use futures::TryStreamExt;
use sha2::{Digest, Sha256};

/// Shorter templates are stored in their openings.
const TEMPLATE_BYTES_MIN: usize = 256;

/// The column `opening` of a query over episodes `e`: the exact record.
macro_rules! opening {
    () => {
        "coalesce((SELECT substr(e.opening, 1, CAST(e.template_at AS INTEGER)) || t.text
                          || substr(e.opening, CAST(e.template_at + 1 AS INTEGER))
                   FROM templates t WHERE t.key = e.template), e.opening) AS opening"
    };
}
pub(in crate::store) use opening;

/// [`opening!`] without templates that lists do not show (the built-in one). An opening with the same name in another place,
/// as in the player's own metadata, keeps its template.
macro_rules! listed_opening {
    () => {
        concat!(
            "CASE WHEN e.template IS NOT NULL AND e.opening NOT LIKE '%\"custom_template\":true%'
                       AND substr(e.opening, CAST(e.template_at + 1 AS INTEGER)) NOT LIKE '%\"prompt_template\":\"%'
                  THEN e.opening
                  ELSE (SELECT ", crate::store::templates::opening!(), ") END AS opening"
        )
    };
}
pub(in crate::store) use listed_opening;

/// An opening and its template, separated.
#[derive(Debug, PartialEq, Eq)]
pub(in crate::store) struct Cut<'a> {
    /// Opening with an empty template.
    pub(in crate::store) opening: String,
    /// JSON text of the template, without the quotes.
    template: &'a str,
    /// Position of the template in the opening, in characters.
    at: i64,
}

impl<'a> Cut<'a> {
    /// Separates a large template from its opening. Wherever the cut is, both parts together give the same opening.
    pub(in crate::store) fn of(opening: &'a str) -> Option<Self> {
        const NAME: &str = "\"prompt_template\":\"";
        let begin = opening.find(NAME)? + NAME.len();
        let template = &opening[begin..begin + end_of_string(&opening[begin..])?];
        (template.len() >= TEMPLATE_BYTES_MIN).then(|| {
            let before = &opening[..begin];
            let after = &opening[begin + template.len()..];
            let at = i64::try_from(before.chars().count()).expect("openings are short");
            Self { opening: [before, after].concat(), template, at }
        })
    }

    /// Stores the template unless it exists; returns its key and position.
    pub(in crate::store) async fn keep(
        &self,
        connection: &mut Connection,
    ) -> Result<(i64, i64), sqlx::Error> {
        let hash: [u8; 32] = Sha256::digest(self.template).into();
        let find = "SELECT key FROM templates WHERE hash = $1";
        let found: Option<i64> = query(find).bind(&hash[..]).optional(connection).await?;
        if let Some(key) = found {
            return Ok((key, self.at));
        }
        let added = query("INSERT INTO templates (hash, text) VALUES ($1, $2) RETURNING key")
            .bind(&hash[..])
            .bind(self.template)
            .one(connection)
            .await?;
        Ok((added, self.at))
    }
}

/// Keys of templates whose text does not match their hash.
pub(in crate::store) async fn damaged(
    connection: &mut Connection,
) -> Result<Vec<i64>, sqlx::Error> {
    let mut rows = query("SELECT key, hash, text FROM templates").fetch(connection);
    let mut damaged = Vec::new();
    while let Some(row) = rows.try_next().await? {
        let hash: [u8; 32] = Sha256::digest(row.text("text")?).into();
        if row.try_get::<Vec<u8>>("hash")? != hash {
            damaged.push(row.try_get("key")?);
        }
    }
    Ok(damaged)
}

/// Position of the quote that ends a JSON string begun before `text`.
fn end_of_string(text: &str) -> Option<usize> {
    let mut is_escaped = false;
    text.bytes().position(|byte| {
        let ends = byte == b'"' && !is_escaped;
        is_escaped = byte == b'\\' && !is_escaped;
        ends
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Joins both parts again.
    fn joined(cut: &Cut<'_>) -> String {
        let at = usize::try_from(cut.at).expect("it is positive");
        let before: String = cut.opening.chars().take(at).collect();
        let after: String = cut.opening.chars().skip(at).collect();
        [&before, cut.template, &after].concat()
    }

    #[test]
    fn an_opening_is_cut_around_its_template() {
        let template = "ü\\\"\\\\ {{ agent }} ".repeat(40);
        let opening = format!(r#"{{"model":"größer","prompt_template":"{template}","run":"é"}}"#);
        let cut = Cut::of(&opening).expect("it is large");
        assert_eq!(cut.template, template);
        assert_eq!(cut.opening, r#"{"model":"größer","prompt_template":"","run":"é"}"#);
        assert_eq!(joined(&cut), opening);
    }

    #[test]
    fn openings_without_a_large_template_stay_whole() {
        for opening in [
            r#"{"kind":"opening"}"#.to_owned(),
            r#"{"prompt_template":"short"}"#.to_owned(),
            format!(r#"{{"prompt_template":"{}"#, "never ends".repeat(100)),
            format!(r#"{{"model":"\"prompt_template\":\"{}"}}"#, "a".repeat(1000)),
        ] {
            assert_eq!(Cut::of(&opening), None, "{opening}");
        }
    }

    #[test]
    fn another_text_of_the_same_name_makes_the_same_opening_again() {
        let text = "free text ".repeat(40);
        let opening = format!(
            r#"{{"agent_meta":{{"prompt_template":"{text}"}},"prompt_template":"{text}\u0000"}}"#
        );
        assert_eq!(joined(&Cut::of(&opening).expect("it is large")), opening);
    }
}

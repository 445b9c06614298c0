//! The tables `competitions`, `entries` and `invitations`, and those of similar names and models.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use futures::TryStreamExt;
use hmac::{Hmac, KeyInit as _, Mac as _};
use jiff::Timestamp;
use serde_json::json;
use serde_json::value::{RawValue, to_raw_value};
use sha2::Sha256;

use crate::ids::{CompetitionKey, EntryKey, EpisodeKey, RunKey, TokenHash};
use crate::keys::OwnerKey;
use crate::store::Store;
use crate::store::StoreError;
use crate::store::entries::{CompetitionRow, EntrantFacts, EntrantRow, Secret};
use crate::store::runs::void_reason;
use crate::store::sql::{Begin, Builder, Connection, FromRow, SqlRow, from_row, get, query};
use swarmbench_boards::competition::definition::practice_suite;
use swarmbench_boards::run::{HUMAN, is_human};
use swarmbench_protocol::names::looks;

#[derive(Clone, Debug)]
pub struct RawCompetition {
    pub key: CompetitionKey,
    pub id: String,
    /// Definition as JSON.
    pub definition: String,
    pub salt: Secret,
    /// Sealed seeds, concatenated.
    pub seeds: Secret,
    /// Published commitment to salt and seeds.
    pub commitment: [u8; 32],
    pub created_at: Timestamp,
    /// Time at which everything became public.
    pub revealed_at: Option<Timestamp>,
    pub cancelled_at: Option<Timestamp>,
    /// Reason of the cancellation.
    pub cancel_reason: Option<String>,
    /// Whether only organizers see the competition in lists.
    pub hidden: bool,
}

#[derive(Clone, Debug)]
pub struct RawEntrant {
    pub key: EntryKey,
    pub id: String,
    pub competition: CompetitionKey,
    pub owner: OwnerKey,
    pub name: String,
    /// Declaration of the player, as JSON.
    pub declaration: String,
    /// Digest of the prompt template; `None` for the built-in one.
    pub template: Option<String>,
    pub status: String,
    /// Reason of a status other than `active`.
    pub reason: Option<String>,
    /// Whether an organizer vouches for the model.
    pub vouched: bool,
    pub registered_at: Timestamp,
    /// Address or network of the registration; `None` for entrants of earlier versions.
    pub address: Option<String>,
    /// Time of the erasure of the name.
    pub erased_at: Option<Timestamp>,
    /// Name in the published file, if the entrant was erased after the end.
    pub published: Option<String>,
    pub category: Option<String>,
    /// Version of the terms that was accepted last.
    pub terms: Option<u32>,
    /// Contact for organizers.
    pub contact: Option<String>,
    /// Number of renames by the entrant itself.
    pub renames: u32,
}

/// Contact of an entrant.
#[derive(Clone, Debug)]
pub struct StoredContact {
    pub key: EntryKey,
    /// Public id of the entrant.
    pub id: String,
    pub name: String,
    pub category: Option<String>,
    pub status: String,
    pub contact: Option<String>,
}

#[derive(Clone, Debug)]
pub struct StoredAttempt {
    pub run: RunKey,
    /// Public id of the run.
    pub id: String,
    pub entry: EntryKey,
    pub number: u32,
    /// Voided attempt that this spare attempt replaces.
    pub replays: Option<u32>,
    /// Name of the run's status.
    pub status: String,
    pub created_at: Timestamp,
    pub ended_at: Option<Timestamp>,
    pub void_reason: Option<String>,
    /// Number of unfinished episodes, without voided ones.
    pub unfinished: u32,
}

/// Facts that decide whether a competition accepts another entrant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EntrantRoom {
    /// Number of active entrants.
    pub active: u32,
    /// Whether an entrant has a model that looks the same and is spelled differently.
    pub has_look_of_model: bool,
    pub of_owner: u32,
}

const COMPETITION: &str = "SELECT key, id, definition, salt, seeds, commitment, created_at, \
                           revealed_at, cancelled_at, cancel_reason, hidden FROM competitions ";

/// Part of the declarations that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Declared {
    Whole,
    /// Without the prompt template and the free metadata, which may be large.
    Short,
}

fn select_entrants(declared: Declared) -> Builder<'static> {
    let mut query = Builder::new("SELECT key, id, competition, owner, name, template, ");
    query.push(match declared {
        Declared::Whole => "declaration, FALSE AS is_to_be_cut",
        Declared::Short => {
            "coalesce(brief, declaration) AS declaration, brief IS NULL AS is_to_be_cut"
        }
    });
    query.push(", status, reason, vouched, registered_at, address, erased_at, published, category, terms, contact, renames FROM entries ");
    query
}

/// Invitation code, without the code itself.
#[derive(Clone, Debug)]
pub struct StoredInvitation {
    pub hash: TokenHash,
    pub label: String,
    /// Public id of the entrant that used the code.
    pub entrant: Option<String>,
    pub created_at: Timestamp,
    pub revoked_at: Option<Timestamp>,
}

/// Bytes of a digest of a name: enough against collisions.
const DIGEST_BYTES: usize = 16;

const INVITATION: &str = "
    SELECT i.hash, i.label, i.created_at, i.revoked_at,
           (SELECT n.id FROM entries n WHERE n.key = i.entry) AS entrant
    FROM invitations i ";

const ATTEMPT: &str = "
    SELECT r.key, r.id, r.entry, r.attempt, r.replays, r.status, r.created_at, r.ended_at, r.voided_at,
           r.void_reason,
           (SELECT count(*) FROM episodes e
            WHERE e.run = r.key AND e.ended_at IS NULL AND e.voided_at IS NULL) AS unfinished
    FROM runs r ";

impl Store {
    pub async fn find_competition(&self, id: &str) -> Result<Option<RawCompetition>, StoreError> {
        let mut query = Builder::new(COMPETITION);
        query.push("WHERE id = ").push_bind(id);
        self.fetch_optional(query.build()).await
    }

    /// Lists competitions, newest first, starting after `before`; hidden ones only with `all`.
    pub async fn list_competitions(
        &self,
        all: bool,
        before: Option<CompetitionKey>,
        limit: u32,
    ) -> Result<Vec<RawCompetition>, StoreError> {
        let mut query = Builder::new(COMPETITION);
        query.push("WHERE key < ").push_bind(before.map_or(i64::MAX, |key| key.0));
        query.push(" AND (NOT hidden OR ").push_bind(all).push(")");
        query.push(" ORDER BY key DESC LIMIT ").push_bind(limit);
        self.fetch_all(query.build()).await
    }

    /// Public ids of closed competitions that are not public yet.
    pub async fn closing_competitions(&self, now: Timestamp) -> Result<Vec<String>, StoreError> {
        let query = query(
            "SELECT id FROM competitions WHERE revealed_at IS NULL AND closes_at <= $1 ORDER BY key",
        );
        self.fetch_all(query.bind(now.as_millisecond())).await
    }

    pub async fn find_entrant(
        &self,
        competition: CompetitionKey,
        id: &str,
    ) -> Result<Option<RawEntrant>, StoreError> {
        let mut query = select_entrants(Declared::Whole);
        query.push("WHERE competition = ").push_bind(competition.0);
        query.push(" AND id = ").push_bind(id);
        self.fetch_optional(query.build()).await
    }

    /// Entrants of a competition in the order of registration: all, or those of one key.
    pub async fn entrants(
        &self,
        competition: CompetitionKey,
        owner: Option<OwnerKey>,
        declared: Declared,
    ) -> Result<Vec<RawEntrant>, StoreError> {
        let mut query = select_entrants(declared);
        // The `+` makes SQLite look up entrants by their owner, who has few.
        query.push(if owner.is_some() { "WHERE +competition = " } else { "WHERE competition = " });
        query.push_bind(competition.0);
        if let Some(owner) = owner {
            query.push(" AND owner = ").push_bind(owner.0);
        }
        query.push(" ORDER BY key");
        self.fetch_all(query.build()).await
    }

    /// Facts that decide whether a competition accepts this entrant.
    pub async fn room_for(
        &self,
        competition: CompetitionKey,
        model: &str,
        owner: Option<OwnerKey>,
    ) -> Result<EntrantRoom, StoreError> {
        let [look, other_look] = looks(model);
        let query = query(
            "SELECT coalesce((SELECT entrants FROM competitions WHERE key = $1), 0) AS active,
                    EXISTS (SELECT 1 FROM looks WHERE competition = $1 AND kind = 'model' AND look IN ($3, $4)
                            AND written != $5) AS has_look_of_model,
                    (SELECT count(*) FROM entries INDEXED BY entries_by_owner
                     WHERE owner = $2 AND competition = $1) AS of_owner",
        )
        .bind(competition.0)
        .bind(owner.map(|owner| owner.0))
        .bind(look)
        .bind(other_look)
        .bind(model);
        self.fetch_one(query).await
    }

    /// Whether an entrant, active or not, came from a network whose text is within `texts` or is `other`. The index bounds the
    /// entries that are read by one for each condition, however many there are.
    pub async fn is_entered_from(
        &self,
        competition: CompetitionKey,
        texts: &Range<String>,
        other: &str,
    ) -> Result<bool, StoreError> {
        let query = query(
            "SELECT EXISTS (SELECT 1 FROM entries INDEXED BY entries_by_address
                            WHERE competition = $1 AND address >= $2 AND address < $3)
                 OR EXISTS (SELECT 1 FROM entries INDEXED BY entries_by_address
                            WHERE competition = $1 AND address = $4)",
        );
        let query = query.bind(competition.0).bind(texts.start.as_str()).bind(texts.end.as_str());
        self.fetch_one(query.bind(other)).await
    }

    /// Whether an entrant is neither excluded nor withdrawn.
    pub async fn is_active(&self, entry: EntryKey) -> Result<bool, StoreError> {
        let text = "SELECT status = 'active' FROM entries WHERE key = $1";
        self.fetch_one(query(text).bind(entry.0)).await
    }

    /// Whether the entrant of a run, an attempt or practice, was disqualified or erased.
    pub async fn is_excluded(&self, run: RunKey) -> Result<bool, StoreError> {
        let query = query(
            "SELECT EXISTS (
                 SELECT 1 FROM runs r
                 JOIN entries n ON n.owner = r.owner
                 JOIN competitions c ON c.key = n.competition
                 WHERE r.key = $1 AND (n.key = r.entry OR r.suite = $2 || c.id)
                     AND (n.status = 'disqualified' OR n.erased_at IS NOT NULL))",
        );
        self.fetch_one(query.bind(run.0).bind(practice_suite(""))).await
    }

    /// Runs of an entrant in order: its attempts, and its key's practice.
    pub async fn playing(
        &self,
        entry: EntryKey,
        owner: OwnerKey,
        practice: &str,
    ) -> Result<Vec<RunKey>, StoreError> {
        let query = query(
            "SELECT key FROM runs WHERE owner = $1 AND status = 'running' AND (entry = $2 OR suite || '' = $3)
             ORDER BY key",
        );
        self.fetch_all(query.bind(owner.0).bind(entry.0).bind(practice)).await
    }

    /// Whether an entrant other than `except` has or had a name that looks the same.
    pub async fn is_name_taken(
        &self,
        competition: CompetitionKey,
        except: Option<EntryKey>,
        name: &str,
    ) -> Result<bool, StoreError> {
        let salt = query("SELECT salt FROM competitions WHERE key = $1").bind(competition.0);
        let salt: Option<Vec<u8>> = self.fetch_optional(salt).await?;
        let [look, other_look] = digests(&salt.unwrap_or_default(), name);
        let query = query(
            "SELECT EXISTS (SELECT 1 FROM used_names WHERE competition = $1 AND look IN ($2, $3) AND entry <> $4)",
        )
        .bind(competition.0)
        .bind(look)
        .bind(other_look)
        .bind(except.map_or(-1, |entry| entry.0));
        self.fetch_one(query).await
    }

    /// Competition for which an entrant's key was made.
    pub async fn competition_of(
        &self,
        owner: OwnerKey,
    ) -> Result<Option<CompetitionKey>, StoreError> {
        let text = "SELECT competition FROM entries WHERE owner = $1 ORDER BY key LIMIT 1";
        self.fetch_optional(query(text).bind(owner.0)).await
    }

    /// Competition for which a key was made, that of a team's member included, and the public id of its entrant there.
    pub async fn entrant_of_key(
        &self,
        key: OwnerKey,
    ) -> Result<Option<(CompetitionKey, String)>, StoreError> {
        let query = query(
            "SELECT competition, id FROM entries
             WHERE owner = (SELECT coalesce(acts_for, number) FROM keys WHERE number = $1)
             ORDER BY key LIMIT 1",
        );
        self.fetch_optional(query.bind(key.0)).await
    }

    /// Lists the entrants of a competition, or those of one key, in the order of registration, starting after `after`; without
    /// the data that only the entrants themselves see.
    pub async fn list_entrants(
        &self,
        competition: CompetitionKey,
        owner: Option<OwnerKey>,
        after: Option<EntryKey>,
        limit: u32,
    ) -> Result<Vec<RawEntrant>, StoreError> {
        let mut query = select_entrants(Declared::Short);
        // The `+` makes SQLite look up entrants by their owner, who has few.
        query.push(if owner.is_some() { "WHERE +competition = " } else { "WHERE competition = " });
        query.push_bind(competition.0);
        if let Some(owner) = owner {
            query.push(" AND owner = ").push_bind(owner.0);
        }
        query.push(" AND key > ").push_bind(after.map_or(-1, |key| key.0));
        query.push(" ORDER BY key LIMIT ").push_bind(limit);
        self.fetch_all(query.build()).await
    }

    /// Lists the contacts of a competition's entrants in the order of their keys, starting after `after`.
    pub async fn list_contacts(
        &self,
        competition: CompetitionKey,
        after: Option<EntryKey>,
        limit: u32,
    ) -> Result<Vec<StoredContact>, StoreError> {
        let query = query(
            "SELECT key, id, name, category, status, contact FROM entries
             WHERE competition = $1 AND key > $2 ORDER BY key LIMIT $3",
        );
        let after = after.map_or(-1, |key| key.0);
        self.fetch_all(query.bind(competition.0).bind(after).bind(limit)).await
    }

    pub async fn find_invitation(
        &self,
        competition: CompetitionKey,
        hash: TokenHash,
    ) -> Result<Option<StoredInvitation>, StoreError> {
        let mut query = Builder::new(INVITATION);
        query.push("WHERE i.competition = ").push_bind(competition.0);
        query.push(" AND i.hash = ").push_bind(hash.0.to_vec());
        self.fetch_optional(query.build()).await
    }

    /// Unused invitation codes of a competition with this label.
    pub async fn unused_invitations(
        &self,
        competition: CompetitionKey,
        label: &str,
    ) -> Result<Vec<StoredInvitation>, StoreError> {
        let mut query = Builder::new(INVITATION);
        query.push("WHERE i.competition = ").push_bind(competition.0);
        query.push(" AND i.label = ").push_bind(label);
        query.push(" AND i.entry IS NULL AND i.revoked_at IS NULL ORDER BY i.created_at, i.hash");
        self.fetch_all(query.build()).await
    }

    /// Lists the invitation codes of a competition in the order of creation, without the first `skip`.
    pub async fn list_invitations(
        &self,
        competition: CompetitionKey,
        skip: u32,
        limit: u32,
    ) -> Result<Vec<StoredInvitation>, StoreError> {
        let mut query = Builder::new(INVITATION);
        query.push("WHERE i.competition = ").push_bind(competition.0);
        query.push(" ORDER BY i.created_at, i.hash LIMIT ").push_bind(limit);
        query.push(" OFFSET ").push_bind(skip);
        self.fetch_all(query.build()).await
    }

    /// Entrants of a competition among these keys, in the order of registration.
    pub async fn entrants_among(
        &self,
        competition: CompetitionKey,
        entries: &[EntryKey],
    ) -> Result<Vec<RawEntrant>, StoreError> {
        let mut query = select_entrants(Declared::Short);
        query.push("WHERE +competition = ").push_bind(competition.0).push(" AND key IN ");
        query.push_list(entries.iter().map(|entry| entry.0));
        query.push(" ORDER BY key");
        self.fetch_all(query.build()).await
    }

    /// Attempts of an entrant in the order of their starts.
    pub async fn attempts_of(&self, entry: EntryKey) -> Result<Vec<StoredAttempt>, StoreError> {
        let mut query = Builder::new(ATTEMPT);
        query.push("WHERE r.entry = ").push_bind(entry.0).push(" ORDER BY r.key");
        self.fetch_all(query.build()).await
    }

    /// Lists the attempts of a competition, or those of one key, in the order of their starts, starting after `after`.
    pub async fn list_attempts(
        &self,
        competition: CompetitionKey,
        owner: Option<OwnerKey>,
        after: Option<RunKey>,
        limit: u32,
    ) -> Result<Vec<StoredAttempt>, StoreError> {
        let mut query = Builder::new(ATTEMPT);
        match owner {
            None => query.push("WHERE r.competition = ").push_bind(competition.0),
            // The few attempts of a key are looked up by its entrants.
            Some(owner) => query
                .push("WHERE r.entry IN (SELECT key FROM entries WHERE owner = ")
                .push_bind(owner.0)
                .push(") AND +r.competition = ")
                .push_bind(competition.0),
        };
        query.push(" AND r.key > ").push_bind(after.map_or(-1, |run| run.0));
        query.push(" ORDER BY r.key LIMIT ").push_bind(limit);
        self.fetch_all(query.build()).await
    }

    pub async fn find_attempt(
        &self,
        competition: CompetitionKey,
        run: &str,
    ) -> Result<Option<StoredAttempt>, StoreError> {
        let mut query = Builder::new(ATTEMPT);
        query.push("WHERE r.id = ").push_bind(run);
        query.push(" AND +r.competition = ").push_bind(competition.0);
        self.fetch_optional(query.build()).await
    }

    /// Attempt of a competition that was started last.
    pub async fn last_attempt(
        &self,
        competition: CompetitionKey,
    ) -> Result<Option<RunKey>, StoreError> {
        let text = "SELECT key FROM runs WHERE competition = $1 ORDER BY key DESC LIMIT 1";
        self.fetch_optional(query(text).bind(competition.0)).await
    }

    /// Voided attempts of a competition in the order of their starts.
    pub async fn voided_attempts(
        &self,
        competition: CompetitionKey,
    ) -> Result<Vec<RunKey>, StoreError> {
        let query = query(
            "SELECT key FROM runs WHERE competition = $1 AND voided_at IS NOT NULL ORDER BY key",
        );
        self.fetch_all(query.bind(competition.0)).await
    }

    /// Running attempts of a competition in the order of their starts.
    pub async fn running_attempts(
        &self,
        competition: CompetitionKey,
    ) -> Result<Vec<RunKey>, StoreError> {
        let query = query(
            "SELECT key FROM runs INDEXED BY runs_open
             WHERE competition = $1 AND ended_at IS NULL ORDER BY key",
        );
        self.fetch_all(query.bind(competition.0)).await
    }

    /// Whether an attempt of a competition, or a game of one, has not ended. Voided games are ignored.
    pub async fn has_open_attempts(&self, competition: CompetitionKey) -> Result<bool, StoreError> {
        let query = query(
            "SELECT EXISTS (SELECT 1 FROM runs INDEXED BY runs_open
                            WHERE competition = $1 AND ended_at IS NULL)
                 OR EXISTS (SELECT 1 FROM episodes e INDEXED BY episodes_open JOIN runs r ON r.key = e.run
                            WHERE e.run IS NOT NULL AND e.ended_at IS NULL AND e.voided_at IS NULL
                              AND r.competition = $1)",
        );
        self.fetch_one(query.bind(competition.0)).await
    }

    /// Entrants of a competition that own some of these runs and episodes.
    pub async fn entrants_of(
        &self,
        competition: CompetitionKey,
        runs: &[RunKey],
        episodes: &[EpisodeKey],
    ) -> Result<Vec<EntryKey>, StoreError> {
        let mut query = Builder::new("SELECT entry FROM runs WHERE key IN ");
        query.push_list(runs.iter().map(|run| run.0));
        query.push(" AND +competition = ").push_bind(competition.0);
        query.push(
            " UNION SELECT r.entry FROM episodes e JOIN runs r ON r.key = e.run WHERE e.key IN ",
        );
        query.push_list(episodes.iter().map(|episode| episode.0));
        query.push(" AND +r.competition = ").push_bind(competition.0);
        // SQLite returns a UNION in this order without a further sort.
        query.push(" ORDER BY 1");
        self.fetch_all(query.build()).await
    }
}

/// Beginning of a brief declaration of people who play.
pub(in crate::store) const PEOPLE_PLAY: &str = r#""agent_meta":{"kind":"human"},"#;

/// Declaration without the prompt template and the free metadata, which may be large, but with the word that people play.
pub(in crate::store) fn without_texts(declaration: &str) -> Result<String, serde_json::Error> {
    let mut fields: BTreeMap<String, Box<RawValue>> = serde_json::from_str(declaration)?;
    fields.remove("prompt_template");
    let meta = fields.remove("agent_meta");
    // Stored metadata may have halves of characters, which are no text.
    let read = meta.and_then(|meta| serde_json::from_str(meta.get()).ok());
    if read.is_some_and(|meta| is_human(&meta)) {
        fields.insert("agent_meta".to_owned(), to_raw_value(&json!({ "kind": HUMAN }))?);
    }
    serde_json::to_string(&fields)
}

pub(in crate::store) async fn add(
    connection: &mut Connection,
    row: &CompetitionRow,
) -> Result<(), sqlx::Error> {
    query(
        "INSERT INTO competitions (id, definition, salt, seeds, commitment, opens_at, closes_at, created_at)
         VALUES ($1, $2, $3, $4, $5, $6, $7, $8)",
    )
    .bind(&row.id)
    .bind(&row.definition)
    .bind(&row.salt.0)
    .bind(&row.seeds.0)
    .bind(&row.commitment[..])
    .bind(row.opens_at.as_millisecond())
    .bind(row.closes_at.as_millisecond())
    .bind(row.at.as_millisecond())
    .execute(connection)
    .await?;
    Ok(())
}

pub(in crate::store) async fn change(
    connection: &mut Connection,
    competition: CompetitionKey,
    definition: &str,
    closes_at: Timestamp,
    hidden: bool,
) -> Result<(), sqlx::Error> {
    query("UPDATE competitions SET definition = $1, closes_at = $2, hidden = $3 WHERE key = $4")
        .bind(definition)
        .bind(closes_at.as_millisecond())
        .bind(hidden)
        .bind(competition.0)
        .execute(connection)
        .await?;
    Ok(())
}

pub(in crate::store) async fn cancel(
    connection: &mut Connection,
    competition: CompetitionKey,
    reason: &str,
    at: Timestamp,
) -> Result<(), sqlx::Error> {
    query(
        "UPDATE competitions SET cancelled_at = $1, cancel_reason = $2
         WHERE key = $3 AND cancelled_at IS NULL",
    )
    .bind(at.as_millisecond())
    .bind(reason)
    .bind(competition.0)
    .execute(connection)
    .await?;
    Ok(())
}

pub(in crate::store) async fn revoke_invitations(
    connection: &mut Connection,
    hashes: &[TokenHash],
    at: Timestamp,
) -> Result<(), sqlx::Error> {
    for hash in hashes {
        query(
            "UPDATE invitations SET revoked_at = $1
             WHERE hash = $2 AND entry IS NULL AND revoked_at IS NULL",
        )
        .bind(at.as_millisecond())
        .bind(&hash.0[..])
        .execute(&mut *connection)
        .await?;
    }
    Ok(())
}

pub(in crate::store) async fn add_entrant(
    connection: &mut Connection,
    row: &EntrantRow,
) -> Result<(), sqlx::Error> {
    let brief = without_texts(&row.declaration).map_err(|e| sqlx::Error::Encode(e.into()))?;
    let added: i64 = query(
        "INSERT INTO entries (id, competition, owner, name, model, declaration, brief, template, status, vouched, registered_at,
                              address, category, terms, contact)
         VALUES ($1, $2, (SELECT coalesce(acts_for, number) FROM keys WHERE id = $3), $4, $5, $6, $7, $8, 'active', $9, $10, $11, $12, $13, $14)
         RETURNING key",
    )
    .bind(&row.id)
    .bind(row.competition.0)
    .bind(&row.owner)
    .bind(&row.name)
    .bind(&row.model)
    .bind(&row.declaration)
    .bind(brief)
    .bind(&row.template)
    .bind(row.vouched)
    .bind(row.at.as_millisecond())
    .bind(&row.address)
    .bind(&row.category)
    .bind(row.terms)
    .bind(&row.contact)
    .one(connection)
    .await?;
    add_looks(connection, row.competition.0, &row.model).await?;
    use_name(connection, added, &row.name).await?;
    query("UPDATE competitions SET entrants = entrants + 1 WHERE key = $1")
        .bind(row.competition.0)
        .execute(&mut *connection)
        .await?;
    if let Some(hash) = row.invitation {
        query("UPDATE invitations SET entry = $1 WHERE hash = $2")
            .bind(added)
            .bind(&hash.0[..])
            .execute(connection)
            .await?;
    }
    Ok(())
}

/// Inserts the looks of an entrant's model, by which similar ones are found.
async fn add_looks(
    connection: &mut Connection,
    competition: i64,
    model: &str,
) -> Result<(), sqlx::Error> {
    for look in looks(model) {
        let insert =
            "INSERT INTO looks (competition, kind, look, written) VALUES ($1, 'model', $2, $3)
                      ON CONFLICT DO NOTHING";
        query(insert).bind(competition).bind(look).bind(model).execute(&mut *connection).await?;
    }
    Ok(())
}

/// Keyed digests of the looks of a name. They reveal the name only to those who guess it.
fn digests(salt: &[u8], name: &str) -> [Vec<u8>; 2] {
    let keyed = Hmac::<Sha256>::new_from_slice(salt).expect("a key may have any length");
    looks(name).map(|look| {
        let digest = keyed.clone().chain_update(look).finalize().into_bytes();
        digest[..DIGEST_BYTES].to_vec()
    })
}

/// Reserves the name of an entrant until the competition is revealed, after which names never change.
async fn use_name(connection: &mut Connection, entry: i64, name: &str) -> Result<(), sqlx::Error> {
    let select = "SELECT c.key, c.salt FROM entries n JOIN competitions c ON c.key = n.competition
                  WHERE n.key = $1 AND c.revealed_at IS NULL";
    let found = query(select).bind(entry).fetch_optional(&mut *connection).await?;
    let Some(found) = found else { return Ok(()) };
    let competition: i64 = found.try_get("key")?;
    let salt: Vec<u8> = found.try_get("salt")?;
    for look in digests(&salt, name) {
        let insert = "INSERT INTO used_names (competition, look, entry) VALUES ($1, $2, $3)
                      ON CONFLICT DO NOTHING";
        query(insert).bind(competition).bind(look).bind(entry).execute(&mut *connection).await?;
    }
    Ok(())
}

/// Inserts the looks of models, and the reserved names, of entrants of earlier versions.
pub(in crate::store) async fn add_missing_looks(
    connection: &mut Connection,
) -> Result<(), sqlx::Error> {
    let entrants: Vec<(i64, i64, String, String)> = query(
        "SELECT competition, key, name, model FROM entries WHERE NOT EXISTS (SELECT 1 FROM looks)",
    )
    .all(connection)
    .await?;
    if entrants.is_empty() {
        return Ok(());
    }
    let add_all = async |connection: &mut Connection| {
        for (competition, entry, name, model) in &entrants {
            add_looks(connection, *competition, model).await?;
            use_name(connection, *entry, name).await?;
        }
        Ok(())
    };
    connection.transaction(Begin::Write, add_all).await
}

/// Models whose stored looks are wrong, or belong to no entrant.
pub(in crate::store) async fn damaged_looks(
    connection: &mut Connection,
) -> Result<Vec<String>, sqlx::Error> {
    let text = "SELECT l.look, l.written, l.kind = 'model' AND EXISTS (
                     SELECT 1 FROM entries n WHERE n.competition = l.competition AND l.written = n.model) AS is_used
                 FROM looks l";
    let mut rows = query(text).fetch(connection);
    let mut damaged = Vec::new();
    while let Some(row) = rows.try_next().await? {
        let (look, written) = (row.text("look")?, row.text("written")?);
        if !row.try_get::<bool>("is_used")? || !looks(written).iter().any(|own| own == look) {
            damaged.push(written.to_owned());
        }
    }
    Ok(damaged)
}

/// Names of entrants that are not reserved.
pub(in crate::store) async fn untaken_names(
    connection: &mut Connection,
) -> Result<Vec<String>, sqlx::Error> {
    let text = "SELECT competition, look, entry FROM used_names";
    let used: Vec<(i64, Vec<u8>, i64)> = query(text).all(connection).await?;
    let used: BTreeSet<_> = used.into_iter().collect();
    let text = "SELECT n.competition, n.key, n.name, c.salt FROM entries n JOIN competitions c ON c.key = n.competition
                WHERE c.revealed_at IS NULL AND n.erased_at IS NULL";
    let entrants: Vec<(i64, i64, String, Vec<u8>)> = query(text).all(connection).await?;
    let is_untaken = |&(competition, entry, ref name, ref salt): &(i64, i64, String, Vec<u8>)| {
        digests(salt, name).into_iter().any(|look| !used.contains(&(competition, look, entry)))
    };
    Ok(entrants.into_iter().filter(is_untaken).map(|(_, _, name, _)| name).collect())
}

pub(in crate::store) async fn set_entrant(
    connection: &mut Connection,
    entry: EntryKey,
    status: &str,
    reason: Option<&str>,
    vouched: bool,
) -> Result<(), sqlx::Error> {
    query(
        "UPDATE competitions
         SET entrants = entrants + CASE WHEN $1 = 'active' THEN 1 ELSE 0 END
             - (SELECT CASE WHEN status = 'active' THEN 1 ELSE 0 END FROM entries WHERE key = $2)
         WHERE key = (SELECT competition FROM entries WHERE key = $2)",
    )
    .bind(status)
    .bind(entry.0)
    .execute(&mut *connection)
    .await?;
    query("UPDATE entries SET status = $1, reason = $2, vouched = $3 WHERE key = $4")
        .bind(status)
        .bind(reason)
        .bind(vouched)
        .bind(entry.0)
        .execute(connection)
        .await?;
    Ok(())
}

pub(in crate::store) async fn describe(
    connection: &mut Connection,
    facts: &EntrantFacts,
) -> Result<(), sqlx::Error> {
    query("UPDATE entries SET category = $1, terms = $2, contact = $3 WHERE key = $4")
        .bind(&facts.category)
        .bind(facts.terms)
        .bind(&facts.contact)
        .bind(facts.entry.0)
        .execute(connection)
        .await?;
    Ok(())
}

/// Renames an entrant. The old name stays reserved.
pub(in crate::store) async fn rename(
    connection: &mut Connection,
    entry: EntryKey,
    name: &str,
    by_itself: bool,
) -> Result<(), sqlx::Error> {
    query("UPDATE entries SET name = $1, renames = renames + $3 WHERE key = $2 RETURNING key")
        .bind(name)
        .bind(entry.0)
        .bind(i64::from(by_itself))
        .fetch_one(&mut *connection)
        .await?;
    use_name(connection, entry.0, name).await
}

/// Erases the name, contact and address of an entrant. A published file keeps the name.
pub(in crate::store) async fn erase(
    connection: &mut Connection,
    entry: EntryKey,
    name: &str,
    at: Timestamp,
) -> Result<(), sqlx::Error> {
    query(
        "UPDATE entries SET name = $3, address = NULL, contact = NULL, erased_at = $1,
             published = (SELECT entries.name FROM competitions c
                          WHERE c.key = entries.competition AND c.revealed_at IS NOT NULL)
         WHERE key = $2 AND erased_at IS NULL",
    )
    .bind(at.as_millisecond())
    .bind(entry.0)
    .bind(name)
    .execute(&mut *connection)
    .await?;
    // Keys that were made for the entrant have its name or those of its members. They stay valid for other entrants of their
    // owner.
    query(
        "UPDATE keys SET name = $1, revoked_at = CASE
             WHEN EXISTS (SELECT 1 FROM entries o
                          WHERE o.owner = coalesce(keys.acts_for, keys.number) AND o.erased_at IS NULL)
             THEN revoked_at ELSE coalesce(revoked_at, $2) END
         WHERE role = 'entrant'
             AND (SELECT owner FROM entries WHERE key = $3) IN (number, acts_for)",
    )
    .bind(name)
    .bind(at.as_millisecond())
    .bind(entry.0)
    .execute(&mut *connection)
    .await?;
    erase_label(connection, entry, name).await
}

/// Erases the label of the entrant's invitation code: organizers write names and addresses into labels.
async fn erase_label(
    connection: &mut Connection,
    entry: EntryKey,
    name: &str,
) -> Result<(), sqlx::Error> {
    query(
        "UPDATE invitations SET label = $1
         WHERE entry = $2 AND competition = (SELECT competition FROM entries WHERE key = $2)",
    )
    .bind(name)
    .bind(entry.0)
    .execute(&mut *connection)
    .await?;
    // Earlier versions recorded all labels in the audit log.
    query(
        "UPDATE audit SET detail = coalesce(shown, '{}')
         WHERE competition = (SELECT competition FROM entries WHERE key = $1)
             AND action IN ('competition.codes', 'competition.codes.revoke')",
    )
    .bind(entry.0)
    .execute(connection)
    .await?;
    Ok(())
}

pub(in crate::store) async fn add_invitations(
    connection: &mut Connection,
    competition: CompetitionKey,
    codes: &[(TokenHash, String)],
    at: Timestamp,
) -> Result<(), sqlx::Error> {
    for (hash, label) in codes {
        query(
            "INSERT INTO invitations (hash, competition, label, created_at) VALUES ($1, $2, $3, $4)",
        )
        .bind(&hash.0[..])
        .bind(competition.0)
        .bind(label)
        .bind(at.as_millisecond())
        .execute(&mut *connection)
        .await?;
    }
    Ok(())
}

/// Makes a competition and all of its episodes public.
pub(in crate::store) async fn reveal(
    connection: &mut Connection,
    competition: CompetitionKey,
    at: Timestamp,
) -> Result<(), sqlx::Error> {
    query("UPDATE competitions SET revealed_at = coalesce(revealed_at, $1) WHERE key = $2")
        .bind(at.as_millisecond())
        .bind(competition.0)
        .execute(&mut *connection)
        .await?;
    query(
        "UPDATE episodes SET revealed = TRUE WHERE run IN (
             SELECT r.key FROM runs r JOIN entries n ON n.key = r.entry WHERE n.competition = $1)",
    )
    .bind(competition.0)
    .execute(&mut *connection)
    .await?;
    query("UPDATE runs SET revealed = TRUE WHERE competition = $1")
        .bind(competition.0)
        .execute(&mut *connection)
        .await?;
    // Names never change from now on, and the key of the digests is public.
    query("DELETE FROM used_names WHERE competition = $1")
        .bind(competition.0)
        .execute(connection)
        .await?;
    Ok(())
}

from_row! {
    RawCompetition {
        key, id, definition, salt, seeds, commitment, created_at, revealed_at, cancelled_at, cancel_reason, hidden,
    }
    StoredContact { key, id, name, category, status, contact }
    StoredInvitation { hash, label, entrant, created_at, revoked_at }
    EntrantRoom { active, has_look_of_model, of_owner }
}

impl FromRow for RawEntrant {
    fn from_row(row: &SqlRow) -> Result<Self, sqlx::Error> {
        let mut declaration: String = get(row, "declaration")?;
        if get(row, "is_to_be_cut")? {
            declaration =
                without_texts(&declaration).map_err(|error| sqlx::Error::Decode(error.into()))?;
        }
        Ok(Self {
            key: get(row, "key")?,
            id: get(row, "id")?,
            competition: get(row, "competition")?,
            owner: get(row, "owner")?,
            name: get(row, "name")?,
            declaration,
            template: get(row, "template")?,
            status: get(row, "status")?,
            reason: get(row, "reason")?,
            vouched: get(row, "vouched")?,
            registered_at: get(row, "registered_at")?,
            address: get(row, "address")?,
            erased_at: get(row, "erased_at")?,
            published: get(row, "published")?,
            category: get(row, "category")?,
            terms: get(row, "terms")?,
            contact: get(row, "contact")?,
            renames: get(row, "renames")?,
        })
    }
}

impl FromRow for StoredAttempt {
    fn from_row(row: &SqlRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            run: get(row, "key")?,
            id: get(row, "id")?,
            entry: get(row, "entry")?,
            number: get(row, "attempt")?,
            replays: get(row, "replays")?,
            status: get(row, "status")?,
            created_at: get(row, "created_at")?,
            ended_at: get(row, "ended_at")?,
            void_reason: void_reason(row)?,
            unfinished: get(row, "unfinished")?,
        })
    }
}

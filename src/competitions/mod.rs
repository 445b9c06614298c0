//! Competitions of a server: their stored rows, their closing ([`closing`]), and their standings ([`standings`]).

pub mod closing;
pub mod field;
pub mod standings;

use std::net::IpAddr;

use jiff::Timestamp;

use crate::ids::{CompetitionKey, EntryKey, dated_id};
use crate::keys::OwnerKey;
use crate::store::check::Formats;
use crate::store::competitions::{Declared, RawCompetition, RawEntrant};
use crate::store::{Store, StoreError};
use swarmbench_boards::competition::EntrantStatus;
use swarmbench_boards::competition::definition::Definition;
use swarmbench_boards::competition::entrant::{Declaration, Entrant};
use swarmbench_boards::competition::phase::{BoardView, board_view};
use swarmbench_boards::competition::sealed::{SEED_BYTES, Sealed};
use swarmbench_boards::competition::standings::Part;
use swarmbench_clock::Entropy;

pub fn new_id(now: Timestamp, entropy: &dyn Entropy) -> String {
    dated_id("cmp_", now, entropy)
}

pub fn new_entrant_id(now: Timestamp, entropy: &dyn Entropy) -> String {
    dated_id("ent_", now, entropy)
}

#[derive(Clone, Debug)]
pub struct StoredCompetition {
    pub key: CompetitionKey,
    pub id: String,
    pub definition: Definition,
    pub sealed: Sealed,
    /// Published commitment to the secret.
    pub commitment: [u8; 32],
    pub created_at: Timestamp,
    /// Time at which everything became public.
    pub revealed_at: Option<Timestamp>,
    /// Time and reason of the cancellation.
    pub cancelled: Option<(Timestamp, String)>,
    /// Only organizers see the competition in lists.
    pub hidden: bool,
}

#[derive(Clone, Debug)]
pub struct StoredEntrant {
    pub key: EntryKey,
    pub competition: CompetitionKey,
    pub owner: OwnerKey,
    /// Address or network of the registration, shown to organizers.
    pub address: Option<IpAddr>,
    /// Name in the published file, if the entrant was erased after the end.
    pub published: Option<String>,
    /// Contact for organizers.
    pub contact: Option<String>,
    /// Number of renames.
    pub renames: u32,
    /// Public data and declaration.
    pub entrant: Entrant,
}

impl StoredCompetition {
    /// Seeds that make the public board, and the time before which attempts must have ended. `None` if no board is public.
    pub fn part_shown_to_all(&self, now: Timestamp) -> Option<(Part, Option<Timestamp>)> {
        let of_all = self.definition.public_seeds == 0;
        match board_view(&self.definition, self.revealed_at.is_some(), now) {
            BoardView::Nothing => None,
            BoardView::All => Some((Part::Final, None)),
            BoardView::Totals => Some((if of_all { Part::Final } else { Part::Public }, None)),
            BoardView::TotalsBefore(at) => {
                Some((if of_all { Part::Final } else { Part::Public }, Some(at)))
            }
        }
    }
}

/// Parsers of stored competitions for the check of a database.
pub const FORMATS: Formats = Formats {
    competition: |raw| {
        let StoredCompetition { definition, sealed, .. } = competition(raw)?;
        Ok(([definition.opens_at, definition.closes_at], sealed.commitment()))
    },
    declaration: |text| {
        let declaration: Declaration = parse(&text)?;
        let template = declaration.template_digest();
        Ok((declaration.model, template))
    },
};

pub async fn find(store: &Store, id: &str) -> Result<Option<StoredCompetition>, StoreError> {
    let found = store.find_competition(id).await?;
    found.map(competition).transpose().map_err(StoreError::decode)
}

/// Lists competitions; see [`Store::list_competitions`].
pub async fn list(
    store: &Store,
    all: bool,
    before: Option<CompetitionKey>,
    limit: u32,
) -> Result<Vec<StoredCompetition>, StoreError> {
    let found = store.list_competitions(all, before, limit).await?;
    found.into_iter().map(competition).collect::<Result<_, _>>().map_err(StoreError::decode)
}

pub async fn find_entrant(
    store: &Store,
    competition: CompetitionKey,
    id: &str,
) -> Result<Option<StoredEntrant>, StoreError> {
    let found = store.find_entrant(competition, id).await?;
    found.map(entrant).transpose().map_err(StoreError::decode)
}

/// Entrants of a competition: all, or those of one key; see [`Store::entrants`].
pub async fn entrants(
    store: &Store,
    competition: CompetitionKey,
    owner: Option<OwnerKey>,
    declared: Declared,
) -> Result<Vec<StoredEntrant>, StoreError> {
    read_entrants(store.entrants(competition, owner, declared).await?)
}

/// Lists the entrants of a competition; see [`Store::list_entrants`].
pub async fn list_entrants(
    store: &Store,
    competition: CompetitionKey,
    owner: Option<OwnerKey>,
    after: Option<EntryKey>,
    limit: u32,
) -> Result<Vec<StoredEntrant>, StoreError> {
    read_entrants(store.list_entrants(competition, owner, after, limit).await?)
}

/// Entrants of a competition by their keys; see [`Store::entrants_among`].
pub async fn entrants_among(
    store: &Store,
    competition: CompetitionKey,
    entries: &[EntryKey],
) -> Result<Vec<StoredEntrant>, StoreError> {
    read_entrants(store.entrants_among(competition, entries).await?)
}

fn read_entrants(raw: Vec<RawEntrant>) -> Result<Vec<StoredEntrant>, StoreError> {
    raw.into_iter().map(entrant).collect::<Result<_, _>>().map_err(StoreError::decode)
}

fn parse<T: serde::de::DeserializeOwned>(text: &str) -> Result<T, String> {
    serde_json::from_str(text).map_err(|error| error.to_string())
}

fn competition(raw: RawCompetition) -> Result<StoredCompetition, String> {
    let (seeds, []) = raw.seeds.0.as_chunks::<SEED_BYTES>() else {
        return Err("seeds have 16 bytes each".to_owned());
    };
    let salt = <_>::try_from(&raw.salt.0[..]).map_err(|_| "a salt has 32 bytes")?;
    Ok(StoredCompetition {
        key: raw.key,
        id: raw.id,
        definition: parse(&raw.definition)?,
        sealed: Sealed { salt, seeds: seeds.to_vec() },
        commitment: raw.commitment,
        created_at: raw.created_at,
        revealed_at: raw.revealed_at,
        cancelled: raw.cancelled_at.map(|at| (at, raw.cancel_reason.unwrap_or_default())),
        hidden: raw.hidden,
    })
}

fn entrant(raw: RawEntrant) -> Result<StoredEntrant, String> {
    let mut declaration: Declaration = parse(&raw.declaration)?;
    declaration.template = raw.template;
    Ok(StoredEntrant {
        key: raw.key,
        competition: raw.competition,
        owner: raw.owner,
        published: raw.published,
        contact: raw.contact,
        renames: raw.renames,
        address: raw.address.and_then(|address| address.parse().ok()),
        entrant: Entrant {
            id: raw.id,
            name: raw.name,
            declaration,
            status: EntrantStatus::parse(&raw.status).ok_or("the status of an entrant")?,
            reason: raw.reason,
            vouched: raw.vouched,
            registered_at: raw.registered_at,
            category: raw.category,
            terms: raw.terms,
            erased: raw.erased_at.is_some(),
        },
    })
}

//! Commands by which organizers intervene in a competition: change, cancel, revoke and exclude.

use std::path::PathBuf;

use anyhow::Context;
use jiff::Timestamp;
use swarmbench_client::client::Client;
use swarmbench_protocol::competition::{
    Announcement, AnnouncementRequest, CancelRequest, Competition, CompetitionChange,
    EntrantChange, EntrantSummary, Exclusion, ExclusionRequest, InvitationList, InvitationSummary,
    OrganizerAction, ReplacedKey, RevokeCodesRequest, WindowExtension,
};
use swarmbench_protocol::names::printable;

use super::{CompetitionId, EntrantOf, changed, path, show, tables, tell_changed};
use crate::pages::{Page, all};

#[derive(Debug, clap::Subcommand)]
pub(super) enum Command {
    /// Extend a competition or the windows of its attempts, correct its texts, renew its terms, or hide it from lists.
    #[command(
        after_help = "A window can be extended, never shortened. Open games keep their deadline; games that are opened later \
        have the new one. Everybody sees the change, in `swarmbench competition actions`. After the end only --hide and --unhide \
        are accepted.\n\n\
        Examples:\n  \
        swarmbench competition change cmp_… --closes-at 2027-03-09T12:00:00Z --reason 'an hour without the server'\n  \
        swarmbench competition change cmp_… --window 1=2027-03-05T12:00:00Z\n  \
        swarmbench competition change cmp_… --hide"
    )]
    Change(Change),
    /// End a competition early: nobody can enter or start an attempt any more, and running attempts end.
    Cancel {
        /// The competition's id.
        id: String,
        /// The reason, visible to all.
        #[arg(long)]
        reason: String,
    },
    /// Show the actions of organizers in a competition, which everybody may see.
    Actions(CompetitionId),
    /// Announce something to all who follow a competition.
    Announce {
        /// The competition's id.
        id: String,
        /// The announcement: 1 to 2,000 characters. It cannot be changed later; another announcement corrects a mistake.
        #[arg(long)]
        text: String,
    },
    /// Show the announcements of a competition.
    Announcements(CompetitionId),
    /// List the invitation codes: which were used, and by whom.
    ListCodes(CompetitionId),
    /// Revoke invitation codes that nobody has used, by their labels or the codes themselves.
    RevokeCodes {
        /// The competition's id.
        id: String,
        /// Labels; each revokes all unused codes that have it.
        #[arg(required_unless_present = "code")]
        labels: Vec<String>,
        /// The code itself; may be repeated.
        #[arg(long)]
        code: Vec<String>,
    },
    /// Give an entrant another name, as the entrant or an organizer.
    Rename {
        #[command(flatten)]
        entrant: EntrantOf,
        /// The name on the board.
        #[arg(long)]
        name: String,
    },
    /// Erase an entrant's name, address and key, as the entrant or an organizer. An erasure cannot be undone.
    Erase {
        #[command(flatten)]
        entrant: EntrantOf,
    },
    /// Make a new key for an entrant that has lost its own.
    ReplaceKey {
        #[command(flatten)]
        entrant: EntrantOf,
    },
    /// Exclude all entrants that fit a description. Without --count the command shows a preview.
    #[command(after_help = "Examples:\n  \
        swarmbench competition exclude cmp_… --name 'bot-*'\n  \
        swarmbench competition exclude cmp_… --name 'bot-*' --count 7 --reason 'one team under seven names'\n  \
        swarmbench competition exclude cmp_… --address 203.0.113.0/24 --registered-from 2027-03-02T00:00:00Z")]
    Exclude(Exclude),
}

#[derive(Debug, clap::Args)]
pub(super) struct Change {
    /// The competition's id.
    id: String,
    /// The new name.
    #[arg(long)]
    name: Option<String>,
    /// The new description.
    #[arg(long)]
    description: Option<String>,
    /// The new, later end of the competition.
    #[arg(long, value_name = "TIME")]
    closes_at: Option<Timestamp>,
    /// The new, later end of an attempt's window; may be repeated.
    #[arg(long, value_name = "ATTEMPT=TIME", value_parser = window)]
    window: Vec<(u32, Timestamp)>,
    /// Hide the competition from lists: a rehearsal.
    #[arg(long, conflicts_with = "unhide")]
    hide: bool,
    /// Show the competition in lists again.
    #[arg(long)]
    unhide: bool,
    /// A file with the new terms. Entrants keep the version that they accepted.
    #[arg(long, value_name = "FILE", conflicts_with = "terms_text")]
    terms: Option<PathBuf>,
    /// The text of the new terms.
    #[arg(long, value_name = "TEXT")]
    terms_text: Option<String>,
    /// The revision that you saw, from `swarmbench competition show`: if somebody has changed the competition since, the command
    /// changes nothing. Default: the competition's revision when this command starts.
    #[arg(long, value_name = "REVISION")]
    if_revision: Option<String>,
    /// The reason, visible to all.
    #[arg(long)]
    reason: Option<String>,
}

#[derive(Debug, clap::Args)]
pub(super) struct Exclude {
    /// The competition's id.
    id: String,
    /// Entrants that registered from this address or network.
    #[arg(long)]
    address: Option<String>,
    /// Entrants that registered at this time or later.
    #[arg(long, value_name = "TIME")]
    registered_from: Option<Timestamp>,
    /// Entrants that registered before this time.
    #[arg(long, value_name = "TIME")]
    registered_before: Option<Timestamp>,
    /// Entrants whose name matches this pattern: * stands for any characters, ? for one.
    #[arg(long)]
    name: Option<String>,
    /// The number of these entrants, from the preview. Without it nobody is excluded.
    #[arg(long, requires = "reason")]
    count: Option<u32>,
    /// The reason, visible to all.
    #[arg(long)]
    reason: Option<String>,
}

fn window(text: &str) -> Result<(u32, Timestamp), String> {
    let (attempt, at) = text.split_once('=').ok_or("must be like 1=2027-03-05T12:00:00Z")?;
    let attempt = attempt.parse().map_err(|_| format!("{attempt:?} is no attempt, like 1"))?;
    let at = at.parse().map_err(|error| format!("{at:?} is no time with an offset: {error}"))?;
    Ok((attempt, at))
}

pub(super) async fn run(client: &Client, json: bool, command: Command) -> anyhow::Result<()> {
    match command {
        Command::Change(change) => {
            let id = path(&change.id, "");
            let mut request = change.request()?;
            if request.if_revision.is_none() {
                let seen: Competition = client.get(&id).await?;
                // Servers of earlier versions have no revision.
                request.if_revision = Some(seen.revision).filter(|revision| !revision.is_empty());
            }
            let changed: Competition = client.patch(&id, &request).await?;
            show(json, &changed, |changed| out!("{}", tables::competition(changed)))
        }
        Command::Cancel { id, reason } => {
            let cancelled: Competition =
                client.post(&path(&id, "/cancel"), &CancelRequest { reason }).await?;
            show(json, &cancelled, |cancelled| {
                out!(
                    "{} is {}; its seeds are published at {}.",
                    cancelled.id,
                    cancelled.phase,
                    cancelled.closes_at
                );
            })
        }
        Command::Actions(CompetitionId { id }) => {
            let list = Page::<OrganizerAction>::of(all(client, &path(&id, "/actions")).await?);
            show(json, &list, |list| out!("{}", tables::actions(&list.items)))
        }
        Command::Announce { id, text } => {
            let path = path(&id, "/announcements");
            let made: Announcement = client.post(&path, &AnnouncementRequest { text }).await?;
            show(json, &made, |made| out!("announced at {}\n", made.at))
        }
        Command::Announcements(CompetitionId { id }) => {
            let list = all(client, &path(&id, "/announcements")).await?;
            let list = Page::<Announcement>::of(list);
            show(json, &list, |list| {
                for Announcement { at, text } in &list.items {
                    out!("{at}\n{}\n\n", printable(text));
                }
            })
        }
        Command::ListCodes(CompetitionId { id }) => {
            let list = Page::<InvitationSummary>::of(all(client, &path(&id, "/codes")).await?);
            show(json, &list, |list| out!("{}", tables::invitations(&list.items)))
        }
        Command::RevokeCodes { id, labels, code } => {
            let request = RevokeCodesRequest { labels, codes: code };
            let revoked: InvitationList =
                client.post(&path(&id, "/codes/revoke"), &request).await?;
            show(json, &revoked, |revoked| out!("{}", tables::invitations(&revoked.items)))
        }
        Command::Rename { entrant, name } => {
            let change = EntrantChange { name: Some(name), ..EntrantChange::default() };
            show(json, &changed(client, entrant, change).await?, tell_changed)
        }
        Command::Erase { entrant: EntrantOf { id, entrant } } => {
            let erased: EntrantSummary =
                client.delete(&path(&id, &format!("/entrants/{entrant}"))).await?;
            show(json, &erased, tell_changed)
        }
        Command::ReplaceKey { entrant: EntrantOf { id, entrant } } => {
            let path = path(&id, &format!("/entrants/{entrant}/key"));
            let replaced: ReplacedKey = client.post(&path, &serde_json::json!({})).await?;
            show(json, &replaced, |replaced| {
                out!("{}", replaced.key);
                note!("The earlier key is no longer accepted. The new key cannot be shown again.");
            })
        }
        Command::Exclude(exclude) => {
            let id = path(&exclude.id, "/exclusions");
            let found: Exclusion = client.post(&id, &exclude.request()).await?;
            show(json, &found, tell_excluded)
        }
    }
}

impl Change {
    fn request(self) -> anyhow::Result<CompetitionChange> {
        let Self {
            id: _,
            name,
            description,
            closes_at,
            window,
            hide,
            unhide,
            terms,
            terms_text,
            if_revision,
            reason,
        } = self;
        let read = |file: PathBuf| {
            let why = || format!("--terms takes a file, --terms-text a text; {}", file.display());
            swarmbench_clock::files::read_text(&file).with_context(why)
        };
        let windows = window.into_iter();
        let windows =
            windows.map(|(attempt, at)| WindowExtension { attempt, closes_at: at.into() });
        Ok(CompetitionChange {
            name,
            description,
            closes_at: closes_at.map(Into::into),
            attempts: Some(windows.collect()),
            hidden: (hide || unhide).then_some(hide),
            terms: terms.map(read).transpose()?.or(terms_text),
            if_revision,
            reason,
        })
    }
}

impl Exclude {
    fn request(self) -> ExclusionRequest {
        let Self { id: _, address, registered_from, registered_before, name, count, reason } = self;
        let (registered_from, registered_before) =
            (registered_from.map(Into::into), registered_before.map(Into::into));
        ExclusionRequest { address, registered_from, registered_before, name, count, reason }
    }
}

fn tell_excluded(found: &Exclusion) {
    out!("{}", tables::entrants(&found.items));
    if found.excluded {
        note!(
            "{} entrants are disqualified. `swarmbench competition readmit` readmits an entrant.",
            found.count
        );
    } else {
        note!(
            "{} entrants fit, and none was excluded. To exclude them, add --count {} and --reason.",
            found.count,
            found.count
        );
    }
}

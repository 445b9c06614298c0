//! Commands of an entrant about itself and its team.

use swarmbench_client::client::Client;
use swarmbench_protocol::competition::{
    CreatedMember, EntrantChange, MemberList, MemberRequest, MemberSummary, PracticeRequest,
    StartedPractice,
};

use super::{EntrantOf, changed, path, show, tables, tell_changed};

#[derive(Debug, clap::Subcommand)]
pub(super) enum Command {
    /// Change an entrant's category (organizers), its contact, or the version of the terms that it accepts (the entrant).
    #[command(after_help = "Examples:\n  \
        swarmbench competition describe cmp_… ent_… --contact ada@example.org\n  \
        swarmbench competition describe cmp_… ent_… --accepts-terms 2\n  \
        swarmbench competition describe cmp_… ent_… --category models")]
    Describe(Describe),
    /// Start a practice run on open seeds, and show its swarm token. Practice counts nowhere; an earlier practice run ends.
    Practice {
        /// The competition's id.
        id: String,
        /// The entrant, if the key has several.
        #[arg(long)]
        entrant: Option<String>,
        /// A seed; may be repeated. By default the server draws one.
        #[arg(long = "seed")]
        seeds: Vec<i64>,
        /// A task of the competition; may be repeated. By default all tasks.
        #[arg(long = "task")]
        tasks: Vec<String>,
    },
    /// List the members that were added to a team.
    Members {
        #[command(flatten)]
        entrant: EntrantOf,
    },
    /// Add a member to a team. The member's key is shown only once; it has the rights of the entrant's own key.
    AddMember {
        #[command(flatten)]
        entrant: EntrantOf,
        /// The member's name; the team, organizers and judges see it.
        #[arg(long)]
        name: String,
    },
    /// Remove a member from a team. The member's key, and the tokens of the team's open games, are no longer accepted.
    RemoveMember {
        #[command(flatten)]
        entrant: EntrantOf,
        /// The member's id, from `swarmbench competition members`.
        member: String,
    },
}

#[derive(Debug, clap::Args)]
pub(super) struct Describe {
    #[command(flatten)]
    entrant: EntrantOf,
    #[command(flatten)]
    facts: Facts,
}

#[derive(Debug, clap::Args)]
#[group(required = true, multiple = true)]
struct Facts {
    /// The new category, one of the competition's.
    #[arg(long)]
    category: Option<String>,
    /// The version of the terms that the entrant accepts: the newest.
    #[arg(long, value_name = "VERSION")]
    accepts_terms: Option<u32>,
    /// The entrant's contact, which only organizers see; '' removes it.
    #[arg(long)]
    contact: Option<String>,
}

pub(super) async fn run(client: &Client, json: bool, command: Command) -> anyhow::Result<()> {
    match command {
        Command::Describe(Describe { entrant, facts }) => {
            let Facts { category, accepts_terms, contact } = facts;
            let change =
                EntrantChange { category, accepts_terms, contact, ..EntrantChange::default() };
            show(json, &changed(client, entrant, change).await?, tell_changed)
        }
        Command::Practice { id, entrant, seeds, tasks } => {
            let (seeds, tasks) = (Some(seeds), Some(tasks));
            let request = PracticeRequest {
                entrant,
                seeds: seeds.filter(|seeds| !seeds.is_empty()),
                tasks: tasks.filter(|tasks| !tasks.is_empty()),
            };
            let started: StartedPractice = client.post(&path(&id, "/practice"), &request).await?;
            show(json, &started, |started| {
                out!("{}", started.swarm_token);
                note!(
                    "{} has {} games for practice, on the seeds {:?}.",
                    started.run,
                    started.games,
                    started.seeds
                );
            })
        }
        Command::Members { entrant } => {
            let list: MemberList = client.get(&members(&entrant)).await?;
            show(json, &list, |list| out!("{}", tables::members(&list.items)))
        }
        Command::AddMember { entrant, name } => {
            let added: CreatedMember =
                client.post(&members(&entrant), &MemberRequest { name }).await?;
            show(json, &added, |added| {
                out!("{}", added.key);
                note!(
                    "{:?} is {}. The key cannot be shown again.",
                    added.member.name,
                    added.member.id
                );
            })
        }
        Command::RemoveMember { entrant, member } => {
            let path = format!("{}/{member}", members(&entrant));
            let removed: MemberSummary = client.delete(&path).await?;
            show(json, &removed, |removed| {
                out!("{}", removed.id);
                note!("The key of {:?} is no longer accepted.", removed.name);
            })
        }
    }
}

fn members(EntrantOf { id, entrant }: &EntrantOf) -> String {
    path(id, &format!("/entrants/{entrant}/members"))
}

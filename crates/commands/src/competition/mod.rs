//! `swarmbench competition`

mod definition;
mod mend;
mod tables;
mod team;

use std::io::Write;
use std::path::PathBuf;

use anyhow::{Context, bail};
use serde::Serialize;

use super::options::ServerArgs;
use super::output;
use super::pages::{Page, all, pages};
use swarmbench_client::client::Client;
use swarmbench_protocol::competition::{
    AttemptRequest, AttemptSummary, CodesRequest, Competition, CompetitionBoard, CreatedEntrant,
    EntrantChange, EntrantContact, EntrantRequest, EntrantSummary, InvitationCodes, StartedAttempt,
    VoidedAttempt,
};
use swarmbench_protocol::episode::VoidRequest;
use swarmbench_protocol::loopback::is_loopback;

#[derive(Debug, clap::Args)]
#[command(
    after_help = "A competition is played on sealed seeds. The server draws the seeds when the competition is created, shows a \
    commitment to them at once, and shows the seeds themselves after the end. docs/organise/organizer.md walks through a \
    competition, from the TOML file to the published results.\n\n\
    The server requires a key, an organizer's or an entrant's: put the key into SWARMBENCH_KEY.\n\n\
    Examples:\n  \
    swarmbench competition create examples/competition.toml\n  \
    swarmbench competition codes cmp_… 'team blue' 'team red'\n  \
    swarmbench competition board cmp_…\n  \
    swarmbench competition disqualify cmp_… ent_… --reason 'two entrants of one team'\n  \
    swarmbench competition export cmp_… > cup.jsonl\n  \
    swarmbench verify --competition cup.jsonl --commitment 5f0c…"
)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    server: ServerArgs,
    /// Print JSON, in the shape of the API. An export is JSON Lines in any case.
    #[arg(long, global = true)]
    json: bool,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Create a competition from a TOML file, and show its id and its commitment. Publish the commitment.
    Create {
        /// The TOML file, such as examples/competition.toml; - for the standard input.
        file: PathBuf,
    },
    /// List all competitions.
    List,
    /// Show a competition, after its end with its seeds and its salt.
    Show {
        /// The competition's id.
        id: String,
    },
    /// Create invitation codes, one for each entrant. A code is shown only once.
    Codes {
        /// The competition's id.
        id: String,
        /// A label for each code, visible to organizers only.
        #[arg(required = true)]
        labels: Vec<String>,
    },
    /// Enter a competition. The entrant's new key is shown only once; if you have a key, you enter with that one.
    Enter {
        /// The competition's id.
        id: String,
        #[command(flatten)]
        entrant: Declaration,
    },
    /// Start an attempt, and show its swarm token, with which you play over /swarm/obs and /swarm/act.
    Attempt {
        /// The competition's id.
        id: String,
        /// The entrant, if the key has several.
        #[arg(long)]
        entrant: Option<String>,
        /// The number of the attempt. Default: the next one that is open.
        #[arg(long)]
        attempt: Option<u32>,
    },
    /// Show your own attempts and their results. An organizer sees all attempts.
    Attempts(CompetitionId),
    /// List the entrants.
    Entrants(CompetitionId),
    /// Show the contacts of all entrants, as an organizer. The audit log records that they were read.
    Contacts {
        /// The competition's id.
        id: String,
        /// Print CSV.
        #[arg(long)]
        csv: bool,
    },
    /// Exclude an entrant. It stays on the board without a rank, with the reason.
    Disqualify {
        #[command(flatten)]
        entrant: EntrantOf,
        /// The reason, visible to all.
        #[arg(long)]
        reason: String,
    },
    /// Withdraw an entrant. It stays on the board without a rank.
    Withdraw {
        #[command(flatten)]
        entrant: EntrantOf,
        /// The reason, visible to all.
        #[arg(long)]
        reason: Option<String>,
    },
    /// Readmit an entrant that was withdrawn or disqualified.
    Readmit {
        #[command(flatten)]
        entrant: EntrantOf,
    },
    /// Vouch that an entrant plays with the model that it declared.
    Vouch {
        #[command(flatten)]
        entrant: EntrantOf,
        /// Withdraw the confirmation.
        #[arg(long)]
        not: bool,
    },
    /// Void an attempt that failed because of the server. A void attempt does not count and may be repeated, on spare seeds if
    /// the competition has some.
    Void {
        /// The competition's id.
        id: String,
        /// The id of the attempt's run, from the board or the entrant.
        run: String,
        /// The reason, visible to all.
        #[arg(long)]
        reason: String,
    },
    /// Show the board.
    Board {
        /// The competition's id.
        id: String,
        /// Print CSV.
        #[arg(long)]
        csv: bool,
        /// Only the entrants of this category, with ranks among themselves.
        #[arg(long)]
        category: Option<String>,
        /// The part of the board: scores on the public seeds, or on all other seeds (final).
        #[arg(long, value_parser = ["public", "final"])]
        part: Option<String>,
    },
    /// Write a competition to the standard output, as a file for `swarmbench verify --competition`.
    Export {
        /// The competition's id.
        id: String,
        /// The version of the format; 1 for programs that know only that one.
        #[arg(long)]
        format: Option<u32>,
    },
    #[command(flatten)]
    Team(team::Command),
    #[command(flatten)]
    Mend(mend::Command),
}

#[derive(Debug, clap::Args)]
struct CompetitionId {
    /// The competition's id.
    id: String,
}

#[derive(Debug, clap::Args)]
struct EntrantOf {
    /// The competition's id.
    id: String,
    /// The entrant's id, from `swarmbench competition entrants`.
    entrant: String,
}

#[derive(Debug, clap::Args)]
struct Declaration {
    /// The name on the board.
    #[arg(long)]
    name: String,
    /// The model that plays.
    #[arg(long)]
    model: String,
    /// The model's sampling temperature.
    #[arg(long)]
    temperature: Option<f64>,
    /// The model's nucleus sampling (top-p).
    #[arg(long)]
    top_p: Option<f64>,
    /// A file with the entrant's own prompt template.
    #[arg(long)]
    prompt_template: Option<PathBuf>,
    /// The invitation code, if the competition needs one.
    #[arg(long)]
    code: Option<String>,
    /// The category, if the competition has some.
    #[arg(long)]
    category: Option<String>,
    /// The version of the terms that you accept, from `swarmbench competition show`.
    #[arg(long, value_name = "VERSION")]
    accepts_terms: Option<u32>,
    /// Your contact, such as an email address: only organizers see it.
    #[arg(long)]
    contact: Option<String>,
}

const COMPETITIONS: &str = "/api/v1/competitions";

pub async fn run(args: Args) -> anyhow::Result<()> {
    let Args { command, server, json } = args;
    let client = &server.client().await?;
    match command {
        Command::Create { file } => {
            let created: Competition = client.post(COMPETITIONS, &definition::read(&file)?).await?;
            show(json, &created, |created| tell_created(client, created))
        }
        Command::List => {
            let list = Page::<Competition>::of(all(client, COMPETITIONS).await?);
            show(json, &list, |list| out!("{}", tables::competitions(&list.items)))
        }
        Command::Show { id } => {
            let shown: Competition = client.get(&path(&id, "")).await?;
            show(json, &shown, |shown| out!("{}", tables::competition(shown)))
        }
        Command::Codes { id, labels } => {
            let codes: InvitationCodes =
                client.post(&path(&id, "/codes"), &CodesRequest { labels }).await?;
            show(json, &codes, |codes| {
                out!("{}", tables::codes(codes));
                note!("Each is valid for one entrant. They cannot be shown again.");
            })
        }
        Command::Enter { id, entrant } => {
            let created: CreatedEntrant =
                client.post(&path(&id, "/entrants"), &entrant.request()?).await?;
            show(json, &created, tell_entered)
        }
        Command::Attempt { id, entrant, attempt } => {
            let request = AttemptRequest { entrant, attempt };
            let started: StartedAttempt = client.create(&path(&id, "/attempts"), &request).await?;
            show(json, &started, tell_started)
        }
        Command::Attempts(CompetitionId { id }) => {
            let list = Page::<AttemptSummary>::of(all(client, &path(&id, "/attempts")).await?);
            show(json, &list, |list| out!("{}", tables::attempts(&list.items)))
        }
        Command::Entrants(CompetitionId { id }) => {
            let list = Page::<EntrantSummary>::of(all(client, &path(&id, "/entrants")).await?);
            show(json, &list, |list| out!("{}", tables::entrants(&list.items)))
        }
        Command::Board { csv: true, .. } | Command::Contacts { csv: true, .. } if json => {
            bail!("name --csv or --json, not both")
        }
        Command::Contacts { id, csv } => show_contacts(client, json, &id, csv).await,
        Command::Disqualify { entrant, reason } => {
            let status = Some("disqualified".to_owned());
            let change = EntrantChange { status, reason: Some(reason), ..EntrantChange::default() };
            show(json, &changed(client, entrant, change).await?, tell_changed)
        }
        Command::Withdraw { entrant, reason } => {
            let status = Some("withdrawn".to_owned());
            let change = EntrantChange { status, reason, ..EntrantChange::default() };
            show(json, &changed(client, entrant, change).await?, tell_changed)
        }
        Command::Readmit { entrant } => {
            let status = Some("active".to_owned());
            let change = EntrantChange { status, ..EntrantChange::default() };
            show(json, &changed(client, entrant, change).await?, tell_changed)
        }
        Command::Vouch { entrant, not } => {
            let change = EntrantChange { vouched: Some(!not), ..EntrantChange::default() };
            show(json, &changed(client, entrant, change).await?, tell_changed)
        }
        Command::Void { id, run, reason } => {
            let path = path(&id, &format!("/attempts/{run}/void"));
            let voided: VoidedAttempt = client.post(&path, &VoidRequest { reason }).await?;
            show(json, &voided, |voided| {
                let run = &voided.attempt.run;
                out!("{run} does not count; its entrant may start that attempt again.");
                if let Some(seen) = &voided.seen {
                    note!("Caution: {}.", seen.warning);
                }
            })
        }
        Command::Board { id, csv, category, part } => {
            let query: Vec<_> = [("category", &category), ("part", &part)]
                .into_iter()
                .filter_map(|(name, value)| Some((name, value.as_ref()?)))
                .collect();
            let path = path(&id, "/board");
            if csv {
                return print_csv(client, &path, &query).await;
            }
            show(json, &whole_board(client, &path, &query).await?, tables::print_board)
        }
        Command::Export { id, format } => {
            let path = format!("/api/v1/exports/competitions/{id}");
            let mut out = std::io::BufWriter::new(output::stream());
            let format = format.map(|format| format.to_string());
            let query: Vec<_> = format.iter().map(|format| ("format", format)).collect();
            client.download(&path, &query, &mut out).await?;
            Ok(())
        }
        Command::Team(command) => team::run(client, json, command).await,
        Command::Mend(command) => mend::run(client, json, command).await,
    }
}

async fn show_contacts(client: &Client, json: bool, id: &str, csv: bool) -> anyhow::Result<()> {
    let path = &path(id, "/contacts");
    if csv {
        return print_csv(client, path, &[]).await;
    }
    let list = Page::<EntrantContact>::of(all(client, path).await?);
    show(json, &list, |list| out!("{}", tables::contacts(&list.items)))
}

/// Prints a response as JSON or as text.
fn show<T: Serialize>(json: bool, answer: &T, tell: impl FnOnce(&T)) -> anyhow::Result<()> {
    if json {
        return output::json(answer);
    }
    tell(answer);
    Ok(())
}

fn tell_created(client: &Client, created: &Competition) {
    out!("{}", created.id);
    note!(
        "\n{:?} {}, and closes at {}.\nIts commitment, to be published before anybody plays:\n  {}\n{}",
        created.name,
        opening(created),
        created.closes_at,
        created.commitment,
        entering(client, &created.id)
    );
}

/// The time from which attempts can be started; a time in the past is likely a mistake.
fn opening(created: &Competition) -> String {
    let Competition { opens_at, created_at, .. } = created;
    if opens_at <= created_at {
        format!("is open already, as its opens_at, {opens_at}, is not in the future")
    } else {
        format!("opens at {opens_at}")
    }
}

/// The page and the command for entrants. Entrants may reach the server at another address than the organizer.
fn entering(client: &Client, id: &str) -> String {
    let base = client.base();
    let page = format!("competitions/{id}");
    let command = format!("swarmbench competition enter {id}");
    if base.host_str().is_some_and(is_loopback) {
        format!(
            "Entrants enter on the page /{page} of this server, or with `{command}`: tell them the server's address, as {base} \
             is good on this machine alone."
        )
    } else {
        format!("Entrants enter at {base}{page}, or with `{command} --server {base}`.")
    }
}

impl Declaration {
    fn request(self) -> anyhow::Result<EntrantRequest> {
        let Self {
            name,
            model,
            temperature,
            top_p,
            prompt_template,
            code,
            category,
            accepts_terms,
            contact,
        } = self;
        let read = |file: PathBuf| {
            swarmbench_clock::files::read_text(&file).with_context(|| format!("{}", file.display()))
        };
        let prompt_template = prompt_template.map(read).transpose()?;
        let agent_meta = None;
        Ok(EntrantRequest {
            name,
            model,
            temperature,
            top_p,
            agent_meta,
            prompt_template,
            code,
            category,
            accepts_terms,
            contact,
        })
    }
}

fn tell_entered(created: &CreatedEntrant) {
    if let Some(key) = &created.key {
        out!("{key}");
    }
    note!(
        "{:?} takes part as {}. {}",
        created.entrant.name,
        created.entrant.id,
        match created.key {
            Some(_) => "The key cannot be shown again: put it into SWARMBENCH_KEY.",
            None => "It belongs to your key.",
        }
    );
}

fn tell_started(started: &StartedAttempt) {
    out!("{}", started.swarm_token);
    note!(
        "Attempt {} of {} has {} games, in {}. No round begins after {}.\nThis is its swarm token; a lost one is \
         replaced by POST /api/v1/runs/{}/token.",
        started.attempt,
        started.entrant,
        started.games,
        started.run,
        started.closes_at,
        started.run
    );
}

async fn changed(
    client: &Client,
    of: EntrantOf,
    change: EntrantChange,
) -> anyhow::Result<EntrantSummary> {
    let path = path(&of.id, &format!("/entrants/{}", of.entrant));
    Ok(client.patch(&path, &change).await?)
}

fn tell_changed(entrant: &EntrantSummary) {
    let vouched = if entrant.vouched { ", vouched for" } else { "" };
    out!("{} ({:?}) is {}{vouched}.", entrant.id, entrant.name, entrant.status);
}

/// The board with all its pages. Its other fields come from the first page.
async fn whole_board(
    client: &Client,
    path: &str,
    query: &[(&str, &String)],
) -> anyhow::Result<CompetitionBoard> {
    let mut whole: Option<CompetitionBoard> = None;
    let add = |mut page: CompetitionBoard| {
        let next = page.next_cursor.take();
        match &mut whole {
            Some(whole) => whole.items.extend(page.items),
            None => whole = Some(page),
        }
        next
    };
    let query: Vec<(&str, &str)> =
        query.iter().map(|(name, value)| (*name, value.as_str())).collect();
    pages(client, path, &query, add).await?;
    whole.context("the server shows no board")
}

/// Prints all pages as CSV, with one header.
async fn print_csv(client: &Client, path: &str, query: &[(&str, &String)]) -> anyhow::Result<()> {
    let mut out = output::stream();
    let format = "csv".to_owned();
    let query = [query, &[("format", &format)]].concat();
    let mut next = client.download(path, &query, &mut out).await?;
    while let Some(cursor) = next {
        let mut page = Vec::new();
        next = {
            let further = [&query[..], &[("cursor", &cursor)]].concat();
            client.download(path, &further, &mut page).await?
        };
        let header = page.iter().position(|&byte| byte == b'\n').map_or(page.len(), |end| end + 1);
        out.write_all(&page[header..])?;
    }
    Ok(out.flush()?)
}

fn path(id: &str, rest: &str) -> String {
    format!("{COMPETITIONS}/{id}{rest}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entrants_are_told_an_address_that_is_good_for_them() {
        let told = |server: &str| entering(&Client::new(server).expect("an address"), "cmp_1");
        assert_eq!(
            told("https://swarm.example.org"),
            "Entrants enter at https://swarm.example.org/competitions/cmp_1, or with `swarmbench competition enter cmp_1 \
             --server https://swarm.example.org/`."
        );
        for local in ["http://127.0.0.1:8080", "http://localhost:8080", "http://[::1]:8080"] {
            let told = told(local);
            assert!(told.contains("on the page /competitions/cmp_1 of this server"), "{told}");
            assert!(told.ends_with("is good on this machine alone."), "{told}");
        }
    }
}

//! `swarmbench competition`

use std::io::{Read, Write};
use std::path::PathBuf;

use anyhow::{Context, anyhow, bail};
use jiff::Timestamp;
use serde::de::DeserializeOwned;

use super::play::table;
use crate::players::client::Client;
use crate::wire::competition::{
    AttemptList, AttemptRequest, CodesRequest, Competition, CompetitionBoard, CompetitionList,
    CreatedEntrant, EntrantChange, EntrantList, EntrantRequest, EntrantSummary, InvitationCodes,
    StartedAttempt,
};
use crate::wire::episode::VoidRequest;

#[derive(Debug, clap::Args)]
#[command(
    after_help = "A competition is played on sealed seeds: the server draws them when it is created, shows a commitment to \
    them at once and the seeds themselves after the end. docs/organise/organizer.md walks through one, from the TOML file to \
    the published results.\n\n\
    The server asks for an organizer's key: put it into SWARMBENCH_KEY.\n\n\
    Examples:\n  \
    swarmbench competition create examples/competition.toml\n  \
    swarmbench competition codes cmp_… 'team blue' 'team red'\n  \
    swarmbench competition board cmp_…\n  \
    swarmbench competition disqualify cmp_… ent_… --reason 'two entrants of one team'\n  \
    swarmbench competition export cmp_… > cup.jsonl\n  \
    swarmbench verify --competition cup.jsonl --commitment 5f0c…"
)]
pub(super) struct Args {
    #[command(subcommand)]
    command: Command,
    /// The address of the server.
    #[arg(long, global = true, env = "SWARMBENCH_SERVER", default_value = "http://127.0.0.1:8080")]
    server: String,
    /// Your key: an organizer's, or that of an entrant.
    #[arg(long, global = true, env = "SWARMBENCH_KEY", hide_env_values = true)]
    key: Option<String>,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Create a competition from a TOML file, and show its id and its commitment: publish that.
    Create {
        /// The file, like examples/competition.toml; - for the standard input.
        file: PathBuf,
    },
    /// List all competitions.
    List,
    /// Show a competition; after its end with its seeds and its salt.
    Show {
        /// The competition's id.
        id: String,
        /// As JSON.
        #[arg(long)]
        json: bool,
    },
    /// Create invitation codes, one for each entrant. They are shown only once.
    Codes {
        /// The competition's id.
        id: String,
        /// A label for each code, visible to organizers only.
        #[arg(required = true)]
        labels: Vec<String>,
    },
    /// Enter a competition, and show the new key for it, only once. If you have a key, enter with that.
    Enter {
        /// The competition's id.
        id: String,
        /// The name on the board.
        #[arg(long)]
        name: String,
        /// The model that plays.
        #[arg(long)]
        model: String,
        /// Its sampling temperature.
        #[arg(long)]
        temperature: Option<f64>,
        /// Its nucleus of sampling.
        #[arg(long)]
        top_p: Option<f64>,
        /// A file with a prompt template of its own.
        #[arg(long)]
        prompt_template: Option<PathBuf>,
        /// The invitation code, where one is needed.
        #[arg(long)]
        code: Option<String>,
    },
    /// Start an attempt, and show its swarm token: play with it over /swarm/obs and /swarm/act.
    Attempt {
        /// The competition's id.
        id: String,
        /// The entrant, if the key has several.
        #[arg(long)]
        entrant: Option<String>,
        /// Its number; default: the next one that is open.
        #[arg(long)]
        attempt: Option<u32>,
    },
    /// Show your own attempts and their results; an organizer sees all.
    Attempts {
        /// The competition's id.
        id: String,
    },
    /// List the entrants.
    Entrants {
        /// The competition's id.
        id: String,
    },
    /// Exclude an entrant: it stays on the board without a rank, with the reason.
    Disqualify {
        #[command(flatten)]
        entrant: EntrantOf,
        /// The reason, visible to everybody.
        #[arg(long)]
        reason: String,
    },
    /// Withdraw an entrant: it stays on the board without a rank.
    Withdraw {
        #[command(flatten)]
        entrant: EntrantOf,
        /// The reason, visible to everybody.
        #[arg(long)]
        reason: Option<String>,
    },
    /// Readmit an entrant that was withdrawn or disqualified.
    Readmit {
        #[command(flatten)]
        entrant: EntrantOf,
    },
    /// Vouch that the model that an entrant declared is the one that plays.
    Vouch {
        #[command(flatten)]
        entrant: EntrantOf,
        /// Withdraw this confirmation.
        #[arg(long)]
        not: bool,
    },
    /// Void an attempt that failed because of the server: it does not count, and may be repeated on the same seeds.
    Void {
        /// The competition's id.
        id: String,
        /// The id of the attempt's run, from the board or the entrant.
        run: String,
        /// What happened, visible to everybody.
        #[arg(long)]
        reason: String,
    },
    /// Show the board.
    Board {
        /// The competition's id.
        id: String,
        /// As CSV.
        #[arg(long, conflicts_with = "json")]
        csv: bool,
        /// As JSON.
        #[arg(long)]
        json: bool,
    },
    /// Export all of a competition to the standard output, for `swarmbench verify --competition`.
    Export {
        /// The competition's id.
        id: String,
    },
}

#[derive(Debug, clap::Args)]
struct EntrantOf {
    /// The competition's id.
    id: String,
    /// The entrant's id, from `swarmbench competition entrants`.
    entrant: String,
}

#[expect(clippy::too_many_lines, reason = "one arm a command")]
pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    let mut client = Client::new(&args.server)?;
    if let Some(key) = args.key {
        client = client.with_key(key);
    }
    match args.command {
        Command::Create { file } => {
            let request = read_toml(&file)?;
            let made: Competition = client.post("/api/v1/competitions", &request).await?;
            println!("{}", made.id);
            eprintln!(
                "\n{:?} opens at {} and closes at {}.\nIts commitment, to be published before anybody plays:\n  {}\n\
                 Entrants register with POST {}api/v1/competitions/{}/entrants.",
                made.name,
                made.opens_at,
                made.closes_at,
                made.commitment,
                client.base(),
                made.id
            );
        }
        Command::List => list(&client).await?,
        Command::Show { id, json } => {
            let shown: Competition = client.get(&path(&id, "")).await?;
            if json {
                println!("{}", serde_json::to_string_pretty(&shown)?);
            } else {
                println!("{}", show(&shown));
            }
        }
        Command::Codes { id, labels } => {
            let request = CodesRequest { labels };
            let codes: InvitationCodes = client.post(&path(&id, "/codes"), &request).await?;
            let mut table = table(&["for", "code"]);
            for code in codes.items {
                table.add_row([code.label, code.code]);
            }
            println!("{table}");
            eprintln!("Each is good for one entrant. They cannot be shown again.");
        }
        Command::Enter { id, name, model, temperature, top_p, prompt_template, code } => {
            let read = |file: PathBuf| {
                std::fs::read_to_string(&file).with_context(|| format!("{}", file.display()))
            };
            let prompt_template = prompt_template.map(read).transpose()?;
            let agent_meta = None;
            let request = EntrantRequest {
                name,
                model,
                temperature,
                top_p,
                agent_meta,
                prompt_template,
                code,
            };
            let made: CreatedEntrant = client.post(&path(&id, "/entrants"), &request).await?;
            if let Some(key) = &made.key {
                println!("{key}");
            }
            eprintln!(
                "{:?} takes part as {}. {}",
                made.entrant.name,
                made.entrant.id,
                match made.key {
                    Some(_) => "The key cannot be shown again: put it into SWARMBENCH_KEY.",
                    None => "It belongs to your key.",
                }
            );
        }
        Command::Attempt { id, entrant, attempt } => {
            let request = AttemptRequest { entrant, attempt };
            let started: StartedAttempt = client.post(&path(&id, "/attempts"), &request).await?;
            println!("{}", started.swarm_token);
            eprintln!(
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
        Command::Attempts { id } => {
            let mut list = Vec::new();
            let add = |page: AttemptList| {
                list.extend(page.items);
                page.next_cursor
            };
            pages(&client, &path(&id, "/attempts"), add).await?;
            let mut shown =
                table(&["entrant", "attempt", "run", "status", "games", "total", "note"]);
            for attempt in list {
                let note = attempt.voided.map(|reason| format!("does not count: {reason}"));
                shown.add_row([
                    attempt.entrant,
                    attempt.attempt.to_string(),
                    attempt.run,
                    attempt.status,
                    format!("{} of {}", attempt.games_ended, attempt.games),
                    attempt.total.map_or_else(String::new, |total| format!("{total:.2}")),
                    note.unwrap_or_default(),
                ]);
            }
            println!("{shown}");
        }
        Command::Entrants { id } => {
            let mut list = Vec::new();
            let add = |page: EntrantList| {
                list.extend(page.items);
                page.next_cursor
            };
            pages(&client, &path(&id, "/entrants"), add).await?;
            let mut table =
                table(&["entrant", "name", "model", "status", "reason", "vouched", "registered"]);
            for entrant in list {
                table.add_row([
                    entrant.id,
                    entrant.name,
                    entrant.model,
                    entrant.status,
                    entrant.reason.unwrap_or_default(),
                    yes(entrant.vouched),
                    entrant.registered_at.to_string(),
                ]);
            }
            println!("{table}");
        }
        Command::Disqualify { entrant, reason } => {
            let status = Some("disqualified".to_owned());
            change(&client, entrant, EntrantChange { status, reason: Some(reason), vouched: None })
                .await?;
        }
        Command::Withdraw { entrant, reason } => {
            let status = Some("withdrawn".to_owned());
            change(&client, entrant, EntrantChange { status, reason, vouched: None }).await?;
        }
        Command::Readmit { entrant } => {
            let status = Some("active".to_owned());
            change(&client, entrant, EntrantChange { status, ..EntrantChange::default() }).await?;
        }
        Command::Vouch { entrant, not } => {
            let vouched = Some(!not);
            change(&client, entrant, EntrantChange { vouched, ..EntrantChange::default() }).await?;
        }
        Command::Void { id, run, reason } => {
            let path = path(&id, &format!("/attempts/{run}/void"));
            let _: serde_json::Value = client.post(&path, &VoidRequest { reason }).await?;
            println!("{run} does not count; its entrant may start that attempt again.");
        }
        Command::Board { id, csv: true, .. } => {
            print_board_csv(&client, &path(&id, "/board")).await?;
        }
        Command::Board { id, json, .. } => {
            let board = whole_board(&client, &path(&id, "/board")).await?;
            if json {
                println!("{}", serde_json::to_string_pretty(&board)?);
            } else {
                show_board(&board);
            }
        }
        Command::Export { id } => {
            let path = format!("/api/v1/exports/competitions/{id}");
            let mut out = std::io::BufWriter::new(std::io::stdout().lock());
            client.download(&path, &[], &mut out).await?;
        }
    }
    Ok(())
}

/// Reads a list page by page; `add` takes a page and says where the next one begins.
async fn pages<T: DeserializeOwned>(
    client: &Client,
    path: &str,
    mut add: impl FnMut(T) -> Option<String>,
) -> anyhow::Result<()> {
    let mut cursor = None;
    loop {
        let query = cursor.as_deref().map(|cursor| ("cursor", cursor));
        cursor = add(client.get_with(path, query.as_slice()).await?);
        if cursor.is_none() {
            return Ok(());
        }
    }
}

/// The board with all its pages; the first says what is shown.
async fn whole_board(client: &Client, path: &str) -> anyhow::Result<CompetitionBoard> {
    let mut whole: Option<CompetitionBoard> = None;
    let add = |mut page: CompetitionBoard| {
        let next = page.next_cursor.take();
        match &mut whole {
            Some(whole) => whole.items.extend(page.items),
            None => whole = Some(page),
        }
        next
    };
    pages(client, path, add).await?;
    whole.context("the server shows no board")
}

/// Prints all pages as CSV, with the line of names once.
async fn print_board_csv(client: &Client, path: &str) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    let format = ("format", &"csv".to_owned());
    let mut next = client.download(path, &[format], &mut out).await?;
    while let Some(cursor) = next {
        let mut page = Vec::new();
        next = client.download(path, &[format, ("cursor", &cursor)], &mut page).await?;
        let names = page.iter().position(|&byte| byte == b'\n').map_or(page.len(), |end| end + 1);
        out.write_all(&page[names..])?;
    }
    Ok(out.flush()?)
}

fn path(id: &str, rest: &str) -> String {
    format!("/api/v1/competitions/{id}{rest}")
}

/// Reads a TOML file as the JSON that the server takes: the same fields, and times as texts.
fn read_toml(file: &PathBuf) -> anyhow::Result<serde_json::Value> {
    let name = file.display();
    let text = if file.as_os_str() == "-" {
        let mut text = String::new();
        std::io::stdin().read_to_string(&mut text).map(|_| text)
    } else {
        std::fs::read_to_string(file)
    };
    let text = text.with_context(|| format!("{name} cannot be read"))?;
    let read: toml::Table = toml::from_str(&text).map_err(|error| anyhow!("{name}: {error}"))?;
    json(toml::Value::Table(read)).with_context(|| format!("{name} is not like JSON"))
}

fn json(value: toml::Value) -> anyhow::Result<serde_json::Value> {
    Ok(match value {
        toml::Value::String(text) => text.into(),
        toml::Value::Integer(number) => number.into(),
        toml::Value::Float(number) => match serde_json::Number::from_f64(number) {
            Some(number) => number.into(),
            None => bail!("{number} is not a number in JSON"),
        },
        toml::Value::Boolean(value) => value.into(),
        toml::Value::Datetime(at) if at.offset.is_none() => {
            bail!("the time {at} needs an offset, like 2027-03-01T12:00:00Z")
        }
        toml::Value::Datetime(at) => at.to_string().into(),
        toml::Value::Array(values) => values.into_iter().map(json).collect::<Result<_, _>>()?,
        toml::Value::Table(fields) => {
            let fields = fields.into_iter().map(|(name, value)| Ok((name, json(value)?)));
            serde_json::Value::Object(fields.collect::<anyhow::Result<_>>()?)
        }
    })
}

async fn list(client: &Client) -> anyhow::Result<()> {
    let mut table = table(&["competition", "name", "phase", "opens", "closes"]);
    let mut cursor: Option<String> = None;
    loop {
        let query = cursor.as_deref().map(|cursor| ("cursor", cursor));
        let page: CompetitionList =
            client.get_with("/api/v1/competitions", query.as_slice()).await?;
        for one in page.items {
            let (opens, closes) = (one.opens_at.to_string(), one.closes_at.to_string());
            table.add_row([one.id, one.name, one.phase, opens, closes]);
        }
        cursor = page.next_cursor;
        if cursor.is_none() {
            break;
        }
    }
    println!("{table}");
    Ok(())
}

async fn change(client: &Client, of: EntrantOf, change: EntrantChange) -> anyhow::Result<()> {
    let path = path(&of.id, &format!("/entrants/{}", of.entrant));
    let entrant: EntrantSummary = client.patch(&path, &change).await?;
    let vouched = if entrant.vouched { ", vouched for" } else { "" };
    println!("{} ({:?}) is {}{vouched}.", entrant.id, entrant.name, entrant.status);
    Ok(())
}

fn show(competition: &Competition) -> comfy_table::Table {
    let mut shown = table(&["", ""]);
    let suite = &competition.suite;
    let tasks = suite.tasks.clone().unwrap_or_default().join(", ");
    let seeds = suite.seeds.unwrap_or_default();
    let clock = competition.clocks.round_deadline_s.map_or(0.0, |seconds| seconds.0);
    let time = |at: Option<Timestamp>| at.map_or_else(|| "?".to_owned(), |at| at.to_string());
    let mut row = |what: &str, value: String| {
        shown.add_row([what.to_owned(), value]);
    };
    row("competition", competition.id.clone());
    row("name", competition.name.clone());
    row("description", competition.description.clone());
    row("phase", competition.phase.clone());
    row("opens", competition.opens_at.to_string());
    row("closes", competition.closes_at.to_string());
    let rules = suite.rules.clone().unwrap_or_default();
    row("plays", format!("{tasks}, each on {seeds} sealed seeds, rules {rules}"));
    row("clock", format!("{clock} s a round"));
    row("entry", competition.entry.clone());
    for (number, window) in (1..).zip(&competition.attempts) {
        let (opens, closes) = (time(window.opens_at), time(window.closes_at));
        row(&format!("attempt {number}"), format!("from {opens} until {closes}"));
    }
    row("counts", format!("the {} attempt", competition.counts));
    row("board", competition.board.clone());
    row("commitment", competition.commitment.clone());
    if let (Some(salt), Some(seeds)) = (&competition.salt, &competition.seeds) {
        row("salt", salt.clone());
        row("seeds", seeds.join("\n"));
    }
    shown
}

fn show_board(board: &CompetitionBoard) {
    if board.shows == "nothing" {
        println!("The board is hidden until the competition is closed.");
        return;
    }
    let first = board.items.iter().find(|row| !row.tasks.is_empty());
    let tasks: Vec<String> =
        first.map_or(Vec::new(), |row| row.tasks.iter().map(|task| task.task.clone()).collect());
    let mut head = vec!["rank", "name", "model"];
    head.extend(tasks.iter().map(String::as_str));
    head.extend(["total", "attempt", "invalid", "clock", "decentralization", "status"]);
    let mut shown = table(&head);
    for row in &board.items {
        let mut cells = vec![
            row.rank.map_or_else(|| "–".to_owned(), |rank| rank.to_string()),
            row.entrant.name.clone(),
            if row.entrant.vouched {
                row.entrant.model.clone()
            } else {
                format!("{} (not vouched for)", row.entrant.model)
            },
        ];
        for name in &tasks {
            let of = row.tasks.iter().find(|task| task.task == *name);
            let numbers = of.and_then(|task| task.mean.zip(task.deviation));
            cells.push(numbers.map_or_else(String::new, |(m, d)| format!("{m:.2} ± {d:.2}")));
        }
        let status = match &row.entrant.reason {
            Some(reason) => format!("{}: {reason}", row.entrant.status),
            None => row.entrant.status.clone(),
        };
        cells.extend([
            row.total.map_or_else(String::new, |total| format!("{total:.2}")),
            row.attempt.map_or_else(String::new, |attempt| attempt.to_string()),
            format!("{:.1} %", 100.0 * row.invalid_share),
            format!("{:.1} %", 100.0 * row.clock_share),
            row.decentralization.clone().unwrap_or_default(),
            status,
        ]);
        shown.add_row(cells);
    }
    println!("{shown}");
    if board.shows == "totals" {
        println!("What each task came to is shown when the competition is closed.");
    }
    if let Some(at) = board.frozen_at {
        println!("The board is frozen: it shows what was over before {at}.");
    }
}

fn yes(is: bool) -> String {
    if is { "yes" } else { "no" }.to_owned()
}
